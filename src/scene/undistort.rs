//! Images seen through a lens to images of a pinhole camera.

use glam::DVec2;
use image::{Rgb, RgbImage};

use super::lens::Distortion;
use crate::camera::Camera;

/// Resamples `image`, taken by `camera` through `distortion`, as `pinhole` sees it, with the
/// cubic kernel of Catmull and Rom; beyond the photograph its border goes on.
pub(super) fn undistort(
    image: &RgbImage,
    camera: &Camera,
    distortion: &Distortion,
    pinhole: &Camera,
) -> RgbImage {
    RgbImage::from_fn(pinhole.width, pinhole.height, |x, y| {
        let ray = DVec2::new(
            (f64::from(x) + 0.5 - pinhole.cx) / pinhole.fx,
            (f64::from(y) + 0.5 - pinhole.cy) / pinhole.fy,
        );
        let seen = distortion.distort(ray);
        sample(
            image,
            seen.x * camera.fx + camera.cx,
            seen.y * camera.fy + camera.cy,
        )
    })
}

/// The colour at a point, in pixels; pixel centres lie at +0.5.
fn sample(image: &RgbImage, u: f64, v: f64) -> Rgb<u8> {
    let (columns, x_weights) = taps(u, image.width());
    let (rows, y_weights) = taps(v, image.height());
    let mut sum = [0.0; 3];
    for (row, y_weight) in rows.into_iter().zip(y_weights) {
        for (column, x_weight) in columns.into_iter().zip(x_weights) {
            let weight = x_weight * y_weight;
            for (sum, value) in sum.iter_mut().zip(image.get_pixel(column, row).0) {
                *sum += weight * f64::from(value);
            }
        }
    }
    Rgb(sum.map(|value| value.round().clamp(0.0, 255.0) as u8))
}

/// The four pixels around a coordinate, kept within the image, and their weights.
fn taps(at: f64, size: u32) -> ([u32; 4], [f64; 4]) {
    let last = f64::from(size) - 1.0;
    let at = (at - 0.5).clamp(0.0, last);
    let first = at.floor();
    let t = at - first;
    let pixel = |offset: f64| (first + offset).clamp(0.0, last) as u32;
    let weights = [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (-2.5 + 1.5 * t),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (-0.5 + 0.5 * t),
    ];
    ([pixel(-1.0), pixel(0.0), pixel(1.0), pixel(2.0)], weights)
}
