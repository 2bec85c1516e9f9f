//! This module finds the pseudo-focus and the sphere around it.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};

use crate::camera::{Camera, Frame};
use crate::error::{Error, Result};
use crate::scene::PointCloud;

/// Optical axes whose directions spread less than this (root mean square, radians: 1 degree)
/// about their common axis do not fix the focus: noise in the poses would place it.
const MIN_AXIS_SPREAD: f64 = 0.0175;

/// Cameras nearer than this share of the cloud's median distance to the pseudo-focus share one
/// centre for our purpose: their sphere would lie inside the cameras, not around the scene.
const MIN_RADIUS_RATIO: f64 = 1e-3;

/// The sphere that virtual cameras lie on.
#[derive(Clone, Debug, PartialEq)]
pub struct Focus {
    /// Pseudo-focus `c`, world.
    pub center: DVec3,
    /// `R`, the greatest distance of a training camera from `c`, world units; positive.
    pub radius: f64,
    /// The scene's extent, world units; positive and at most `R`: `R`, or twice the median distance
    /// of the training cameras from `c` where that is less. No single camera decides it.
    ///
    /// Tolerances and planes that should fit what is photographed are shares of it and not of `R`,
    /// which one camera far away makes as large as it likes. If no camera is over twice as far as
    /// the median one, the two are the same number. The median is the lower of two, without cameras
    /// that are a thousand times nearer than the upper of two: they stand at `c` itself and have no
    /// distance.
    pub extent: f64,
    /// For the log: why `c` is not the paper's, and what it is instead.
    pub fallback: Option<String>,
}

impl Focus {
    /// Finds the paper's pseudo-focus, `c = argmin_x sum_i |(x - o_i) x d_i|^2` (Eq. 1), with `R =
    /// max_i |o_i - c|`.
    ///
    /// If the optical axes do not fix `c` (one camera, nearly parallel or opposed axes) or
    /// meet in the cameras' common centre, `c` is instead the confidence-weighted median of the
    /// cloud along the mean axis, and `fallback` says so.
    ///
    /// # Errors
    /// No camera, a pose that is not finite, or a layout that leaves no sphere: no cloud point
    /// in front of a camera, or cameras that share one centre and look everywhere.
    pub fn find(cameras: &[Camera], cloud: &PointCloud) -> Result<Focus> {
        if cameras.is_empty() {
            return Err(Error::new("no training camera to find the focus with"));
        }
        if let Some(bad) = cameras
            .iter()
            .find(|c| !(c.center().is_finite() && c.forward().is_finite()))
        {
            return Err(Error::new("the camera's pose is not finite").at(&bad.name));
        }
        let n = cameras.len() as f64;
        // Relative to the mean centre, so that nothing is lost far from the world's origin.
        let origin = cameras.iter().map(|c| c.center() / n).sum::<DVec3>();
        let mut a = DMat3::ZERO;
        let mut b = DVec3::ZERO;
        for camera in cameras {
            let d = camera.forward().normalize();
            let projector = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
            a += projector * (1.0 / n);
            b += projector * (camera.center() - origin) / n;
        }
        let eigen = SymmetricEigen::new(Matrix3::from_fn(|r, c| a.col(c)[r]));
        let weakest = eigen.eigenvalues.imin();
        let direction = |i: usize| {
            let v = eigen.eigenvectors.column(i);
            DVec3::new(v[0], v[1], v[2])
        };
        // The smallest eigenvalue is the mean squared sine of the angles between the optical
        // axes and the line that they have in common.
        let spread = eigen.eigenvalues[weakest].max(0.0).sqrt();
        if spread < MIN_AXIS_SPREAD {
            let why = if cameras.len() == 1 {
                "one camera".to_owned()
            } else {
                format!(
                    "the optical axes are parallel within {:.2} degrees",
                    spread.to_degrees()
                )
            };
            let axis = direction(weakest);
            let ahead: f64 = cameras.iter().map(|c| c.forward().dot(axis)).sum();
            return along_axis(cameras, cloud, origin, axis * ahead.signum(), &why);
        }
        let offset: DVec3 = (0..3)
            .map(|i| direction(i) * (direction(i).dot(b) / eigen.eigenvalues[i]))
            .sum();
        let center = origin + offset;
        let radius = greatest_distance(cameras, center);
        let mut depths: Vec<f64> = cloud.positions.iter().map(|p| p.distance(center)).collect();
        let extent = median(&mut depths).unwrap_or(0.0);
        if radius <= MIN_RADIUS_RATIO * extent {
            let axis: DVec3 = cameras.iter().map(|c| c.forward() / n).sum();
            if axis.length() < MIN_AXIS_SPREAD {
                return Err(Error::new(format!(
                    "the {} training cameras share one centre and look in all directions, so no sphere lies around what they see",
                    cameras.len()
                ))
                .way_out("choose training views from different places"));
            }
            return along_axis(
                cameras,
                cloud,
                origin,
                axis.normalize(),
                "the optical axes meet in the cameras themselves",
            );
        }
        Focus {
            center,
            radius,
            extent: robust_extent(cameras, center, radius),
            fallback: None,
        }
        .checked()
    }

