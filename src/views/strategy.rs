//! A strategy chooses where virtual views stand.

use glam::DVec3;

use super::draw::{draw_without_replacement, open_unit, random};
use super::place::mean_up;
use super::{Viewpoint, VirtualView};
use crate::camera::Camera;
use crate::config::{Config, Strategy, VisibilityConfig};
use crate::error::{Error, Result};
use crate::field::{Field, Focus, angle, fibonacci_sphere};

/// Directions whose angle has a smaller sine span no arc of their own.
const MIN_ARC_SINE: f64 = 1e-6;

/// One in so many candidates may lie farther from all chosen views than asked for: a random draw takes long to find the last.
const LEFT_OUT: usize = 20;

/// Chooses at most `config.views.count` viewpoints, in the order of the choice.
pub(super) fn choose(
    train: &[Camera],
    focus: &Focus,
    field: &Field,
    visible_shares: Option<&[f64]>,
    config: &Config,
) -> Result<Vec<Viewpoint>> {
    let views = &config.views;
    let grid = fibonacci_sphere(config.field.n_candidates);
    let (candidates, factors) = match visible_shares {
        None => {
            let n = grid.len();
            (grid, vec![1.0; n])
        }
        Some(shares) => supported(grid, shares, &views.visibility)?,
    };
    let count = views.count.min(candidates.len());
    let draw = |mut weights: Vec<f64>| {
        weights.iter_mut().zip(&factors).for_each(|(w, f)| *w *= f);
        draw_without_replacement(&weights, count, config.seed)
    };
    let chosen = match views.strategy {
        Strategy::Potential => draw(potential_weights(field, &candidates, views.epsilon))?,
        Strategy::NearestAngle => draw(nearest_angle_weights(field, &candidates, views.epsilon))?,
        Strategy::SphereUniform => draw(vec![1.0; candidates.len()])?,
        Strategy::SphereFarthest => farthest_points(&candidates, &field.directions, count),
        Strategy::Interpolation => {
            return interpolate(train, focus, field, views.count, config.seed);
        }
    };
    let mut directions: Vec<DVec3> = chosen.into_iter().map(|j| candidates[j]).collect();
    if let Some(within_deg) = views.within_deg {
        directions.truncate(enough(&directions, &candidates, within_deg.to_radians()));
    }
    Ok(directions.into_iter().map(Viewpoint::on_sphere).collect())
}

/// Returns how many of the `chosen` directions, the first ones, leave at most a twentieth of the candidates farther than `within` radians from
/// all of them; all, where no number does.
pub fn enough(chosen: &[DVec3], candidates: &[DVec3], within: f64) -> usize {
    let most_left = candidates.len() / LEFT_OUT;
    let mut far: Vec<DVec3> = candidates.to_vec();
    for (i, direction) in chosen.iter().enumerate() {
        far.retain(|candidate| angle(*candidate, *direction) > within);
        if far.len() <= most_left {
            return i + 1;
        }
    }
    chosen.len()
}

/// Chooses at most `config.views.count` of the candidate views, drawn with equal weights but for
/// what `config.views.visibility` makes of their shares, and named in the order of the draw.
pub(super) fn drawn(
    candidates: Vec<VirtualView>,
    visible_shares: Option<&[f64]>,
    config: &Config,
) -> Result<Vec<VirtualView>> {
    let n = candidates.len();
    let (candidates, weights) = match visible_shares {
        None => (candidates, vec![1.0; n]),
        Some(shares) => supported(candidates, shares, &config.views.visibility)?,
    };
    let count = config.views.count.min(candidates.len());
    let chosen = draw_without_replacement(&weights, count, config.seed)?;
    let named = chosen.into_iter().enumerate().map(|(k, j)| {
        let mut view = candidates[j].clone();
        view.camera.name = format!("virtual_{k:03}");
        view
    });
    Ok(named.collect())
}

/// Keeps the candidates that show enough of what training cameras see, and what their weights are
/// multiplied by.
fn supported<T>(
    grid: Vec<T>,
    shares: &[f64],
    config: &VisibilityConfig,
) -> Result<(Vec<T>, Vec<f64>)> {
    if shares.len() != grid.len() {
        return Err(Error::new(format!(
            "{} visible shares for {} candidates",
            shares.len(),
            grid.len()
        )));
    }
    let kept: (Vec<T>, Vec<f64>) = grid
        .into_iter()
        .zip(shares)
        .filter(|(_, share)| **share > 0.0 && **share >= config.min_share)
        .map(|(p, share)| (p, share.powf(config.power)))
        .unzip();
    if kept.0.is_empty() {
        let best = shares.iter().copied().fold(0.0, f64::max);
        return Err(Error::new(format!(
            "no candidate view is left: the best of {} shows a training camera's points in {:.0} % of its covered pixels, \
             views.visibility.min_share is {}",
            shares.len(),
            100.0 * best,
            config.min_share
        ))
        .way_out("lower views.visibility.min_share, or raise views.visibility.max_angle_deg"));
    }
    Ok(kept)
}

