//! COLMAP models, text and binary (<https://colmap.github.io/format.html>).
//!
//! COLMAP's camera frame is ours: world-to-camera, +z forward, y down, pixel centres at +0.5.

mod binary;
mod points;
mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use super::{Probe, first_file};
use crate::error::{Error, Result};
use crate::files::bytes::read_regular;
use crate::scene::LoadOptions;
use crate::scene::images::check_name;
use crate::scene::layout::{Intrinsics, Layout, PosedCamera};

pub(in crate::scene) use points::{read_points_binary, read_points_text};

/// Where a model is looked for, in this order: 3DGS, VGGT, and MASt3R with GLOMAP.
pub(in crate::scene) const FOLDERS: [&str; 4] = ["sparse/0", "sparse", "0", "reconstruction/0"];

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

/// The folder of the scene `dir` that holds a model.
fn find_model(dir: &Path) -> Option<Probe> {
    let mut folders = FOLDERS.iter();
    let found = folders.find(|folder| has_model(&dir.join(folder)));
    found.map(|folder| Probe::new(dir, folder))
}

pub(super) fn find(dir: &Path, _: &LoadOptions) -> Result<Option<Probe>> {
    Ok(find_model(dir))
}

/// Reads the model that [`find`] found.
pub(super) fn read(dir: &Path, probe: &Probe, _: &LoadOptions) -> Result<Layout> {
    let model = read_model(&probe.path)?;
    Ok(Layout {
        source: format!("{} ({})", probe.name, model.encoding),
        image_dir: dir.join("images"),
        cloud: find_cloud(dir, &probe.path),
        split: None,
        warnings: model.warnings(),
        cameras: model.views,
    })
}

/// Clouds that the COLMAP scene `dir` offers besides the one that is taken: `points*.ply` beside
/// the model and in `dir`, by name.
///
/// # Errors
/// A folder that cannot be listed.
pub fn other_clouds(dir: &Path) -> Result<Vec<PathBuf>> {
    let Some(Probe {
        path: model_dir, ..
    }) = find_model(dir)
    else {
        return Ok(Vec::new());
    };
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

/// Says where [`find`] looks, for the error that no format was recognised.
pub(super) fn expected() -> String {
    format!(
        "a COLMAP model (cameras and images as .bin or .txt) in {}",
        FOLDERS.map(|f| format!("`{f}`")).join(", ")
    )
}

pub(super) fn has_model(folder: &Path) -> bool {
    let mut names = ["cameras.bin", "cameras.txt"].iter();
    names.any(|name| folder.join(name).is_file())
}

/// Reads the cameras and images in `folder`.
pub(super) fn read_model(folder: &Path) -> Result<Model> {
    let mut model = Model::default();
    // Where both are there, the binary one is what COLMAP itself would take.
    let (extension, read_cameras, read_images): (_, ReadInto, ReadInto) =
        if folder.join("cameras.bin").is_file() {
            model.encoding = "binary";
            ("bin", binary::read_cameras, binary::read_images)
        } else {
            model.encoding = "text";
            ("txt", text::read_cameras, text::read_images)
        };
    let cameras_path = folder.join(format!("cameras.{extension}"));
    let images_path = folder.join(format!("images.{extension}"));
    let cameras = read_regular(&cameras_path)?;
    let images = read_regular(&images_path)?;
    read_cameras(&cameras, &mut model).map_err(|e| e.at_path(&cameras_path))?;
    read_images(&images, &mut model).map_err(|e| e.at_path(&images_path))?;
    if model.views.is_empty() {
        return Err(Error::new("the model has no posed image")
            .at_path(&images_path)
            .way_out("the reconstruction failed: run it again on more overlapping images"));
    }
    Ok(model)
}

/// Our own DUSt3R-style PLY before COLMAP's sparse points, which are too few to fill a view.
fn find_cloud(dir: &Path, folder: &Path) -> Result<PathBuf> {
    first_file(&[
        folder.join("points3D.ply"),
        dir.join("points3D.ply"),
        folder.join("points.ply"),
        dir.join("points.ply"),
        folder.join("points3D.bin"),
        folder.join("points3D.txt"),
    ])
    .ok_or_else(|| {
        Error::new("no point cloud beside the model")
            .at_path(folder)
            .way_out("add points3D.ply, points.ply, points3D.bin or points3D.txt")
    })
}

type ReadInto = fn(&[u8], &mut Model) -> Result<()>;

/// What the two encodings are read into; all checks of values are here.
#[derive(Default)]
pub(super) struct Model {
    pub views: Vec<PosedCamera>,
    pub encoding: &'static str,
    /// Cameras of `cameras.*`, which images may share.
    intrinsics: BTreeMap<i64, Intrinsics>,
    names: BTreeSet<String>,
    /// Poses whose quaternion was off unit length by more than rounding explains.
    n_unnormalized: usize,
}

/// Number of parameters of a supported model, or the error that it is none.
fn n_params(id: i64, model: &str) -> Result<usize> {
    match model {
        "SIMPLE_PINHOLE" => Ok(3),
        "PINHOLE" | "SIMPLE_RADIAL" => Ok(4),
        "RADIAL" => Ok(5),
        "OPENCV" => Ok(8),
        _ => Err(Error::new(format!(
            "camera {id}: camera model `{}` is not supported",
            model.escape_debug()
        ))
        .way_out("undistort with `colmap image_undistorter`, which writes PINHOLE cameras")),
    }
}

impl Model {
    pub fn warnings(&self) -> Vec<String> {
        let n = self.n_unnormalized;
        let warning = format!("{n} poses have quaternions that are not of unit length: normalised");
        (n > 0).then_some(warning).into_iter().collect()
    }

    fn add_camera(&mut self, id: i64, model: &str, size: [u64; 2], params: &[f64]) -> Result<()> {
        let (pinhole, distortion) = match (model, params) {
            ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f, cx, cy], [0.0; 4]),
            ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], [0.0; 4]),
            ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f, cx, cy], [k, 0.0, 0.0, 0.0]),
            ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], [k1, k2, 0.0, 0.0]),
            ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => ([fx, fy, cx, cy], [k1, k2, p1, p2]),
            _ => {
                return Err(Error::new(format!(
                    "camera {id}: {model} has {} parameters, found {}",
                    n_params(id, model)?,
                    params.len()
                )));
            }
        };
        let intrinsics = Intrinsics::new(size.map(|side| side as f64), pinhole, distortion)
            .map_err(|e| e.at(format_args!("camera {id}")))?;
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
        let rotation = DMat3::from_quat(rotation.normalize());
        self.views
            .push(intrinsics.posed(name.to_owned(), rotation, translation));
        Ok(())
    }
}
