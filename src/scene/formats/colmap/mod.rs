//! This module reads COLMAP models, text and binary (<https://colmap.github.io/format.html>).
//!
//! COLMAP's camera frame is ours: world-to-camera, +z forward, y down, pixel centres at +0.5.

mod binary;
mod cameras;
mod models;
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

use models::{expected_in, find_model, image_dir};

pub(in crate::scene) use models::FOLDERS;
pub(in crate::scene) use points::{read_points_binary, read_points_text};

pub(super) fn find(dir: &Path, _: &LoadOptions) -> Result<Option<Probe>> {
    Ok(find_model(dir).map(|found| found.probe))
}

/// Reads the model that [`find`] found.
pub(super) fn read(dir: &Path, probe: &Probe, _: &LoadOptions) -> Result<Layout> {
    let model = read_model(&probe.path)?;
    let mut warnings = model.warnings();
    warnings.extend(find_model(dir).and_then(|found| found.warning));
    Ok(Layout {
        source: format!("{} ({})", probe.name, model.encoding),
        image_dir: image_dir(dir, &probe.path, &mut warnings),
        cloud: find_cloud(dir, &probe.path),
        split: None,
        warnings,
        cameras: model.views,
        unusable: model.unusable,
    })
}

/// Lists the clouds that the COLMAP scene `dir` offers besides the one that is taken: `points*.ply`
/// beside the model and in `dir`, by name.
///
/// # Errors
/// A folder that cannot be listed.
pub fn other_clouds(dir: &Path) -> Result<Vec<PathBuf>> {
    let Some(found) = find_model(dir) else {
        return Ok(Vec::new());
    };
    let model_dir = found.probe.path;
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

/// Returns the cloud that is taken of the COLMAP scene `dir`, where there is one.
pub(in crate::scene) fn own_cloud(dir: &Path) -> Option<PathBuf> {
    find_cloud(dir, &find_model(dir)?.probe.path).ok()
}

/// Says where [`find`] looks, for the error that no format was recognised.
pub(super) fn expected() -> String {
    format!(
        "a COLMAP model (cameras and images as .bin or .txt) in {}",
        expected_in()
    )
}

pub(super) fn has_model(folder: &Path) -> bool {
    let mut names = ["cameras.bin", "cameras.txt"].iter();
    names.any(|name| folder.join(name).is_file())
}

/// Reads the cameras and images in `folder`.
pub(super) fn read_model(folder: &Path) -> Result<Model> {
    let mut model = Model::default();
    // COLMAP itself takes the binary one if both are there.
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
    let in_cameras = |e: Error| e.at_path(&cameras_path);
    let judged = std::mem::take(&mut model.intrinsics).into_iter();
    model.intrinsics = judged
        .map(|(id, camera)| (id, camera.map_err(in_cameras)))
        .collect();
    read_images(&images, &mut model).map_err(|e| e.at_path(&images_path))?;
    if model.views.is_empty() {
        let mut unusable = model.unusable.into_iter().chain(model.not_finite);
        if let Some((_, error)) = unusable.next() {
            return Err(error);
        }
        return Err(Error::new("the model has no posed image")
            .at_path(&images_path)
            .way_out("the reconstruction failed: run it again on more overlapping images"));
    }
    Ok(model)
}

/// Finds the cloud: our own DUSt3R-style PLY before COLMAP's sparse points, which are too few to
/// fill a view.
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
            .way_out(format!(
                "add points3D.ply, points.ply, points3D.bin or points3D.txt, or make one: \
                 `gspotential scene --cameras {} --weights model.safetensors --out dense.ply`, then \
                 `train --cloud dense.ply`",
                dir.display()
            ))
    })
}

type ReadInto = fn(&[u8], &mut Model) -> Result<()>;

