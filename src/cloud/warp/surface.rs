//! The surface is the cloud's depth at the centre of every pixel of a view, between its points'.
//!
//! The discs at the front of a pixel ([`crate::cloud::splat`]) have a mean inverse depth `q` at a
//! mean place, both by their weights. Inverse depth is linear across the image of a plane. So the
//! surface at a pixel's centre is what the plane through the means in the window around it has
//! there, by least squares: exact for a plane, however the points lie on it, and of a noisy cloud the mean of
//! some 25 pixels' points. Means that lie off by more than `depth_tolerance` belong to another
//! surface and are left out.

use crate::camera::Camera;
use crate::cloud::splat::{Filter, Points, ZBuffer};
use crate::config::SplatConfig;

/// Pixels to each side of a pixel that its plane is fitted to.
const REACH: usize = 2;

/// Weights of the window's rows and columns by their distance from its middle.
const WINDOW: [f64; REACH + 1] = [6.0, 4.0, 1.0];

/// Square of a spread, pixels, which is added to that of the means' places: with one of them, or
/// some in a row, the plane is level across. Its share of the spread of a full window is 1e-4.
const LEVEL: f64 = 1e-4;

/// The cloud's surface in one view.
pub(super) struct Surface {
    /// Columns of pixels.
    pub width: usize,
    /// Inverse depth along the optical axis, canonical, row by row; 0 where no point is.
    pub inverse: Vec<f32>,
}

/// Buffers that a thread reuses from view to view.
#[derive(Default)]
pub(super) struct Scratch {
    z_buffer: ZBuffer,
    filter: Filter,
    /// Inverse depth, column and row times weight, and weight, of the discs at a pixel's front.
    sums: Vec<[f32; 4]>,
    /// Mean inverse depth, column and row; the first is 0 where no disc is.
    means: Vec<[f32; 3]>,
}

impl Surface {
    /// Finds the surface that `points` show to a canonical `camera`; nothing nearer than `near`.
    pub(super) fn of(
        points: &Points,
        camera: &Camera,
        config: &SplatConfig,
        near: f64,
        scratch: &mut Scratch,
    ) -> Surface {
        let Scratch {
            z_buffer,
            filter,
            sums,
            means,
        } = scratch;
        points.draw(camera, config, near, z_buffer);
        let n_pixels = z_buffer.winners().len();
        sums.clear();
        sums.resize(n_pixels, [0.0; 4]);
        let share = 1.0 + config.depth_tolerance;
        points.discs(camera, config.max_radius_px, near, |_, disc| {
            let [u, v] = disc.center().map(|c| c as f32);
            let inverse = 1.0 / disc.depth;
            disc.pixels(camera, |pixel, weight| {
                if z_buffer.is_front(pixel, disc.depth, share) {
                    let added = [weight * inverse, weight * u, weight * v, weight];
                    let sum = &mut sums[pixel];
                    *sum = std::array::from_fn(|i| sum[i] + added[i]);
                }
            });
        });
        means.clear();
        means.resize(n_pixels, [0.0; 3]);
        filter.kept(z_buffer, config, |pixel, _| {
            let [inverse, u, v, weight] = sums[pixel];
            means[pixel] = [inverse, u, v].map(|sum| sum / weight);
        });
        let width = camera.width as usize;
        let at = |pixel| plane_at(means, width, pixel, config.depth_tolerance);
        Surface {
            width,
            inverse: (0..n_pixels).map(at).collect(),
        }
    }
}

/// Returns the inverse depth at a pixel's centre of the plane that fits the means around it; 0 where
/// the pixel has none itself.
fn plane_at(means: &[[f32; 3]], width: usize, pixel: usize, tolerance: f64) -> f32 {
    let own = f64::from(means[pixel][0]);
    if own <= 0.0 {
        return 0.0;
    }
    let (x, y) = (pixel % width, pixel / width);
    let height = means.len() / width;
    let (center_x, center_y) = (x as f64 + 0.5, y as f64 + 0.5);
    // Weight, and sums of place and inverse depth, as differences from the pixel's.
    let (mut n, mut u, mut v, mut q) = (0.0, 0.0, 0.0, 0.0);
    let (mut uu, mut uv, mut vv, mut uq, mut vq) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for row in y.saturating_sub(REACH)..=(y + REACH).min(height - 1) {
        let by_row = WINDOW[row.abs_diff(y)];
        for column in x.saturating_sub(REACH)..=(x + REACH).min(width - 1) {
            let mean = means[row * width + column].map(f64::from);
            let off = mean[0] - own;
            if mean[0] > 0.0 && off.abs() <= tolerance * own {
                let weight = by_row * WINDOW[column.abs_diff(x)];
                let (du, dv) = (mean[1] - center_x, mean[2] - center_y);
                n += weight;
                u += weight * du;
                v += weight * dv;
                q += weight * off;
                uu += weight * du * du;
                uv += weight * du * dv;
                vv += weight * dv * dv;
                uq += weight * du * off;
                vq += weight * dv * off;
            }
        }
    }
    // The pixel itself is within, so that there is some weight.
    let [u, v, q, uu, uv, vv, uq, vq] = [u, v, q, uu, uv, vv, uq, vq].map(|sum| sum / n);
    let (uu, uv, vv) = (uu - u * u + LEVEL, uv - u * v, vv - v * v + LEVEL);
    let (uq, vq) = (uq - u * q, vq - v * q);
    let determinant = uu * vv - uv * uv;
    let slope = [
        (uq * vv - vq * uv) / determinant,
        (vq * uu - uq * uv) / determinant,
    ];
    let inverse = own + q - slope[0] * u - slope[1] * v;
    // A plane through few means can leave their range.
    inverse.clamp(own * (1.0 - tolerance), own * (1.0 + tolerance)) as f32
}
