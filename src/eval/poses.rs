//! This module measures errors of poses when the true ones are known.

use crate::camera::{Camera, Frame, Motion};
use crate::scene::PointCloud;

/// Means over cameras of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseErrors {
    /// Angle between the true and the other rotation, degrees.
    pub turn_deg: f64,
    /// How far the optical centre is off, in shares of the sphere's radius.
    pub shift: f64,
    /// Distance between a point's pixel in the true camera's image and in the other's, over the
    /// cloud's points in the former. A small turn and a small shift across the axis move the image
    /// alike, so that both may be wrong where this is right.
    pub pixels: f64,
}

impl PoseErrors {
    /// Compares `cameras`, which show `cloud`, with the `true` ones, one by one.
    pub fn of(
        cameras: &[Camera],
        truth: &[Camera],
        cloud: &PointCloud,
        frame: &Frame,
    ) -> PoseErrors {
        let n = truth.len() as f64;
        let mut sums = [0.0; 3];
        for (camera, truth) in cameras.iter().zip(truth) {
            let Motion { turn, shift } = camera.difference(truth);
            sums[0] += turn.to_degrees();
            sums[1] += shift / frame.radius;
            sums[2] += pixels_apart(camera, truth, cloud);
        }
        let [turn_deg, shift, pixels] = sums.map(|sum| sum / n);
        PoseErrors {
            turn_deg,
            shift,
            pixels,
        }
    }
}

fn pixels_apart(camera: &Camera, truth: &Camera, cloud: &PointCloud) -> f64 {
    let size = [truth.width, truth.height].map(f64::from);
    let (mut sum, mut n) = (0.0, 0u32);
    for &point in &cloud.positions {
        let (there, depth) = truth.project(point);
        let (here, other_depth) = camera.project(point);
        let inside = (0.0..size[0]).contains(&there.x) && (0.0..size[1]).contains(&there.y);
        if inside && depth > 0.0 && other_depth > 0.0 {
            sum += here.distance(there);
            n += 1;
        }
    }
    sum / f64::from(n)
}