/// The model that both encodings are read into; all checks of values are here.
#[derive(Default)]
pub(super) struct Model {
    pub views: Vec<PosedCamera>,
    pub encoding: &'static str,
    /// Names of images whose camera cannot be used, and why not.
    pub unusable: Vec<(String, Error)>,
    /// Cameras of `cameras.*`, which images may share; refused only by an image that uses them.
    intrinsics: BTreeMap<i64, Result<Intrinsics>>,
    /// Ids of the cameras with a parameter that is not finite.
    not_finite_cameras: BTreeSet<i64>,
    names: BTreeSet<String>,
    /// Poses whose quaternion was off unit length by more than rounding explains.
    n_unnormalized: usize,
    /// Images whose pose or camera has a number that is not finite: they could not be posed.
    not_finite: Vec<(String, Error)>,
}

/// A camera as a model states it.
struct StatedCamera<'a> {
    id: i64,
    /// COLMAP's name of the camera model.
    model: &'a str,
    /// Width and height, pixels.
    size: [u64; 2],
    params: Vec<f64>,
}

/// The pose of an image as a model states it, world to camera.
struct StatedPose {
    rotation_wxyz: [f64; 4],
    translation: [f64; 3],
    camera_id: i64,
}

impl Model {
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.n_unnormalized > 0 {
            warnings.push(format!(
                "{} poses have quaternions that are not of unit length: normalised",
                self.n_unnormalized
            ));
        }
        if let Some((first, _)) = self.not_finite.first() {
            warnings.push(format!(
                "{} images have a pose that is not finite or no rotation, or a camera that is not finite, and are not \
                 used: `{}`{}",
                self.not_finite.len(),
                first.escape_debug(),
                if self.not_finite.len() > 1 {
                    ", ..."
                } else {
                    ""
                }
            ));
        }
        warnings
    }

    fn add_camera(
        &mut self,
        at: &dyn std::fmt::Display,
        StatedCamera {
            id,
            model,
            size,
            params,
        }: StatedCamera<'_>,
    ) -> Result<()> {
        if !params.iter().all(|p| p.is_finite()) {
            self.not_finite_cameras.insert(id);
        }
        let judged = cameras::intrinsics(id, model, size, &params).map_err(|e| e.at(at));
        match self.intrinsics.insert(id, judged) {
            None => Ok(()),
            Some(_) => Err(Error::new(format!("camera {id} appears twice")).at(at)),
        }
    }

    fn add_image(
        &mut self,
        StatedPose {
            rotation_wxyz,
            translation,
            camera_id,
        }: StatedPose,
        name: &str,
    ) -> Result<()> {
        check_name(name)?;
        let what = |problem: String| Error::new(format!("image `{name}`: {problem}"));
        let Some(camera) = self.intrinsics.get(&camera_id) else {
            return Err(what(format!("there is no camera {camera_id}")));
        };
        if !self.names.insert(name.to_owned()) {
            return Err(what("the name appears twice".to_owned()).way_out("keep one of the poses"));
        }
        let intrinsics = match camera {
            Ok(intrinsics) => intrinsics,
            Err(error) => {
                let not_finite = self.not_finite_cameras.contains(&camera_id);
                let list = if not_finite {
                    &mut self.not_finite
                } else {
                    &mut self.unusable
                };
                list.push((name.to_owned(), error.clone()));
                return Ok(());
            }
        };
        let [w, x, y, z] = rotation_wxyz;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let translation = DVec3::from(translation);
        let norm = rotation.length();
        // An image that could not be posed has a pose of not a number, or of nothing.
        if !(norm > 1e-12 && norm.is_finite() && translation.is_finite()) {
            let error = what(format!(
                "its pose {w} {x} {y} {z}, {translation} is not finite or no rotation"
            ));
            self.not_finite.push((name.to_owned(), error));
            return Ok(());
        }
        self.n_unnormalized += usize::from((norm - 1.0).abs() > 1e-3);
        let rotation = DMat3::from_quat(rotation.normalize());
        self.views
            .push(intrinsics.posed(name.to_owned(), rotation, translation));
        Ok(())
    }
}
