//! Virtual views: directions drawn from the field, and the cameras that stand there.
//!
//! A strategy is a function that gives directions; [`place`] turns any directions into views.
//! The paper's strategy is a weighting of the candidate grid ([`potential_weights`]) and a draw
//! from it ([`draw_without_replacement`]).

mod place;
mod strategy;

pub use place::place;
pub use strategy::{draw_without_replacement, potential_weights};

use glam::DVec3;

use crate::camera::Camera;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::field::{Field, Focus, fibonacci_sphere};

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
