//! Virtual views: directions drawn from the field, and the cameras that stand there.
//!
//! A strategy is a function that gives directions; [`place`] turns any directions into views.
//! The paper's strategy is a weighting of the candidate grid ([`potential_weights`]) and a draw
//! from it ([`draw_without_replacement`]).

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::camera::Camera;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::field::{Field, Focus, angle, fibonacci_sphere};

/// The random stream of the view draw, apart from those of other consumers of the seed.
const STREAM: u64 = 0x7669_6577;

/// Within this angle of straight above or below, the mean up direction turns too fast to use.
const POLE: f64 = 10.0 / 180.0 * std::f64::consts::PI;

/// A camera on the sphere that looks at the focus.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualView {
    /// World frame; named `virtual_000` onwards in the order of the draw.
    pub camera: Camera,
    /// Unit direction from the focus.
    pub direction: DVec3,
    /// `U_conf`, angle to the nearest training camera, radians.
    pub u_conf: f64,
    /// Supervision weight `alpha_k = 1 / (1 + U_conf)`, or 1 where confidence weighting is off.
    pub alpha: f64,
}

/// The paper's `K = config.views.count` virtual views: candidates on a Fibonacci sphere, drawn
/// once without replacement with probability `P_j = w_j / sum w`, `w = 1 / (U_total + epsilon)`.
///
/// # Errors
/// More views than candidates, or weights that are not positive numbers.
pub fn virtual_views(
    train: &[Camera],
    focus: &Focus,
    field: &Field,
    config: &Config,
) -> Result<Vec<VirtualView>> {
    let count = config.views.count;
    if count > config.field.n_candidates {
        return Err(Error::usage(format!(
            "cannot draw {count} virtual views (views.count) from {} candidates (field.n_candidates)",
            config.field.n_candidates
        ))
        .way_out("lower the one or raise the other"));
    }
    let candidates = fibonacci_sphere(config.field.n_candidates);
    let weights = potential_weights(field, &candidates, config.views.epsilon);
    let directions: Vec<DVec3> = draw_without_replacement(&weights, count, config.seed)?
        .into_iter()
        .map(|j| candidates[j])
        .collect();
    place(
        &directions,
        train,
        focus,
        field,
        config.loss.confidence_weighting,
    )
}

/// Sampling weights `w_j = 1 / (U_total(p_j) + epsilon)`.
pub fn potential_weights(field: &Field, candidates: &[DVec3], epsilon: f64) -> Vec<f64> {
    candidates
        .iter()
        .map(|p| 1.0 / (field.u_total(*p) + epsilon))
        .collect()
}

/// Indices of `count` entries drawn one after another without replacement, each with
/// probability proportional to its weight among those left; in the order of the draw.
///
/// By exponential keys `-ln(u_j) / w_j`, smallest first (Efraimidis and Spirakis, 2006).
///
/// # Errors
/// `count` beyond the number of weights; a weight that is not a positive finite number.
pub fn draw_without_replacement(weights: &[f64], count: usize, seed: u64) -> Result<Vec<usize>> {
    if count > weights.len() {
        return Err(Error::usage(format!(
            "cannot draw {count} of {} candidates without replacement",
            weights.len()
        )));
    }
    if let Some(j) = weights.iter().position(|w| !(w.is_finite() && *w > 0.0)) {
        return Err(Error::usage(format!(
            "candidate {j} has the sampling weight {}",
            weights[j]
        ))
        .way_out("views.epsilon must be positive and field.lambda not negative"));
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(STREAM);
    let mut keys: Vec<(f64, usize)> = weights
        .iter()
        .enumerate()
        .map(|(j, w)| (-open_unit(&mut rng).ln() / w, j))
        .collect();
    keys.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    Ok(keys.into_iter().take(count).map(|(_, j)| j).collect())
}

/// Uniform in the open interval (0, 1): neither end has a finite positive logarithm.
fn open_unit(rng: &mut impl Rng) -> f64 {
    ((rng.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

/// Virtual views in the given unit directions on the sphere, looking at the focus.
///
/// # Errors
/// No training camera to take the intrinsics from.
pub fn place(
    directions: &[DVec3],
    train: &[Camera],
    focus: &Focus,
    field: &Field,
    confidence_weighting: bool,
) -> Result<Vec<VirtualView>> {
    let intrinsics = typical_intrinsics(train)?;
    let mean_up = train.iter().map(Camera::up).sum::<DVec3>() / train.len() as f64;
    let views = directions.iter().enumerate().map(|(k, &direction)| {
        let nearest = &train[field.nearest(direction)];
        let up = choose_up(direction, mean_up, nearest);
        let eye = focus.center + focus.radius * direction;
        let u_conf = field.u_conf(direction);
        // The pose is made around the focus and then moved there, so that the viewing
        // direction is exact however far the world's origin is.
        let turned = intrinsics.looking_at(format!("virtual_{k:03}"), DVec3::ZERO, -direction, up);
        VirtualView {
            camera: Camera {
                translation: -(turned.rotation * eye),
                ..turned
            },
            direction,
            u_conf,
            alpha: if confidence_weighting {
                1.0 / (1.0 + u_conf)
            } else {
                1.0
            },
        }
    });
    Ok(views.collect())
}

/// The most common training image size (the first of equals), the median focal lengths among
/// the cameras that have it, and a centred principal point.
fn typical_intrinsics(train: &[Camera]) -> Result<Camera> {
    let same_size = |a: &Camera, b: &Camera| (a.width, a.height) == (b.width, b.height);
    let mut typical: Option<(&Camera, usize)> = None;
    for camera in train {
        let count = train.iter().filter(|c| same_size(c, camera)).count();
        if typical.is_none_or(|(_, most)| count > most) {
            typical = Some((camera, count));
        }
    }
    let (typical, _) =
        typical.ok_or_else(|| Error::new("no training camera to shape the virtual views by"))?;
    let median_of = |focal: fn(&Camera) -> f64| {
        let mut values: Vec<f64> = train
            .iter()
            .filter(|c| same_size(c, typical))
            .map(focal)
            .collect();
        values.sort_unstable_by(f64::total_cmp);
        let n = values.len();
        0.5 * (values[(n - 1) / 2] + values[n / 2])
    };
    Ok(Camera {
        fx: median_of(|c| c.fx),
        fy: median_of(|c| c.fy),
        cx: 0.5 * f64::from(typical.width),
        cy: 0.5 * f64::from(typical.height),
        ..typical.clone()
    })
}

/// Which way is up in a view along `direction`: the mean camera up; near its poles, or where
/// the ups cancel out, the nearest training camera's up; where that camera itself looks across
/// the sphere, its viewing direction, which cannot then be parallel too.
fn choose_up(direction: DVec3, mean_up: DVec3, nearest: &Camera) -> DVec3 {
    let off_pole = |up: DVec3| {
        let theta = angle(direction, up);
        theta > POLE && theta < std::f64::consts::PI - POLE
    };
    // Ups that mostly cancel out name no common direction.
    if mean_up.length() > 0.1 && off_pole(mean_up.normalize()) {
        mean_up
    } else if off_pole(nearest.up()) {
        nearest.up()
    } else {
        nearest.forward()
    }
}
