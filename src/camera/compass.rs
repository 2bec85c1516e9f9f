//! Azimuth and elevation about the focus, as someone who walks around the scene would say it.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;

use crate::camera::Camera;
use crate::error::{Error, Result};

/// Directions about the focus as angles. Azimuth 0 is at the front; it grows to the right of
/// someone who stands there and looks at the focus, which is anticlockwise seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compass {
    /// Front, a quarter turn to the right of it, up; orthonormal.
    axes: [DVec3; 3],
}

impl Compass {
    /// Builds the compass from an `up` and a `front` of any length. Only the level part of `front`
    /// counts; if it points straight up or down, any level direction is the front.
    ///
    /// # Errors
    /// `up` has no direction.
    pub fn new(up: DVec3, front: DVec3) -> Result<Compass> {
        let Some(up) = up.try_normalize() else {
            return Err(Error::new("nothing says which way is up"));
        };
        let level = front.reject_from_normalized(up);
        let front = if level.length() > 1e-6 * front.length() {
            level.normalize()
        } else {
            up.any_orthonormal_vector()
        };
        Ok(Compass {
            axes: [front, up.cross(front), up],
        })
    }

    /// Builds the compass of a set of cameras: up is their mean up, and the front is where the
    /// first of them stands. If their ups cancel out, the up of the first counts.
    ///
    /// # Errors
    /// There is no camera.
    pub fn of_cameras(cameras: &[Camera], focus: DVec3) -> Result<Compass> {
        let Some(first) = cameras.first() else {
            return Err(Error::new("no training camera says which way is up"));
        };
        let mean_up = cameras.iter().map(Camera::up).sum::<DVec3>() / cameras.len() as f64;
        let up = if mean_up.length() > 0.1 {
            mean_up
        } else {
            first.up()
        };
        Compass::new(up, first.center() - focus)
    }

    /// Returns azimuth in (-180, 180] and elevation in [-90, 90] of a unit direction, degrees.
    pub fn angles(&self, direction: DVec3) -> (f64, f64) {
        let [x, y, z] = self.local(direction).to_array();
        (
            y.atan2(x).to_degrees(),
            z.clamp(-1.0, 1.0).asin().to_degrees(),
        )
    }

    /// Returns the unit direction at an azimuth and an elevation, degrees.
    pub fn direction(&self, azimuth: f64, elevation: f64) -> DVec3 {
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let (height, level) = elevation.to_radians().sin_cos();
        (self.axes[0] * cos + self.axes[1] * sin) * level + self.axes[2] * height
    }

    /// Returns the components along front, right and up.
    pub fn local(&self, direction: DVec3) -> DVec3 {
        DVec3::from_array(self.axes.map(|axis| axis.dot(direction)))
    }

    /// Returns the unit up direction, in the frame of the cameras.
    pub fn up(&self) -> DVec3 {
        self.axes[2]
    }

    /// Returns unit directions in the middles of the cells of an equirectangular map: rows from the
    /// zenith down, columns from azimuth -180 upwards, twice as many as rows.
    pub fn grid(&self, n_rows: usize) -> Vec<DVec3> {
        let step = PI / n_rows as f64;
        let cells = (0..n_rows).flat_map(|row| (0..2 * n_rows).map(move |column| (row, column)));
        let angles = cells.map(|(row, column)| {
            (
                (column as f64 + 0.5) * step - 0.5 * TAU,
                FRAC_PI_2 - (row as f64 + 0.5) * step,
            )
        });
        angles
            .map(|(azimuth, elevation)| {
                self.direction(azimuth.to_degrees(), elevation.to_degrees())
            })
            .collect()
    }
}
