//! This module chooses viewpoints around the focus, and makes the cameras that stand there: the
//! virtual views.
//!
//! A [strategy](crate::config::Strategy) gives [`Viewpoint`]s; [`place`] turns any into views.
//! The paper's is a weighting of the candidate grid ([`potential_weights`]) and a draw from it
//! ([`draw_without_replacement`]).

mod among;
mod draw;
mod place;
mod strategy;

pub use draw::draw_without_replacement;
pub use place::{place, typical_intrinsics};
pub use strategy::{enough, farthest_points, nearest_angle_weights, potential_weights};

use glam::DVec3;

use crate::camera::Camera;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::field::{Field, Focus, Outlook, fibonacci_sphere};

/// A camera that no photograph was taken with; it looks at the focus unless the training cameras
/// look outward.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualView {
    /// World frame; named `virtual_000` onwards in the order of the choice.
    pub camera: Camera,
    /// Unit direction from the focus.
    pub direction: DVec3,
    /// `U_conf`, angle to the nearest training camera, radians.
    pub u_conf: f64,
    /// Supervision weight `alpha_k = 1 / (1 + U_conf)`, or 1 where confidence weighting is off.
    pub alpha: f64,
}

/// The place of a virtual camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Unit direction from the focus.
    pub direction: DVec3,
    /// Distance from the focus, in `R`.
    pub distance: f64,
}

impl Viewpoint {
    /// Returns the viewpoint on the sphere in a unit direction.
    pub fn on_sphere(direction: DVec3) -> Viewpoint {
        Viewpoint {
            direction,
            distance: 1.0,
        }
    }
}

/// Places a view in every candidate direction of the grid, in its order; where the training cameras
/// look outward ([`Outlook`]), as many views among them.
///
/// # Errors
/// No training camera to take the intrinsics from.
pub fn candidates(
    train: &[Camera],
    focus: &Focus,
    field: &Field,
    config: &Config,
) -> Result<Vec<VirtualView>> {
    if Outlook::of(train, focus).is_outward() {
        return among::among(train, focus, config.field.n_candidates, config);
    }
    let grid = fibonacci_sphere(config.field.n_candidates);
    let viewpoints: Vec<Viewpoint> = grid.into_iter().map(Viewpoint::on_sphere).collect();
    place(&viewpoints, train, focus, field, config)
}

/// Chooses the `K = config.views.count` virtual views once, by `config.views.strategy`; fewer
/// where `config.views.visibility` leaves fewer candidates. The paper's: candidates on a
/// Fibonacci sphere, drawn without replacement with probability `P_j = w_j / sum w`, `w = 1 /
/// (U_total + epsilon)`.
///
/// If the training cameras look outward, the candidates are views among them and are drawn with
/// equal weights, whatever the strategy: none that looks at the focus shows what they see.
///
/// `visible_shares`, of the [`candidates`] in their order, is what
/// `config.views.visibility` judges by; without it there is no such judgement.
///
/// # Errors
/// More views than candidates, no candidate left, weights that are not positive numbers, or
/// interpolation with a single training camera.
pub fn virtual_views(
    train: &[Camera],
    focus: &Focus,
    field: &Field,
    visible_shares: Option<&[f64]>,
    config: &Config,
) -> Result<Vec<VirtualView>> {
    let (count, n_candidates) = (config.views.count, config.field.n_candidates);
    if count > n_candidates {
        return Err(Error::usage(format!(
            "cannot draw {count} virtual views (views.count) from {n_candidates} candidates (field.n_candidates)",
        ))
        .way_out("lower the one or raise the other"));
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    if Outlook::of(train, focus).is_outward() {
        let candidates = candidates(train, focus, field, config)?;
        return strategy::drawn(candidates, visible_shares, config);
    }
    let viewpoints = strategy::choose(train, focus, field, visible_shares, config)?;
    place(&viewpoints, train, focus, field, config)
}
