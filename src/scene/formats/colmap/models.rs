//! This module has the places in which COLMAP models and their photographs are looked for.

use std::path::{Path, PathBuf};

use super::super::Probe;
use super::{has_model, read_model};

/// The folders in which a model is looked for, in this order: 3DGS, VGGT, MASt3R with GLOMAP,
/// nerfstudio, COLMAP's dense workspaces, and beside the photographs.
pub(in crate::scene) const FOLDERS: [&str; 8] = [
    "sparse/0",
    "sparse",
    "0",
    "reconstruction/0",
    "colmap/sparse/0",
    "dense/0/sparse",
    "dense/sparse",
    ".",
];

/// Photographs are looked for beside the model and in the scene's folder under these names: reduced
/// ones where the full ones were not handed on.
const IMAGES: [&str; 4] = ["images", "images_2", "images_4", "images_8"];

/// COLMAP numbers the parts of a scene that it could not join; more of them than this are not
/// looked at.
const MAX_PARTS: usize = 100;

/// A model, and what was passed over for it.
pub(super) struct Found {
    pub probe: Probe,
    pub warning: Option<String>,
}

/// Finds the folder of the scene `dir` that holds a model. Among the numbered parts of one
/// reconstruction it is that of the most images.
pub(super) fn find_model(dir: &Path) -> Option<Found> {
    let parts_of = |folder: &str| -> Vec<String> {
        let Some(parent) = folder.strip_suffix("/0") else {
            return Vec::new();
        };
        let names = (0..MAX_PARTS).map(|i| format!("{parent}/{i}"));
        names.filter(|name| has_model(&dir.join(name))).collect()
    };
    // The first part may have been removed.
    let is_there = |f: &&&str| has_model(&dir.join(f)) || !parts_of(f).is_empty();
    let folder = FOLDERS.iter().find(is_there)?;
    let plain = |name: &str| Found {
        probe: Probe::new(dir, name),
        warning: None,
    };
    let parts = parts_of(folder);
    if let [only] = &parts[..] {
        return Some(plain(only));
    }
    let counted: Vec<(usize, String)> = parts
        .into_iter()
        .map(|name| {
            let model = read_model(&dir.join(&name));
            (model.map_or(0, |model| model.views.len()), name)
        })
        .collect();
    if counted.is_empty() {
        return Some(plain(folder));
    }
    // The first of those with the most.
    let (most, name) = counted.iter().rev().max_by_key(|(n, _)| *n)?;
    let others: Vec<String> = counted
        .iter()
        .filter(|(_, other)| other != name)
        .map(|(n, other)| format!("`{other}` ({n})"))
        .collect();
    Some(Found {
        probe: Probe::new(dir, name),
        warning: Some(format!(
            "`{name}` with {most} images is taken; also here and not used: {}",
            others.join(", ")
        )),
    })
}

/// Finds the folder of photographs of the model in `model`.
pub(super) fn image_dir(dir: &Path, model: &Path, warnings: &mut Vec<String>) -> PathBuf {
    let is_flat = model.canonicalize().ok() == dir.canonicalize().ok();
    // COLMAP's dense workspace has both in one folder.
    let beside = model.parent().filter(|_| !is_flat).unwrap_or(dir);
    for name in IMAGES {
        for parent in [beside, dir] {
            if let Some(folder) = folder_named(parent, name) {
                if name != "images" {
                    warnings.push(format!(
                        "there is no `images`: the photographs are those in `{name}`"
                    ));
                }
                return folder;
            }
        }
    }
    let first = dir.join("images");
    if is_flat { dir.to_owned() } else { first }
}

/// Finds the folder `name` in `parent`, or else the only one of another case.
fn folder_named(parent: &Path, name: &str) -> Option<PathBuf> {
    let exact = parent.join(name);
    if exact.is_dir() {
        return Some(exact);
    }
    let entries = std::fs::read_dir(parent).ok()?.flatten();
    let is_alike = |entry: &std::fs::DirEntry| {
        let other = entry.file_name();
        let other = other.to_str().unwrap_or_default();
        other.eq_ignore_ascii_case(name) && entry.path().is_dir()
    };
    let alike: Vec<PathBuf> = entries.filter(is_alike).map(|e| e.path()).collect();
    <[PathBuf; 1]>::try_from(alike).ok().map(|[folder]| folder)
}

/// Returns the folders' names for messages.
pub(super) fn expected_in() -> String {
    let below = FOLDERS.iter().filter(|folder| **folder != ".");
    let names: Vec<String> = below.map(|folder| format!("`{folder}`")).collect();
    format!("{} or beside the photographs", names.join(", "))
}
