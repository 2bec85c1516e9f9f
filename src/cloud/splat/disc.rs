//! This module decides what a point covers as a disc, and how the discs at the front blend.

use super::{Points, ZBuffer};
use crate::camera::Camera;
use crate::config::{MIN_DISC_RADIUS_PX, SplatConfig};

/// A point's disc in an image, parallel to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Disc {
    /// Pixels.
    center: [f64; 2],
    /// Pixels.
    radius: f64,
    /// Along the optical axis, canonical.
    pub depth: f32,
}

impl Disc {
    /// Returns a disc whose radius, in pixels, is bounded by [`MIN_DISC_RADIUS_PX`] and
    /// `max_radius_px`.
    pub(crate) fn new(center: [f64; 2], depth: f64, radius_px: f64, max_radius_px: f64) -> Disc {
        Disc {
            center,
            radius: radius_px.max(MIN_DISC_RADIUS_PX).min(max_radius_px),
            depth: depth as f32,
        }
    }

    /// Returns the place of its middle, pixels.
    pub(crate) fn center(&self) -> [f64; 2] {
        self.center
    }

    /// Visits the pixels of `camera`'s image whose centres lie within the disc, row by row, with
    /// the weight of the point there, `(1 - d^2 / (2 r^2))^2` at the distance `d`: 1 in the middle,
    /// a quarter on the rim.
    pub(crate) fn pixels(&self, camera: &Camera, mut visit: impl FnMut(usize, f32)) {
        let Disc { center, radius, .. } = *self;
        let [columns, rows] = [(center[0], camera.width), (center[1], camera.height)]
            .map(|(middle, limit)| span(middle, radius, limit));
        let squared = radius * radius;
        for y in rows {
            let dy = y as f64 + 0.5 - center[1];
            for x in columns.clone() {
                let dx = x as f64 + 0.5 - center[0];
                let distance = dx * dx + dy * dy;
                if distance <= squared {
                    let fall = 1.0 - 0.5 * distance / squared;
                    visit(y * camera.width as usize + x, (fall * fall) as f32);
                }
            }
        }
    }
}

/// Returns the pixels of `limit` in a row whose centres lie within `reach` of `middle`; none where
/// it is NaN.
fn span(middle: f64, reach: f64, limit: u32) -> std::ops::Range<usize> {
    let (low, high) = (middle - reach - 0.5, middle + reach - 0.5);
    // Casts cut off what is behind the point, saturate, and make 0 of NaN. `ceil` and `floor` would be calls, one a disc.
    let whole = low as usize;
    let first = whole + usize::from((whole as f64) < low);
    let end = match high >= 0.0 {
        true => (high as usize).saturating_add(1).min(limit as usize),
        false => 0,
    };
    first..end
}

/// The blend of the discs at the front of every pixel.
#[derive(Default)]
pub(crate) struct Blend {
    /// Red, green and blue times weight, and weight.
    sums: Vec<[f32; 4]>,
}

impl Blend {
    /// Sums the colours of the discs that hold a pixel and lie at most `config.depth_tolerance` of
    /// its front's depth behind it: the second pass over what [`Points::draw`] left in `z_buffer`.
    pub(crate) fn sum(
        &mut self,
        (points, colors): (&Points, &[[u8; 3]]),
        camera: &Camera,
        config: &SplatConfig,
        near: f64,
        z_buffer: &ZBuffer,
    ) {
        self.sums.clear();
        self.sums.resize(z_buffer.winners().len(), [0.0; 4]);
        let share = 1.0 + config.depth_tolerance;
        points.discs(camera, config.max_radius_px, near, |point, disc| {
            let [r, g, b] = colors[point].map(f32::from);
            disc.pixels(camera, |pixel, weight| {
                if z_buffer.is_front(pixel, disc.depth, share) {
                    let sum = &mut self.sums[pixel];
                    let added = [weight * r, weight * g, weight * b, weight];
                    *sum = std::array::from_fn(|i| sum[i] + added[i]);
                }
            });
        });
    }

    /// Returns the colour of a pixel that some disc holds: the mean by weight, rounded.
    pub(crate) fn color(&self, pixel: usize) -> [u8; 3] {
        let [r, g, b, weight] = self.sums[pixel];
        [r, g, b].map(|sum| (sum / weight).round() as u8)
    }
}
