//! Point splatting, by looking at all points for each pixel.

use rayon::prelude::*;

use super::linalg::{Vec3, dot, sub};
use super::model::TwinCamera;

/// Returns the nearest point of every pixel, row-major: of the points that fall into it, the one of
/// smallest f32 depth, the lower index of equals.
pub fn nearest_points(points: &[Vec3], camera: &TwinCamera) -> Vec<Option<usize>> {
    // Depth and pixel.
    let places: Vec<(f32, [f64; 2])> = points
        .iter()
        .map(|point| {
            let p = camera.to_camera(point);
            let u = camera.fx * p[0] / p[2] + camera.cx;
            let v = camera.fy * p[1] / p[2] + camera.cy;
            let seen = p[2] > camera.near;
            let depth = if seen { p[2] as f32 } else { f32::INFINITY };
            (depth, [u.floor(), v.floor()])
        })
        .collect();
    (0..camera.width * camera.height)
        .into_par_iter()
        .map(|pixel| {
            let (x, y) = (pixel % camera.width, pixel / camera.width);
            let mut nearest: Option<(f32, usize)> = None;
            for (i, &(depth, place)) in places.iter().enumerate() {
                let is_here = place == [x as f64, y as f64];
                if is_here && depth < nearest.map_or(f32::INFINITY, |n| n.0) {
                    nearest = Some((depth, i));
                }
            }
            nearest.map(|n| n.1)
        })
        .collect()
}

/// Returns the radius, world, of every point's disc: that of a pixel of the nearest of the
/// `sources` at its distance, were there as many pixels as points.
pub fn source_radii(points: &[Vec3], sources: &[TwinCamera]) -> Vec<f64> {
    let n_pixels: usize = sources.iter().map(|c| c.width * c.height).sum();
    let pixels_a_point = n_pixels as f64 / points.len() as f64;
    let radius = |p: &Vec3| {
        let squared = sources.iter().map(|c| {
            let away = sub(p, &c.center());
            pixels_a_point * dot(&away, &away) / (c.fx * c.fy)
        });
        squared.fold(f64::INFINITY, f64::min).sqrt()
    };
    points.iter().map(radius).collect()
}

/// Returns the mean colour by weight, 0 to 255, of the discs at the front of every pixel,
/// row-major; `None` if there is no disc. `radii` are the discs', world, and `bounds` of them in
/// pixels; discs farther than `1 + tolerance` times the nearest, by f32 depth, are hidden.
pub fn blended(
    points: &[(Vec3, [u8; 3])],
    radii: &[f64],
    camera: &TwinCamera,
    bounds: [f64; 2],
    tolerance: f64,
) -> Vec<Option<[f64; 3]>> {
    let discs: Vec<(f64, [f64; 2], f64)> = points
        .iter()
        .zip(radii)
        .map(|((point, _), radius)| {
            let p = camera.to_camera(point);
            let seen = p[2] > camera.near;
            let depth = if seen { p[2] } else { f64::INFINITY };
            let place = [
                camera.cx + camera.fx * (p[0] / p[2]),
                camera.cy + camera.fy * (p[1] / p[2]),
            ];
            let size = radius * camera.fx.sqrt() * camera.fy.sqrt() / p[2];
            (
                f64::from(depth as f32),
                place,
                size.clamp(bounds[0], bounds[1]),
            )
        })
        .collect();
    (0..camera.width * camera.height)
        .into_par_iter()
        .map(|pixel| {
            let x = (pixel % camera.width) as f64 + 0.5;
            let y = (pixel / camera.width) as f64 + 0.5;
            // Squared distance in radii.
            let off = |(_, [u, v], radius): &(f64, [f64; 2], f64)| {
                ((x - u) / radius).powi(2) + ((y - v) / radius).powi(2)
            };
            let holding = |disc: &&(f64, [f64; 2], f64)| disc.0.is_finite() && off(disc) <= 1.0;
            let front = discs.iter().filter(holding).map(|disc| disc.0);
            let limit = front.fold(f64::INFINITY, f64::min) * (1.0 + tolerance);
            let mut sums = [0.0; 4];
            for (disc, (_, color)) in discs.iter().zip(points) {
                if holding(&disc) && disc.0 <= limit {
                    let weight = (1.0 - off(disc) / 2.0).powi(2);
                    for (sum, channel) in sums.iter_mut().zip(color) {
                        *sum += weight * f64::from(*channel);
                    }
                    sums[3] += weight;
                }
            }
            (sums[3] > 0.0).then(|| [0, 1, 2].map(|c| sums[c] / sums[3]))
        })
        .collect()
}

/// Applies the connectivity filter, pixel by pixel: a covered pixel stays where its window of
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
