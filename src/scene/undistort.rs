//! This module turns images seen through a lens into images of a pinhole camera.

use glam::DVec2;
use image::{ImageBuffer, Pixel};

use super::lens::{Distortion, pinhole, shown};
use crate::camera::Camera;
use crate::error::Result;

/// The part of a fisheye photograph that its pinhole image shows.
pub(super) struct Cut {
    /// Angle across its width and height, degrees.
    pub angles: [f64; 2],
    /// The share of the photograph's area that is shown.
    pub shown: f64,
}

/// The map from a photograph by `camera` through its lens to one by `pinhole`.
pub(super) struct Undistortion {
    camera: Camera,
    distortion: Distortion,
    pub pinhole: Camera,
}

impl Undistortion {
    /// Makes the undistortion of photographs of the size that `camera` has.
    ///
    /// # Errors
    ///
    /// A distortion that cannot be undone.
    pub(crate) fn new(camera: Camera, distortion: Distortion) -> Result<Undistortion> {
        Ok(Undistortion {
            pinhole: pinhole(&camera, &distortion)?,
            camera,
            distortion,
        })
    }

    /// Returns what the pinhole image shows of the photograph.
    pub(crate) fn cut(&self) -> Cut {
        let Camera { fx, fy, cx, cy, .. } = self.pinhole;
        let angle = |side: u32, center: f64, focal: f64| {
            let ends = [-center, f64::from(side) - center];
            let [from, to] = ends.map(|end| (end / focal).atan());
            (to - from).to_degrees()
        };
        let (width, height) = (self.pinhole.width, self.pinhole.height);
        Cut {
            angles: [angle(width, cx, fx), angle(height, cy, fy)],
            shown: shown(&self.camera, &self.distortion, &self.pinhole),
        }
    }

    /// Resamples the photograph, or a mask of it at any resolution, with the cubic kernel of
    /// Catmull and Rom; beyond the image its border goes on.
    pub(crate) fn apply<P: Pixel<Subpixel = u8>>(
        &self,
        image: &ImageBuffer<P, Vec<u8>>,
    ) -> ImageBuffer<P, Vec<u8>> {
        let lens = self.camera.resized(image.width(), image.height());
        let Camera {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            ..
        } = self.pinhole;
        ImageBuffer::from_fn(width, height, |x, y| {
            let ray = DVec2::new(
                (f64::from(x) + 0.5 - cx) / fx,
                (f64::from(y) + 0.5 - cy) / fy,
            );
            let seen = self.distortion.distort(ray);
            sample(
                image,
                seen.x * lens.fx + lens.cx,
                seen.y * lens.fy + lens.cy,
            )
        })
    }
}

/// Interpolates the pixel at a point of an image of at most four channels; pixel centres lie at
/// +0.5.
fn sample<P: Pixel<Subpixel = u8>>(image: &ImageBuffer<P, Vec<u8>>, u: f64, v: f64) -> P {
    let (columns, x_weights) = taps(u, image.width());
    let (rows, y_weights) = taps(v, image.height());
    let mut sum = [0.0; 4];
    for (row, y_weight) in rows.into_iter().zip(y_weights) {
        for (column, x_weight) in columns.into_iter().zip(x_weights) {
            let weight = x_weight * y_weight;
            let channels = image.get_pixel(column, row).channels();
            for (sum, value) in sum.iter_mut().zip(channels) {
                *sum += weight * f64::from(*value);
            }
        }
    }
    let rounded = sum.map(|value| value.round().clamp(0.0, 255.0) as u8);
    *P::from_slice(&rounded[..usize::from(P::CHANNEL_COUNT)])
}

/// Returns the four pixels around a coordinate, kept within the image, and their weights.
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
