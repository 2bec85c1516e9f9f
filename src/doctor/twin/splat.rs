//! Point splatting by looking at all points for each pixel.

use rayon::prelude::*;

use super::linalg::Vec3;
use super::model::TwinCamera;

/// The nearest point of every pixel, row-major: of the points whose square of `size_px` pixels
/// holds the pixel, the one of smallest f32 depth, the lower index of equals.
pub fn nearest_points(points: &[Vec3], camera: &TwinCamera, size_px: usize) -> Vec<Option<usize>> {
    // Depth and the square's first pixel.
    let squares: Vec<(f32, [f64; 2])> = points
        .iter()
        .map(|point| {
            let p = camera.to_camera(point);
            let reach = 0.5 * (size_px as f64 - 1.0);
            let u = camera.fx * p[0] / p[2] + camera.cx - reach;
            let v = camera.fy * p[1] / p[2] + camera.cy - reach;
            let seen = p[2] > camera.near;
            let depth = if seen { p[2] as f32 } else { f32::INFINITY };
            (depth, [u.floor(), v.floor()])
        })
        .collect();
    let holds =
        |first: f64, pixel: usize| (first..first + size_px as f64).contains(&(pixel as f64));
    (0..camera.width * camera.height)
        .into_par_iter()
        .map(|pixel| {
            let (x, y) = (pixel % camera.width, pixel / camera.width);
            let mut nearest: Option<(f32, usize)> = None;
            for (i, &(depth, [left, top])) in squares.iter().enumerate() {
                if depth < nearest.map_or(f32::INFINITY, |n| n.0) && holds(left, x) && holds(top, y)
                {
                    nearest = Some((depth, i));
                }
            }
            nearest.map(|n| n.1)
        })
        .collect()
}

/// The connectivity filter, pixel by pixel: a covered pixel stays where its window of
/// `window` by `window` pixels has at least `min` other covered ones.
pub fn filtered(mask: &[bool], width: usize, window: usize, min: usize) -> Vec<bool> {
    let (reach, height) = ((window / 2) as isize, mask.len() / width);
    let at = |x: isize, y: isize| {
        (0..width as isize).contains(&x)
            && (0..height as isize).contains(&y)
            && mask[y as usize * width + x as usize]
    };
    (0..mask.len() as isize)
        .map(|i| {
            let (x, y) = (i % width as isize, i / width as isize);
            let mut neighbors = 0;
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    neighbors += usize::from((dx, dy) != (0, 0) && at(x + dx, y + dy));
                }
            }
            at(x, y) && neighbors >= min
        })
        .collect()
}
