//! A scene folder to a [`Scene`]: the format's reader finds what there is, the rest is shared.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::bytes::read_regular;
use super::cloud::{clean, read_cloud};
use super::decode::{Decoded, decode};
use super::formats;
use super::images::{PosedImage, match_images};
use super::layout::PosedCamera;
use super::masks::Masks;
use super::npy::read_vector;
use super::protocol::PoseProtocol;
use super::split::choose;
use super::{LoadOptions, PointCloud, Scene, View};
use crate::camera::Camera;
use crate::error::{Error, Result};

/// Loads the scene in the folder `dir`: poses, intrinsics and cloud in the format that is found
/// there, the split, and the photographs of the training and test views, scaled as asked.
///
/// # Errors
///
/// Everything that keeps the scene from being trained on, naming the file and the place in it.
/// What can be left out is, with a counted line in [`Scene::warnings`].
pub fn load(dir: &Path, options: &LoadOptions) -> Result<Scene> {
    if options.max_width == 0 || options.max_size == Some(0) {
        return Err(Error::usage("images cannot be scaled down to 0 pixels"));
    }
    if !dir.is_dir() {
        return Err(Error::new("no such scene folder")
            .at_path(dir)
            .way_out("give a folder with `images/` and a COLMAP model"));
    }
    let layout = formats::read(dir, options)?;
    let mut warnings = layout.warnings;
    let matched = match_images(layout.cameras, &layout.image_dir, &mut warnings)?;
    let split = choose(dir, &matched, layout.split, options, &mut warnings)?;

    // The cloud is read while the images are decoded; both are done before either may fail,
    // so that the error does not depend on which was faster.
    let chosen: Vec<&PosedImage> = split
        .train
        .iter()
        .chain(&split.test)
        .map(|&i| &matched.views[i])
        .collect();
    let masks = Masks::of(dir);
    let (cloud, decoded) = rayon::join(
        || read_points(&layout.cloud, layout.confidence.as_deref()),
        || -> Vec<Result<Decoded>> {
            let views = chosen.par_iter();
            views.map(|v| decode(v, &masks, options)).collect()
        },
    );
    warnings.extend(masks.missing(chosen.iter().map(|v| v.posed.camera.name.as_str())));
    let mut cloud = cloud?;
    let mut train = views(decoded, &mut warnings)?;
    let test = train.split_off(split.train.len());

    let count = |has: fn(&PosedCamera) -> bool| chosen.iter().filter(|v| has(&v.posed)).count();
    let n_distorted = count(|posed| posed.distortion.is_some());
    let pose_protocol = protocol(count(|posed| posed.interpolated), &mut warnings);
    let read = [Some(&layout.cloud), layout.confidence.as_ref()];
    let source = describe(dir, layout.source, n_distorted, read);
    let cameras: Vec<Camera> = matched.views.into_iter().map(|v| v.posed.camera).collect();
    let n_stored = cloud.len();
    clean(&mut cloud, &cameras, &mut warnings);
    if cloud.is_empty() {
        return Err(Error::new(format!(
            "the point cloud has no usable point ({n_stored} in the file)"
        ))
        .at_path(&layout.cloud)
        .way_out("make the cloud again: training starts from it"));
    }
    Ok(Scene {
        name: folder_name(dir),
        source,
        train,
        test,
        cloud,
        pose_protocol,
        warnings,
    })
}

/// What was taken, one line for the log: the model, the cloud and its confidences.
fn describe(
    dir: &Path,
    model: String,
    n_distorted: usize,
    [cloud, confidence]: [Option<&PathBuf>; 2],
) -> String {
    let mut line = model;
    if n_distorted > 0 {
        line += &format!(", {n_distorted} images undistorted");
    }
    for (what, path) in [("cloud", cloud), ("confidence", confidence)] {
        if let Some(path) = path {
            let relative = path.strip_prefix(dir).unwrap_or(path);
            line += &format!(", {what} {}", relative.display());
        }
    }
    line
}

/// What the poses are worth, with a warning where some were only interpolated.
fn protocol(n_interpolated: usize, warnings: &mut Vec<String>) -> PoseProtocol {
    if n_interpolated == 0 {
        return PoseProtocol::SharedFrame;
    }
    warnings.push(format!(
        "{n_interpolated} views have poses that were only interpolated between others: their \
         photographs show something else, and figures at them say little"
    ));
    PoseProtocol::Interpolated
}

/// The cloud, with the confidences of a file of their own where there is one.
fn read_points(path: &Path, confidence: Option<&Path>) -> Result<PointCloud> {
    let mut cloud = read_cloud(path)?;
    if let Some(path) = confidence {
        let values = read_vector(&read_regular(path)?).map_err(|e| e.at_path(path))?;
        if values.len() != cloud.len() {
            return Err(Error::new(format!(
                "{} confidences for a cloud of {} points",
                values.len(),
                cloud.len()
            ))
            .at_path(path)
            .way_out("make both again, or remove the confidences"));
        }
        cloud.confidence = Some(values);
    }
    Ok(cloud)
}

/// The views in order, or the first error in order.
fn views(decoded: Vec<Result<Decoded>>, warnings: &mut Vec<String>) -> Result<Vec<View>> {
    let mut views = Vec::with_capacity(decoded.len());
    let mut rescaled = Vec::new();
    for decoded in decoded {
        let Decoded {
            view,
            rescaled_from,
        } = decoded?;
        if let Some((width, height)) = rescaled_from {
            rescaled.push(format!("`{}`, camera {width}x{height}", view.camera.name));
        }
        views.push(view);
    }
    if let Some(example) = rescaled.first() {
        warnings.push(format!(
            "{} images are not of their camera's size, intrinsics rescaled: {example}{}",
            rescaled.len(),
            if rescaled.len() > 1 { ", ..." } else { "" }
        ));
    }
    Ok(views)
}

/// The folder's own name, also for `.` and `..`.
fn folder_name(dir: &Path) -> String {
    let full = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    full.file_name()
        .map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned())
}
