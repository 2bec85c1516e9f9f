//! This module finds pixels between two surfaces.

use super::DepthMap;

/// Neighbouring depths that differ by more than this share are of two surfaces, unless a plane that
/// is seen at 80 degrees has such a slope there; the pixels between fly.
const EDGE: f64 = 0.02;
/// The tangent of 80 degrees.
const STEEPEST: f64 = 5.671;
/// Returns whether one of the four neighbours lies on another surface.
pub(super) fn is_edge(map: &DepthMap, x: usize, y: usize, depth: f64) -> bool {
    let last = (
        map.camera.width as usize - 1,
        map.camera.height as usize - 1,
    );
    let neighbours = [
        (x.saturating_sub(1), y),
        ((x + 1).min(last.0), y),
        (x, y.saturating_sub(1)),
        (x, (y + 1).min(last.1)),
    ];
    let step = EDGE + STEEPEST / map.camera.fx.min(map.camera.fy);
    neighbours.iter().any(|(x, y)| {
        map.at(*x, *y)
            .is_none_or(|other| (other - depth).abs() > step * depth.min(other))
    })
}
