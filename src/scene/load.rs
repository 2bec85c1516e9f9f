//! A scene folder to a [`Scene`]: the format's reader finds what there is, the rest is shared.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::cloud::{clean, read_cloud};
use super::decode::{Decoded, decode};
use super::images::{PosedImage, match_images};
use super::masks::Masks;
use super::split::choose;
use super::{LoadOptions, Scene, View, colmap};
use crate::camera::Camera;
use crate::error::{Error, Result};

/// What a format's reader finds in a scene folder.
pub(super) struct Layout {
    /// What was taken, relative to the scene folder.
    pub source: String,
    /// Every pose, at the model's resolution and under the model's name for the image.
    pub cameras: Vec<Camera>,
    /// Where the images are that the names are relative to.
    pub image_dir: PathBuf,
    pub cloud: PathBuf,
    /// Poses whose quaternion had to be normalised by more than rounding.
    pub n_unnormalized: usize,
}

/// Loads the scene in the folder `dir`: poses and intrinsics from a COLMAP model, the cloud
/// beside it, the split, and the photographs of the training and test views, scaled as asked.
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
    let Some(layout) = colmap::read(dir)? else {
        return Err(Error::new("no scene in this folder")
            .at_path(dir)
            .way_out(format!("put {} there", colmap::expected())));
    };
    let mut warnings = Vec::new();
    if layout.n_unnormalized > 0 {
        warnings.push(format!(
            "{} poses have quaternions that are not of unit length: normalised",
            layout.n_unnormalized
        ));
    }
    let matched = match_images(layout.cameras, &layout.image_dir, &mut warnings)?;
    let split = choose(dir, &matched, options, &mut warnings)?;

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
        || read_cloud(&layout.cloud),
        || -> Vec<Result<Decoded>> {
            let views = chosen.par_iter();
            views.map(|v| decode(v, &masks, options)).collect()
        },
    );
    warnings.extend(masks.missing(chosen.iter().map(|v| v.camera.name.as_str())));
    let mut cloud = cloud?;
    let mut train = views(decoded, &mut warnings)?;
    let test = train.split_off(split.train.len());

    let cameras: Vec<Camera> = matched.views.into_iter().map(|v| v.camera).collect();
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
        source: format!(
            "{}, cloud {}",
            layout.source,
            layout
                .cloud
                .strip_prefix(dir)
                .unwrap_or(&layout.cloud)
                .display()
        ),
        train,
        test,
        cloud,
        warnings,
    })
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
