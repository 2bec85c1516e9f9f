//! COLMAP models, text and binary (<https://colmap.github.io/format.html>).
//!
//! COLMAP's camera frame is ours: world-to-camera, +z forward, y down, pixel centres at +0.5.

mod binary;
mod points;
mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use super::images::check_name;
use super::load::Layout;
use crate::camera::Camera;
use crate::error::{Error, Result, read_file};

pub(super) use points::{read_points_binary, read_points_text};

/// Where a model is looked for, in this order.
pub(super) const FOLDERS: [&str; 3] = ["sparse/0", "sparse", "0"];

/// Names of COLMAP's camera models by their id in binary files.
const MODELS: [&str; 12] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
];

/// Sides of images, and of the cameras that took them, beyond this are refused.
const MAX_SIDE: u64 = 1 << 20;

/// The model of the scene folder `dir`: its folder relative to `dir`, and the extension of its
/// files. Where both encodings are there, the binary one is what COLMAP itself would take.
fn find_model(dir: &Path) -> Option<(&'static str, &'static str)> {
    let models = FOLDERS.into_iter().flat_map(|f| [(f, "bin"), (f, "txt")]);
    models
        .into_iter()
        .find(|(folder, ext)| dir.join(folder).join(format!("cameras.{ext}")).is_file())
}

/// Reads the COLMAP model of the scene folder `dir`; `None` where it has none.
pub(super) fn read(dir: &Path) -> Result<Option<Layout>> {
    let Some((folder, extension)) = find_model(dir) else {
        return Ok(None);
    };
    let model_dir = dir.join(folder);
    let cameras_path = model_dir.join(format!("cameras.{extension}"));
    let images_path = model_dir.join(format!("images.{extension}"));
    let cameras = read_file(&cameras_path)?;
    let images = read_file(&images_path)?;
    let mut model = Model::default();
    let (kind, read_cameras, read_images): (_, ReadInto, ReadInto) = match extension {
        "bin" => ("binary", binary::read_cameras, binary::read_images),
        _ => ("text", text::read_cameras, text::read_images),
    };
    read_cameras(&cameras, &mut model).map_err(|e| e.at_path(&cameras_path))?;
    read_images(&images, &mut model).map_err(|e| e.at_path(&images_path))?;
    if model.views.is_empty() {
        return Err(Error::new("the model has no posed image")
            .at_path(&images_path)
            .way_out("the reconstruction failed: run it again on more overlapping images"));
    }
    Ok(Some(Layout {
        source: format!("{folder} ({kind})"),
        cameras: model.views,
        image_dir: dir.join("images"),
        cloud: find_cloud(dir, &model_dir),
        n_unnormalized: model.n_unnormalized,
    }))
}

/// Clouds that the scene folder `dir` offers besides the one that is taken: `points*.ply` beside
/// the model and in `dir`, by name.
///
/// # Errors
/// A folder that cannot be listed.
pub fn other_clouds(dir: &Path) -> Result<Vec<PathBuf>> {
    let Some((folder, _)) = find_model(dir) else {
        return Ok(Vec::new());
    };
    let model_dir = dir.join(folder);
    let own = find_cloud(dir, &model_dir).ok();
    let mut clouds = Vec::new();
    for folder in [model_dir.as_path(), dir] {
        let failed = |e| Error::new(format!("cannot list: {e}")).at_path(folder);
        for entry in std::fs::read_dir(folder).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_cloud = name.starts_with("points") && name.ends_with(".ply");
            if is_cloud && path.is_file() && Some(&path) != own.as_ref() {
                clouds.push(path);
            }
        }
    }
    clouds.sort();
    Ok(clouds)
}

/// Says where [`read`] looks, for the error that no format was recognised.
pub(super) fn expected() -> String {
    format!(
        "a COLMAP model (cameras and images as .bin or .txt) in {}",
        FOLDERS.map(|f| format!("`{f}`")).join(", ")
    )
}

