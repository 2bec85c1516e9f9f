//! This module places pseudo cameras: on an ellipse through the training cameras that look at the focus.
//!
//! The ellipse is level and lies about the focus, along the directions in which the training cameras spread most
//! and least. Its half axes are the 90th percentiles of their distances from the focus along both, and a
//! camera's height is that of their mean and, by a tenth of what they differ, above or below it (Mip-NeRF 360's
//! rendering path, as CoR-GS takes it; there it lies in the plane that fits the cameras best). A full
//! turn is taken around cameras that spread over an arc, too.

use std::f64::consts::TAU;

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::camera::Camera;
use crate::camera::compass::Compass;
use crate::error::Result;
use crate::views::typical_intrinsics;

/// Random stream of the pseudo cameras' places.
const STREAM: u64 = 0x7073_6575;

/// Half axes are at least this share of the longer one: cameras on a short arc would else have pseudo cameras within the
/// scene.
const MIN_RATIO: f64 = 0.5;

/// Half axes are at least this share of the cameras' height above the focus, so that no pseudo camera looks straight down.
const MIN_SLOPE: f64 = 0.2;

/// Share of the cameras' heights that pseudo cameras differ by.
const HEIGHT_SHARE: f64 = 0.1;

/// The ellipse, in the canonical frame.
#[derive(Clone, Debug)]
pub struct Ellipse {
    /// Half axes, in `R`.
    pub axes: [DVec3; 2],
    /// Mean height of the training cameras above the focus, in `R`.
    pub height: f64,
    /// The least and the greatest height beyond it, in `R`.
    pub rise: [f64; 2],
    /// Unit vector.
    up: DVec3,
    intrinsics: Camera,
}

impl Ellipse {
    /// Lays the ellipse through `cameras`, canonical frame.
    ///
    /// # Errors
    /// No camera, or none that says which way is up.
    pub fn through(cameras: &[Camera]) -> Result<Ellipse> {
        let up = Compass::of_cameras(cameras, DVec3::ZERO)?.up();
        let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
        let n = centers.len() as f64;
        let mean = centers.iter().sum::<DVec3>() / n;
        let x = up.any_orthonormal_vector();
        let y = up.cross(x);
        // The greatest spread about the mean is at half the angle of this doubled one.
        let (mut even, mut odd) = (0.0, 0.0);
        for offset in centers.iter().map(|c| c - mean) {
            let (a, b) = (offset.dot(x), offset.dot(y));
            even += a * a - b * b;
            odd += 2.0 * a * b;
        }
        let angle = 0.5 * f64::atan2(odd, even);
        let along = angle.cos() * x + angle.sin() * y;
        let across = up.cross(along);
        let reach = |axis: DVec3| percentile(centers.iter().map(|c| c.dot(axis).abs()), 0.9);
        let reaches = [reach(along), reach(across)];
        let height = mean.dot(up);
        let least = (MIN_RATIO * reaches[0].max(reaches[1])).max(MIN_SLOPE * height.abs());
        let rise =
            |share| HEIGHT_SHARE * percentile(centers.iter().map(|c| (c - mean).dot(up)), share);
        Ok(Ellipse {
            axes: [
                reaches[0].max(least) * along,
                reaches[1].max(least) * across,
            ],
            height,
            rise: [rise(0.1), rise(0.9)],
            up,
            intrinsics: typical_intrinsics(cameras)?,
        })
    }

    /// Returns the pseudo camera of iteration `iteration` (from 0): anywhere on the ellipse, by its angle.
    pub fn camera(&self, seed: u64, iteration: u32) -> Camera {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(STREAM << 32 | u64::from(iteration));
        self.at(TAU * f64::from(rng.next_u32()) / 2_f64.powi(32))
    }

    /// Returns the camera at an angle of the ellipse, radians.
    pub fn at(&self, angle: f64) -> Camera {
        let [low, high] = self.rise;
        let rise = low + (high - low) * (0.5 + 0.5 * angle.cos());
        let level = angle.cos() * self.axes[0] + angle.sin() * self.axes[1];
        let eye = level + (self.height + rise) * self.up;
        self.intrinsics
            .looking_at("pseudo".to_owned(), eye, DVec3::ZERO, self.up)
    }
}

/// Returns the value at `share` of the way through the sorted values, between two of them in proportion; there is one at
/// least.
fn percentile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    let at = share * (values.len() - 1) as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    values[low] + (at - at.floor()) * (values[high] - values[low])
}
