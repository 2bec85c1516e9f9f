//! This module finds pixels between two surfaces, and depths between the pixels of one.

use glam::DVec2;

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

/// Returns the depth between four pixels of one surface.
pub(super) fn interpolated(map: &DepthMap, place: DVec2) -> Option<f64> {
    let corner = place - DVec2::splat(0.5);
    if corner.x < 0.0 || corner.y < 0.0 {
        return None;
    }
    let (x, y) = (corner.x as usize, corner.y as usize);
    if x + 1 >= map.camera.width as usize || y + 1 >= map.camera.height as usize {
        return None;
    }
    let (s, t) = (corner.x - x as f64, corner.y - y as f64);
    let [a, b, c, d] = [
        map.at(x, y)?,
        map.at(x + 1, y)?,
        map.at(x, y + 1)?,
        map.at(x + 1, y + 1)?,
    ];
    if is_edge(map, x, y, a) {
        return None;
    }
    Some((1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * c + s * d))
}
