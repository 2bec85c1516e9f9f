//! This module places views among cameras that look outward.

use glam::{DMat3, DQuat};

use super::VirtualView;
use super::draw::{open_unit, random};
use super::place::typical_intrinsics;
use crate::camera::Camera;
use crate::config::Config;
use crate::error::Result;
use crate::field::{Focus, angle};

/// Optical axes farther apart are not turned into one another: the way between them is nobody's
/// view.
const MAX_TURN: f64 = 120.0 / 180.0 * std::f64::consts::PI;

/// Places so many views between training cameras, for layouts that look outward
/// ([`Outlook`](crate::field::Outlook)): each at a uniform share of the way between the cameras of
/// a uniformly drawn pair, the place on the line between them, the orientation on the shortest
/// turn. Pairs whose axes are over 120 degrees apart are left out as long as others remain; a lone
/// camera is a pair with itself.
///
/// `U_conf` is the angle to the nearest training camera's optical axis: directions about the focus
/// say nothing of what a view that looks away from it shows.
///
/// # Errors
/// No training camera to take the intrinsics from.
pub(super) fn among(
    train: &[Camera],
    focus: &Focus,
    count: usize,
    config: &Config,
) -> Result<Vec<VirtualView>> {
    let intrinsics = typical_intrinsics(train)?;
    let pairs = pairs(train);
    let turns: Vec<DQuat> = train
        .iter()
        .map(|camera| DQuat::from_mat3(&camera.rotation).normalize())
        .collect();
    let mut rng = random(config.seed);
    let views = (0..count).map(|k| {
        let (i, j) = pairs[(open_unit(&mut rng) * pairs.len() as f64) as usize];
        let t = open_unit(&mut rng);
        let eye = train[i].center().lerp(train[j].center(), t);
        let rotation = DMat3::from_quat(turns[i].slerp(turns[j], t).normalize());
        let camera = Camera {
            name: format!("virtual_{k:03}"),
            rotation,
            translation: -(rotation * eye),
            ..intrinsics.clone()
        };
        let axis = camera.forward();
        let angles = train.iter().map(|other| angle(axis, other.forward()));
        let u_conf = angles.fold(f64::INFINITY, f64::min);
        VirtualView {
            direction: (eye - focus.center).try_normalize().unwrap_or(axis),
            u_conf,
            alpha: super::place::alpha(u_conf, config),
            camera,
        }
    });
    Ok(views.collect())
}

/// Lists the pairs to interpolate between.
fn pairs(train: &[Camera]) -> Vec<(usize, usize)> {
    let n = train.len();
    let all: Vec<(usize, usize)> = (0..n)
        .flat_map(|i| (i + 1..n).map(move |j| (i, j)))
        .collect();
    let is_close =
        |(i, j): &(usize, usize)| angle(train[*i].forward(), train[*j].forward()) <= MAX_TURN;
    let close: Vec<(usize, usize)> = all.iter().copied().filter(is_close).collect();
    match (close.is_empty(), all.is_empty()) {
        (false, _) => close,
        (true, false) => all,
        (true, true) => vec![(0, 0)],
    }
}