/// Our own DUSt3R-style PLY before COLMAP's sparse points, which are too few to fill a view.
fn find_cloud(dir: &Path, model_dir: &Path) -> Result<PathBuf> {
    let candidates = [
        model_dir.join("points3D.ply"),
        dir.join("points3D.ply"),
        model_dir.join("points.ply"),
        dir.join("points.ply"),
        model_dir.join("points3D.bin"),
        model_dir.join("points3D.txt"),
    ];
    let found = candidates.iter().find(|path| path.is_file()).cloned();
    found.ok_or_else(|| {
        Error::new("no point cloud beside the model")
            .at_path(model_dir)
            .way_out("add points3D.ply, points.ply, points3D.bin or points3D.txt")
    })
}

type ReadInto = fn(&[u8], &mut Model) -> Result<()>;

/// A camera of `cameras.*`; images may share it. Lengths in pixels.
#[derive(Clone, Copy)]
struct Intrinsics {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
}

/// What the two encodings are read into; all checks of values are here.
#[derive(Default)]
struct Model {
    intrinsics: BTreeMap<i64, Intrinsics>,
    views: Vec<Camera>,
    names: BTreeSet<String>,
    /// Poses whose quaternion was off unit length by more than rounding explains.
    n_unnormalized: usize,
}

/// Number of parameters of a supported model, or the error that it is none.
fn n_params(id: i64, model: &str) -> Result<usize> {
    match model {
        "SIMPLE_PINHOLE" => Ok(3),
        "PINHOLE" => Ok(4),
        _ => Err(Error::new(format!(
            "camera {id}: camera model `{}` is not supported",
            model.escape_debug()
        ))
        .way_out("undistort with `colmap image_undistorter`, which writes PINHOLE cameras")),
    }
}

impl Model {
    fn add_camera(&mut self, id: i64, model: &str, size: [u64; 2], params: &[f64]) -> Result<()> {
        let (fx, fy, cx, cy) = match (model, params) {
            ("SIMPLE_PINHOLE", &[f, cx, cy]) => (f, f, cx, cy),
            ("PINHOLE", &[fx, fy, cx, cy]) => (fx, fy, cx, cy),
            _ => {
                return Err(Error::new(format!(
                    "camera {id}: {model} has {} parameters, found {}",
                    n_params(id, model)?,
                    params.len()
                )));
            }
        };
        let [width, height] = size;
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            return Err(Error::new(format!(
                "camera {id}: image size {width}x{height} is not within 1 to {MAX_SIDE}"
            )));
        }
        if !(fx > 0.0 && fy > 0.0 && fx.is_finite() && fy.is_finite()) {
            return Err(Error::new(format!(
                "camera {id}: focal length {fx}, {fy} is not positive and finite"
            )));
        }
        if !(cx.is_finite() && cy.is_finite()) {
            return Err(Error::new(format!(
                "camera {id}: principal point {cx}, {cy} is not finite"
            )));
        }
        let intrinsics = Intrinsics {
            width: width as u32,
            height: height as u32,
            fx,
            fy,
            cx,
            cy,
        };
        match self.intrinsics.insert(id, intrinsics) {
            None => Ok(()),
            Some(_) => Err(Error::new(format!("camera {id} appears twice"))),
        }
    }

    /// `rotation_wxyz` and `translation` are world-to-camera.
    fn add_image(
        &mut self,
        rotation_wxyz: [f64; 4],
        translation: [f64; 3],
        camera_id: i64,
        name: &str,
    ) -> Result<()> {
        check_name(name)?;
        let what = |problem: String| Error::new(format!("image `{name}`: {problem}"));
        let Some(intrinsics) = self.intrinsics.get(&camera_id) else {
            return Err(what(format!("there is no camera {camera_id}")));
        };
        let [w, x, y, z] = rotation_wxyz;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let norm = rotation.length();
        if !(norm > 1e-12 && norm.is_finite()) {
            return Err(what(format!(
                "quaternion {w} {x} {y} {z} is no rotation (its length is {norm})"
            )));
        }
        let translation = DVec3::from(translation);
        if !translation.is_finite() {
            return Err(what(format!("translation {translation} is not finite")));
        }
        if !self.names.insert(name.to_owned()) {
            return Err(what("the name appears twice".to_owned()).way_out("keep one of the poses"));
        }
        self.n_unnormalized += usize::from((norm - 1.0).abs() > 1e-3);
        let Intrinsics {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
        } = *intrinsics;
        self.views.push(Camera {
            name: name.to_owned(),
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            rotation: DMat3::from_quat(rotation.normalize()),
            translation,
        });
        Ok(())
    }
}