    /// Returns the canonical frame: focus at the origin, sphere of radius 1.
    pub fn frame(&self) -> Frame {
        Frame {
            center: self.center,
            radius: self.radius,
            extent: self.extent,
        }
    }

    fn checked(self) -> Result<Focus> {
        if self.center.is_finite() && self.radius.is_finite() && self.radius > 0.0 {
            return Ok(self);
        }
        Err(Error::new(format!(
            "the training cameras leave no sphere: focus {}, radius {}",
            self.center, self.radius
        ))
        .way_out("choose training views from different places"))
    }
}

/// Finds the fallback focus: on the line through `origin` along `axis`, at the weighted median of
/// the cloud points that some camera has in front of it.
fn along_axis(
    cameras: &[Camera],
    cloud: &PointCloud,
    origin: DVec3,
    axis: DVec3,
    why: &str,
) -> Result<Focus> {
    let mut depths: Vec<(f64, f64)> = cloud
        .positions
        .iter()
        .enumerate()
        .filter(|(_, p)| {
            cameras
                .iter()
                .any(|c| c.forward().dot(**p - c.center()) > 0.0)
        })
        .map(|(i, p)| {
            let weight = cloud
                .confidence
                .as_ref()
                .and_then(|c| c.get(i))
                .map_or(1.0, |&w| f64::from(w));
            (axis.dot(*p - origin), weight)
        })
        .collect();
    let depth = weighted_median(&mut depths).ok_or_else(|| {
        Error::new(format!(
            "{why}, and no cloud point lies in front of a camera: nothing fixes the focus"
        ))
        .way_out("choose views whose axes cross, or check that cloud and poses share one frame")
    })?;
    let center = origin + axis * depth;
    let radius = greatest_distance(cameras, center);
    Focus {
        center,
        radius,
        extent: robust_extent(cameras, center, radius),
        fallback: Some(format!(
            "{why}: the focus is the cloud's weighted median along the mean axis"
        )),
    }
    .checked()
}

fn greatest_distance(cameras: &[Camera], center: DVec3) -> f64 {
    cameras
        .iter()
        .map(|c| c.center().distance(center))
        .fold(0.0, f64::max)
}

/// Computes [`Focus::extent`].
fn robust_extent(cameras: &[Camera], center: DVec3, radius: f64) -> f64 {
    let mut distances: Vec<f64> = cameras
        .iter()
        .map(|c| c.center().distance(center))
        .collect();
    let typical = median(&mut distances).unwrap_or(radius);
    distances.retain(|distance| *distance > MIN_RADIUS_RATIO * typical);
    distances.sort_unstable_by(f64::total_cmp);
    let lower = distances.len().saturating_sub(1) / 2;
    distances.get(lower).map_or(radius, |d| radius.min(2.0 * d))
}

/// Returns the median (the upper one of two), or `None` for no value.
fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Returns the first value at which half of the weight is reached. Weights that are negative or not
/// finite count as none; where all are none, each counts the same.
fn weighted_median(values: &mut [(f64, f64)]) -> Option<f64> {
    for (_, weight) in values.iter_mut() {
        if !(weight.is_finite() && *weight > 0.0) {
            *weight = 0.0;
        }
    }
    if values.iter().all(|v| v.1 == 0.0) {
        values.iter_mut().for_each(|v| v.1 = 1.0);
    }
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let half = 0.5 * values.iter().map(|v| v.1).sum::<f64>();
    let mut reached = 0.0;
    values
        .iter()
        .find(|v| {
            reached += v.1;
            reached >= half
        })
        .map(|v| v.0)
}
