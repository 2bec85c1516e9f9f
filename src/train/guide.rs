//! Dropout may be guided by depth and density (Song et al. 2026, "D2GS", eqs. 1-3): Gaussians that
//! are near the camera and crowded are left out more often.
//!
//! With `d` the distance to the camera and `rho` the mean distance to the six nearest others, less
//! than zero so that crowded is more, both brought to [0, 1] over all Gaussians, and `t1`, `t2` the
//! tertiles of `d`, the share of the dropout's rate is
//!
//! ```text
//! P = w_depth (1 - d) + w_density rho,  times 1 up to t1, 0.7 up to t2, 0.3 beyond
//! ```
//!
//! The published program brings `rho` up to date at the start and every 500 iterations, and leaves
//! the opacity of the others as it is. So does this one, which does the same with the bounds and
//! tertiles of `d`; new Gaussians have their parent's `rho`.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::gaussians::mean_over_nearest;
use crate::render::{DropShare, ViewUniform};

/// Iterations between two looks at the Gaussians.
pub(super) const INTERVAL: u32 = 500;

const N_NEIGHBORS: usize = 6;

/// Least width of what is brought to [0, 1].
const MIN_SPAN: f64 = 1e-6;

/// Distances of the Gaussians from one camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Guide {
    nearest: f64,
    farthest: f64,
    tertiles: [f64; 2],
}

impl Guide {
    /// Makes the guide for a camera at `center`; `None` without Gaussians.
    pub fn of(center: DVec3, means: &[Vec3]) -> Option<Guide> {
        let distances = means.iter().map(|m| m.as_dvec3().distance(center));
        let mut distances: Vec<f64> = distances.collect();
        distances.sort_unstable_by(f64::total_cmp);
        let n = distances.len();
        // Between two Gaussians, so that rounding does not move either across.
        let after = |k: usize| {
            let next = distances.get(k + 1).unwrap_or(&distances[k]);
            0.5 * (distances[k] + next)
        };
        Some(Guide {
            nearest: *distances.first()?,
            farthest: *distances.last()?,
            tertiles: [after(n / 3), after(2 * n / 3)],
        })
    }

    /// Returns the camera's view under this guide, with the weights of depth and density.
    pub fn applied(&self, [depth, density]: [f64; 2], view: ViewUniform) -> ViewUniform {
        let per_distance = depth / (self.farthest - self.nearest).max(MIN_SPAN);
        let [near_layer, middle_layer] = self.tertiles;
        view.with_guided_dropout(DropShare {
            base: depth + per_distance * self.nearest,
            per_distance: -per_distance,
            per_density: density,
            near_layer,
            middle_layer,
        })
    }
}

/// Returns `rho` of every Gaussian, how crowded it is, in [0, 1].
pub fn density_scores(means: &[Vec3]) -> Vec<f32> {
    let spacings = mean_over_nearest(means, N_NEIGHBORS, f64::sqrt);
    let spacings: Vec<f64> = spacings.into_iter().map(|s| s.unwrap_or(0.0)).collect();
    let least = spacings.iter().copied().fold(f64::INFINITY, f64::min);
    let most = spacings.iter().copied().fold(0.0, f64::max);
    let span = (most - least).max(MIN_SPAN);
    let score = |s: &f64| ((most - s) / span) as f32;
    spacings.iter().map(score).collect()
}
