//! This module finds the normals of a depth map.

use glam::DVec3;

use super::DepthMap;
use super::edges::is_edge;

/// Returns for every pixel with a depth that is on no edge the normal of the surface, in the camera's axes
/// and on its side, by the depths of its four neighbours; row 0 on top. A pixel next to
/// one without a depth is an edge.
pub fn normals(map: &DepthMap) -> Vec<Option<DVec3>> {
    let (width, height) = (map.camera.width as usize, map.camera.height as usize);
    let point = |x: usize, y: usize| {
        let depth = map.at(x, y)?;
        let camera = &map.camera;
        let ray = DVec3::new(
            (x as f64 + 0.5 - camera.cx) / camera.fx,
            (y as f64 + 0.5 - camera.cy) / camera.fy,
            1.0,
        );
        Some(depth * ray)
    };
    let normal = |x: usize, y: usize| {
        let depth = map.at(x, y)?;
        if is_edge(map, x, y, depth) {
            return None;
        }
        let across = point((x + 1).min(width - 1), y)? - point(x.saturating_sub(1), y)?;
        let down = point(x, (y + 1).min(height - 1))? - point(x, y.saturating_sub(1))?;
        let normal = down.cross(across).try_normalize()?;
        let towards = normal.dot(point(x, y)?) <= 0.0;
        Some(if towards { normal } else { -normal })
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels.map(|(x, y)| normal(x, y)).collect()
}