/// Returns the sampling weights `w_j = 1 / (U_total(p_j) + epsilon)`.
pub fn potential_weights(field: &Field, candidates: &[DVec3], epsilon: f64) -> Vec<f64> {
    candidates
        .iter()
        .map(|p| 1.0 / (field.u_total(*p) + epsilon))
        .collect()
}

/// Returns the sampling weights `w_j = theta_min(p_j) + epsilon`: the paper's nearest-angle cue
/// alone, and as in the potential, places far from all cameras are drawn most.
pub fn nearest_angle_weights(field: &Field, candidates: &[DVec3], epsilon: f64) -> Vec<f64> {
    candidates
        .iter()
        .map(|p| field.u_conf(*p) + epsilon)
        .collect()
}

/// Returns the indices of `count` candidates, at most all: each in turn the one whose nearest
/// direction among `taken` and those before it is farthest; of equals the first (Gonzalez, 1985).
pub fn farthest_points(candidates: &[DVec3], taken: &[DVec3], count: usize) -> Vec<usize> {
    // The chord grows with the angle.
    let chord = |p: &DVec3, q: &DVec3| p.distance_squared(*q);
    let mut nearest: Vec<f64> = candidates
        .iter()
        .map(|p| taken.iter().map(|q| chord(p, q)).fold(4.0, f64::min))
        .collect();
    let mut chosen = Vec::new();
    for _ in 0..count.min(candidates.len()) {
        let mut farthest = 0;
        for (j, distance) in nearest.iter().enumerate() {
            if *distance > nearest[farthest] {
                farthest = j;
            }
        }
        chosen.push(farthest);
        for (p, distance) in candidates.iter().zip(&mut nearest) {
            *distance = distance.min(chord(p, &candidates[farthest]));
        }
        // Not again, even where all that are left coincide with others.
        nearest[farthest] = f64::NEG_INFINITY;
    }
    chosen
}

/// Places `count` viewpoints, each between two training cameras of a uniformly drawn pair, at a
/// uniform share `t` of the way: the direction turns at even pace along the great circle, the
/// distance from the focus changes linearly. If the directions are opposed, the arc leads over the
/// side that is up.
fn interpolate(
    train: &[Camera],
    focus: &Focus,
    field: &Field,
    count: usize,
    seed: u64,
) -> Result<Vec<Viewpoint>> {
    let n = train.len();
    if n < 2 {
        return Err(Error::usage(format!(
            "there is nothing to interpolate between: {n} training camera"
        ))
        .way_out("name more training views, or choose another views.strategy"));
    }
    let pairs: Vec<(usize, usize)> = (0..n)
        .flat_map(|i| (i + 1..n).map(move |j| (i, j)))
        .collect();
    let distance = |i: usize| train[i].center().distance(focus.center) / focus.radius;
    let up = mean_up(train);
    let mut rng = random(seed);
    Ok((0..count)
        .map(|_| {
            let (i, j) = pairs[(open_unit(&mut rng) * pairs.len() as f64) as usize];
            let t = open_unit(&mut rng);
            Viewpoint {
                direction: arc(field.directions[i], field.directions[j], t, up),
                distance: (1.0 - t) * distance(i) + t * distance(j),
            }
        })
        .collect())
}

/// Returns the unit direction at a share `t` of the arc from `a` to `b`, by way of `up` where the
/// two are opposed.
fn arc(a: DVec3, b: DVec3, t: f64, up: DVec3) -> DVec3 {
    let theta = angle(a, b);
    let across = |v: DVec3| v - a * a.dot(v);
    let sideways = [b, up]
        .into_iter()
        .map(across)
        .find(|v| v.length() > MIN_ARC_SINE)
        .map_or_else(|| a.any_orthonormal_vector(), DVec3::normalize);
    let (sin, cos) = (t * theta).sin_cos();
    (a * cos + sideways * sin).normalize()
}
