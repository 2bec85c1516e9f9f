//! One frame's pose and intrinsics.

use std::path::Path;

use glam::{DMat3, DVec3};
use serde_json::Value;

use super::Object;
use crate::camera::nearest_rotation;
use crate::error::{Error, Result};
use crate::scene::layout::Intrinsics;

/// How far a pose's scale may be from 1: files hold few digits.
pub(super) const SCALE_TOLERANCE: f64 = 1e-3;

/// Camera models that are COLMAP's of the same name.
const MODELS: [&str; 5] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
];

/// World-to-camera rotation, optical centre, and the scale that the matrix has beside.
pub(super) fn pose(matrix: Option<&Value>) -> Result<(DMat3, DVec3, f64)> {
    let wrong = |what: &str| Error::new(format!("`transform_matrix` {what}"));
    let rows: Vec<Vec<f64>> = matrix
        .and_then(|m| serde_json::from_value(m.clone()).ok())
        .ok_or_else(|| wrong("is not given as rows of numbers"))?;
    let is_affine = rows.len() == 3 || (rows.len() == 4 && rows[3] == [0.0, 0.0, 0.0, 1.0]);
    if !is_affine || rows.iter().any(|row| row.len() != 4) {
        return Err(wrong(
            "has not 4 columns and 3 rows, or 4 of which the last is 0 0 0 1",
        ));
    }
    let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
    let (axes, position) = (DMat3::from_cols(column(0), column(1), column(2)), column(3));
    let determinant = axes.determinant();
    if determinant < 0.0 {
        return Err(wrong(
            "mirrors: it is not camera-to-world in a right-handed frame",
        ));
    }
    let scale = determinant.cbrt();
    let rotation = nearest_rotation(axes * (1.0 / scale))
        .filter(|_| position.is_finite())
        .ok_or_else(|| wrong("is no rigid motion"))?;
    // OpenGL's axes to ours: y down, z forward.
    let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)) * rotation.transpose();
    Ok((rotation, position, scale))
}

/// Where a frame's intrinsics are read from.
pub(super) struct Optics<'a> {
    pub frame: &'a Object,
    pub file: &'a Object,
}

impl Optics<'_> {
    fn value(&self, key: &str) -> Option<&Value> {
        let mut given = [self.frame, self.file]
            .into_iter()
            .filter_map(|o| o.get(key));
        given.find(|value| !value.is_null())
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        self.value(key)
            .map(|value| {
                value
                    .as_f64()
                    .ok_or_else(|| Error::new(format!("`{key}` is not a number")))
            })
            .transpose()
    }

    /// Width and height as stated, or else of the image; `None` where there is none.
    pub fn size(&self, image: &Path) -> Result<Option<[f64; 2]>> {
        if let (Some(w), Some(h)) = (self.number("w")?, self.number("h")?) {
            return Ok(Some([w, h]));
        }
        if !image.is_file() {
            return Ok(None);
        }
        let (w, h) = image::image_dimensions(image)
            .map_err(|e| Error::new(format!("cannot decode the image: {e}")).at_path(image))?;
        Ok(Some([f64::from(w), f64::from(h)]))
    }

    pub fn intrinsics(&self, size: [f64; 2]) -> Result<Intrinsics> {
        self.check_model()?;
        let fx = match self.number("fl_x")? {
            Some(fx) => fx,
            None => self
                .focal_from_angle("camera_angle_x", size[0])?
                .ok_or_else(|| Error::new("neither `fl_x` nor `camera_angle_x` is given"))?,
        };
        let fy = match self.number("fl_y")? {
            Some(fy) => fy,
            None => self
                .focal_from_angle("camera_angle_y", size[1])?
                .unwrap_or(fx),
        };
        let cx = self.number("cx")?.unwrap_or(0.5 * size[0]);
        let cy = self.number("cy")?.unwrap_or(0.5 * size[1]);
        let mut distortion = [0.0; 4];
        for (value, key) in distortion.iter_mut().zip(["k1", "k2", "p1", "p2"]) {
            *value = self.number(key)?.unwrap_or(0.0);
        }
        Intrinsics::new(size, [fx, fy, cx, cy], distortion)
    }

    fn focal_from_angle(&self, key: &str, side: f64) -> Result<Option<f64>> {
        match self.number(key)? {
            None => Ok(None),
            Some(angle) if angle > 0.0 && angle < std::f64::consts::PI => {
                Ok(Some(0.5 * side / (0.5 * angle).tan()))
            }
            Some(angle) => Err(Error::new(format!(
                "`{key}` is {angle}, but must be between 0 and pi"
            ))),
        }
    }

    fn check_model(&self) -> Result<()> {
        let unsupported = |what: String| {
            Err(Error::new(format!("{what} is not supported"))
                .way_out("undistort the images to pinhole cameras first"))
        };
        match self.value("camera_model") {
            None => {}
            Some(Value::String(model)) if MODELS.contains(&model.as_str()) => {}
            Some(model) => return unsupported(format!("camera model {model}")),
        }
        for key in ["is_fisheye", "latlong", "equirectangular", "orthographic"] {
            if self
                .value(key)
                .is_some_and(|value| *value != Value::Bool(false))
            {
                return unsupported(format!("`{key}`"));
            }
        }
        for key in ["k3", "k4", "k5", "k6"] {
            if self.number(key)?.is_some_and(|k| k != 0.0) {
                return unsupported(format!("distortion coefficient `{key}`"));
            }
        }
        for key in ["distortion_params", "ftheta_p0"] {
            if self.value(key).is_some() {
                return unsupported(format!("`{key}`"));
            }
        }
        Ok(())
    }
}
