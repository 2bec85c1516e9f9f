//! This module reads one frame's pose and intrinsics.

use glam::{DMat3, DVec3};
use serde_json::Value;

use super::Object;
use super::nan::is_not_finite;
use crate::camera::nearest_rotation;
use crate::error::{Error, Result};
use crate::scene::layout::Intrinsics;
use crate::scene::lens::Distortion;

/// How far a pose's scale may be from 1: files hold few digits.
pub(super) const SCALE_TOLERANCE: f64 = 1e-3;

/// How far each entry of the last row may be from 0 0 0 1: matrices are inverted and printed in
/// single precision.
const LAST_ROW_TOLERANCE: f64 = 1e-5;

/// Camera models without and with a fisheye lens; the others are COLMAP's of the same name.
const MODELS: [&str; 5] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
];
const FISHEYE_MODELS: [&str; 4] = [
    "OPENCV_FISHEYE",
    "FISHEYE",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
];

/// The pose that a `transform_matrix` states.
pub(super) struct Pose {
    /// World to camera.
    pub rotation: DMat3,
    /// The optical centre.
    pub position: DVec3,
    /// The scale that the matrix has beside the rotation.
    pub scale: f64,
}

/// Returns the pose of a frame; `None` if it has no pose, or one that is not finite.
pub(super) fn pose(matrix: Option<&Value>) -> Result<Option<Pose>> {
    let wrong = |what: &str| Error::new(format!("`transform_matrix` {what}"));
    let Some(matrix) = matrix.filter(|m| !m.is_null()) else {
        return Ok(None);
    };
    let rows = matrix.as_array().into_iter().flatten();
    if rows
        .filter_map(Value::as_array)
        .flatten()
        .any(is_not_finite)
    {
        return Ok(None);
    }
    let rows: Vec<Vec<f64>> = serde_json::from_value(matrix.clone())
        .map_err(|_| wrong("is not given as rows of numbers"))?;
    let is_last = |row: &[f64]| {
        let expected = [0.0, 0.0, 0.0, 1.0];
        let near = |(a, b): (&f64, f64)| (a - b).abs() <= LAST_ROW_TOLERANCE;
        row.len() == 4 && row.iter().zip(expected).all(near)
    };
    let is_affine = rows.len() == 3 || (rows.len() == 4 && is_last(&rows[3]));
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
        .ok_or_else(|| wrong("is not a rigid motion"))?;
    // OpenGL's axes to ours: y down, z forward.
    let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)) * rotation.transpose();
    Ok(Some(Pose {
        rotation,
        position,
        scale,
    }))
}

/// The objects that a frame's intrinsics are read from.
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

    /// Returns width and height as stated.
    pub(crate) fn size(&self) -> Result<Option<[f64; 2]>> {
        Ok(self
            .number("w")?
            .zip(self.number("h")?)
            .map(<[f64; 2]>::from))
    }

    pub(crate) fn intrinsics(&self, size: [f64; 2]) -> Result<Intrinsics> {
        let distortion = self.distortion()?;
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

    /// Reads nerfstudio's coefficients: `k1` to `k4` of the fisheye, and else `k1` to `k3`, `p1`
    /// and `p2`. What a `k4` means without a fisheye differs between programs.
    fn distortion(&self) -> Result<Distortion> {
        let unsupported = |what: String| {
            Err(Error::new(format!("{what} is not supported"))
                .way_out("undistort the images to pinhole cameras first"))
        };
        let is_set = |key: &str| {
            let value = self.value(key);
            value.is_some_and(|value| *value != Value::Bool(false))
        };
        let mut fisheye = self.value("is_fisheye") == Some(&Value::Bool(true));
        match self.value("camera_model") {
            None => {}
            Some(Value::String(model)) if MODELS.contains(&model.as_str()) => {}
            Some(Value::String(model)) if FISHEYE_MODELS.contains(&model.as_str()) => {
                fisheye = true;
            }
            Some(model) => return unsupported(format!("camera model {model}")),
        }
        if is_set("is_fisheye") && !fisheye {
            return unsupported("`is_fisheye`".to_owned());
        }
        for key in ["latlong", "equirectangular", "orthographic"] {
            if is_set(key) {
                return unsupported(format!("`{key}`"));
            }
        }
        let mut k = [0.0; 6];
        for (value, key) in k.iter_mut().zip(["k1", "k2", "k3", "k4", "k5", "k6"]) {
            *value = self.number(key)?.unwrap_or(0.0);
        }
        let n_radial = if fisheye { 4 } else { 3 };
        if let Some(i) = (n_radial..6).find(|&i| k[i] != 0.0) {
            return unsupported(format!("distortion coefficient `k{}`", i + 1));
        }
        for key in ["distortion_params", "ftheta_p0"] {
            if self.value(key).is_some() {
                return unsupported(format!("`{key}`"));
            }
        }
        let [k1, k2, k3, k4, ..] = k;
        let tangential = [
            self.number("p1")?.unwrap_or(0.0),
            self.number("p2")?.unwrap_or(0.0),
        ];
        Ok(Distortion {
            fisheye,
            radial: [k1, k2, k3, k4],
            // OpenCV's fisheye has none; files give them for all lenses alike.
            tangential: if fisheye { [0.0; 2] } else { tangential },
            ..Distortion::default()
        })
    }
}
