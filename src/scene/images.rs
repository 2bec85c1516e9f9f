//! The folder of photographs: which there are, and which pose belongs to which.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::layout::PosedCamera;
use crate::error::{Error, Result};

/// File extensions that are listed as photographs.
const EXTENSIONS: [&str; 3] = ["jpg", "jpeg", "png"];

/// A camera and the file of its photograph; the camera is named after the file.
#[derive(Clone, Debug)]
pub(super) struct PosedImage {
    pub posed: PosedCamera,
    pub path: PathBuf,
}

/// The outcome of [`match_images`].
pub(super) struct Matched {
    pub views: Vec<PosedImage>,
    /// Index into `views` by name: the file's and, where it differs, the pose's.
    pub by_name: BTreeMap<String, usize>,
    /// Names of poses whose photograph is missing.
    pub without_image: BTreeSet<String>,
    /// Names of photographs that have no pose.
    pub without_pose: BTreeSet<String>,
}

/// Refuses image names that would leave the image folder or break what prints them.
pub(super) fn check_name(name: &str) -> Result<()> {
    check_relative("image name", name)
}

/// Refuses a `kind` of relative path that would leave its folder or break what prints it. Links
/// are followed: those in a scene folder are its owner's.
pub(super) fn check_relative(kind: &str, name: &str) -> Result<()> {
    let problem = if name.is_empty() {
        "is empty"
    } else if name.chars().any(char::is_control) {
        "holds control characters"
    } else if name.split(['/', '\\']).any(|part| part == "..")
        || name.starts_with(['/', '\\'])
        || name.chars().nth(1) == Some(':')
    {
        "leaves the scene's folder"
    } else {
        return Ok(());
    };
    Err(
        Error::new(format!("{kind} `{}` {problem}", name.escape_debug()))
            .way_out("name files within the scene folder, without `..`"),
    )
}

/// Finds each camera's photograph in `dir` by name. Where `x.png` is missing but exactly one
/// photograph has the stem `x`, that one is taken: DUSt3R pipelines name every image with the
/// first one's suffix. Poses and photographs without their counterpart are counted in `warnings`.
///
/// # Errors
///
/// No such folder, no photograph in it that has a pose.
pub(super) fn match_images(
    cameras: Vec<PosedCamera>,
    dir: &Path,
    warnings: &mut Vec<String>,
) -> Result<Matched> {
    let mut files = BTreeSet::new();
    list_images(dir, "", &mut files)?;
    let n_files = files.len();
    let n_cameras = cameras.len();

    // Photographs with a pose of their own name are not up for substitution.
    let mut without_pose = files.clone();
    for posed in &cameras {
        without_pose.remove(&posed.camera.name);
    }
    let mut by_stem: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for name in &without_pose {
        by_stem
            .entry(stem(name).to_owned())
            .or_default()
            .push(name.clone());
    }

    let mut matched = Matched {
        views: Vec::with_capacity(n_cameras),
        by_name: BTreeMap::new(),
        without_image: BTreeSet::new(),
        without_pose,
    };
    let mut substituted = Vec::new();
    for mut posed in cameras {
        let posed_name = posed.camera.name.clone();
        if !files.contains(&posed_name) {
            match by_stem.remove(stem(&posed_name)).as_deref() {
                Some([only]) => {
                    substituted.push(format!("`{only}` for `{posed_name}`"));
                    matched.without_pose.remove(only);
                    posed.camera.name.clone_from(only);
                }
                _ => {
                    matched.without_image.insert(posed_name);
                    continue;
                }
            }
        }
        let index = matched.views.len();
        matched.by_name.insert(posed.camera.name.clone(), index);
        matched.by_name.insert(posed_name, index);
        let path = dir.join(&posed.camera.name);
        matched.views.push(PosedImage { posed, path });
    }

    let first = |names: &BTreeSet<String>| names.first().cloned().unwrap_or_default();
    if matched.views.is_empty() {
        return Err(Error::new(format!(
            "none of the {n_cameras} posed images (`{}`, ...) is among the {n_files} images here",
            first(&matched.without_image)
        ))
        .at_path(dir)
        .way_out("images are matched to poses by name: put those that were posed here"));
    }
    if let Some(example) = substituted.first() {
        warnings.push(format!(
            "{} images taken by their stem as their suffix differs from the pose's: {example}{}",
            substituted.len(),
            if substituted.len() > 1 { ", ..." } else { "" }
        ));
    }
    for (names, what) in [
        (&matched.without_image, "poses have no image"),
        (&matched.without_pose, "images have no pose"),
    ] {
        if !names.is_empty() {
            warnings.push(format!(
                "{} {what} and are not used: `{}`{}",
                names.len(),
                first(names).escape_debug(),
                if names.len() > 1 { ", ..." } else { "" }
            ));
        }
    }
    Ok(matched)
}

/// The name without its suffix.
pub(super) fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// Adds the photographs in `dir` and its subfolders as `prefix` + name, with `/` between.
fn list_images(dir: &Path, prefix: &str, names: &mut BTreeSet<String>) -> Result<()> {
    let failed = |e: std::io::Error| {
        Error::new(format!("cannot list the images: {e}"))
            .at_path(dir)
            .way_out("put the photographs into `images/`")
    };
    for entry in std::fs::read_dir(dir).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        // Poses are UTF-8, so a file whose name is not can have none.
        let Ok(file_name) = entry.file_name().into_string() else {
            continue;
        };
        let name = format!("{prefix}{file_name}");
        // Links to folders are not followed: they may lead in circles.
        if entry.file_type().map_err(failed)?.is_dir() {
            list_images(&entry.path(), &format!("{name}/"), names)?;
        } else if is_photograph(&entry.path()) {
            names.insert(name);
        }
    }
    Ok(())
}

fn is_photograph(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str());
    extension.is_some_and(|e| EXTENSIONS.iter().any(|known| e.eq_ignore_ascii_case(known)))
        && path.is_file()
}
