//! This module places cameras at chosen viewpoints.

use glam::DVec3;

use super::{Viewpoint, VirtualView};
use crate::camera::Camera;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::field::{Field, Focus, angle};

/// Within this angle of straight above or below, the mean up direction turns too fast to use.
const POLE: f64 = 10.0 / 180.0 * std::f64::consts::PI;

/// Places virtual views at the given viewpoints, looking at the focus.
///
/// # Errors
/// No training camera to take the intrinsics from.
pub fn place(
    viewpoints: &[Viewpoint],
    train: &[Camera],
    focus: &Focus,
    field: &Field,
    config: &Config,
) -> Result<Vec<VirtualView>> {
    let intrinsics = typical_intrinsics(train)?;
    let mean_up = mean_up(train);
    let views = viewpoints.iter().enumerate().map(|(k, viewpoint)| {
        let direction = viewpoint.direction;
        let nearest = &train[field.nearest(direction)];
        let up = choose_up(direction, mean_up, nearest);
        let eye = focus.center + focus.radius * viewpoint.distance * direction;
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
            alpha: alpha(u_conf, config),
        }
    });
    Ok(views.collect())
}

/// Returns the supervision weight of a view.
pub(super) fn alpha(u_conf: f64, config: &Config) -> f64 {
    if config.loss.confidence_weighting {
        1.0 / (1.0 + u_conf)
    } else {
        1.0
    }
}

/// Returns the mean of the cameras' up directions; short where they cancel out.
pub(super) fn mean_up(train: &[Camera]) -> DVec3 {
    train.iter().map(Camera::up).sum::<DVec3>() / train.len() as f64
}

/// Returns the most common training image size (the first of equals), the median focal lengths
/// among the cameras that have it, and a centred principal point.
///
/// # Errors
/// No camera.
pub fn typical_intrinsics(train: &[Camera]) -> Result<Camera> {
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

/// Decides which way is up in a view along `direction`: the mean camera up; near its poles, or
/// where the ups cancel out, the nearest training camera's up; where that camera itself looks
/// across the sphere, its viewing direction, which cannot then be parallel too.
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
