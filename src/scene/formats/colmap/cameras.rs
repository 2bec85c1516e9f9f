//! This module has COLMAP's camera models (its `sensor/models.h`): names, parameters, and what of
//! them is ours.

use crate::error::{Error, Result};
use crate::scene::layout::Intrinsics;
use crate::scene::lens::Distortion;

/// Names by their id in binary files, and the number of their parameters.
const MODELS: [(&str, usize); 16] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
];

/// Returns the name of a model in a binary file, and the number of parameters that follow.
///
/// # Errors
/// An id without a name: nothing says where the next camera begins.
pub(crate) fn by_id(camera: i64, model: i32) -> Result<(&'static str, usize)> {
    let known = usize::try_from(model).ok().and_then(|i| MODELS.get(i));
    known
        .copied()
        .ok_or_else(|| unsupported(camera, &format!("id {model}")))
}

/// Returns the lens of a camera by its model's name.
///
/// # Errors
/// A model that is not read, another number of parameters, or values that no lens has.
pub(crate) fn intrinsics(
    camera: i64,
    model: &str,
    size: [u64; 2],
    params: &[f64],
) -> Result<Intrinsics> {
    let (pinhole, distortion) = lens(model, params).ok_or_else(|| {
        match MODELS.iter().find(|(name, _)| *name == model) {
            Some((_, n)) if *n != params.len() => Error::new(format!(
                "camera {camera}: {model} has {n} parameters, found {}",
                params.len()
            )),
            _ => unsupported(camera, model),
        }
    })?;
    Intrinsics::new(size.map(|side| side as f64), pinhole, distortion)
        .map_err(|e| e.at(format_args!("camera {camera}")))
}

fn unsupported(camera: i64, model: &str) -> Error {
    Error::new(format!(
        "camera {camera}: camera model `{}` is not supported",
        model.escape_debug()
    ))
    .way_out("undistort with `colmap image_undistorter`, which writes PINHOLE cameras")
}

/// Returns `[fx, fy, cx, cy]` and the distortion.
fn lens(model: &str, params: &[f64]) -> Option<([f64; 4], Distortion)> {
    let bent = Distortion::opencv;
    let fisheye = Distortion::fisheye;
    Some(match (model, params) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f, cx, cy], Distortion::default()),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], Distortion::default()),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f, cx, cy], bent([k, 0.0, 0.0, 0.0])),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], bent([k1, k2, 0.0, 0.0])),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => ([fx, fy, cx, cy], bent([k1, k2, p1, p2])),
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => (
            [fx, fy, cx, cy],
            Distortion {
                radial: [k1, k2, k3, 0.0],
                denominator: [k4, k5, k6],
                ..bent([k1, k2, p1, p2])
            },
        ),
        ("SIMPLE_FISHEYE", &[f, cx, cy]) => ([f, f, cx, cy], fisheye([0.0; 4])),
        ("FISHEYE", &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], fisheye([0.0; 4])),
        ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k]) => ([f, f, cx, cy], fisheye([k, 0.0, 0.0, 0.0])),
        ("RADIAL_FISHEYE", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], fisheye([k1, k2, 0.0, 0.0])),
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
            ([fx, fy, cx, cy], fisheye([k1, k2, k3, k4]))
        }
        // With all coefficients 0 it is no pinhole but the equidistant fisheye.
        ("THIN_PRISM_FISHEYE", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx, sy]) => (
            [fx, fy, cx, cy],
            Distortion {
                tangential: [p1, p2],
                prism: [sx, sy],
                ..fisheye([k1, k2, k3, k4])
            },
        ),
        _ => return None,
    })
}
