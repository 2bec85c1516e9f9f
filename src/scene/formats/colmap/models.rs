//! The places where COLMAP models and their photographs are looked for.

use std::path::{Path, PathBuf};

use super::super::Probe;
use super::{has_model, read_model};

/// The folders in which a model is looked for, in this order: 3DGS, VGGT, MASt3R with GLOMAP, nerfstudio, COLMAP's
/// dense workspaces, and beside the photographs.
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

/// The folder of the scene `dir` that holds a model. Among the numbered parts of one reconstruction it
/// is that of the most images.
pub(super) fn find_model(dir: &Path) -> Option<Found> {
    let folder = FOLDERS.iter().find(|f| has_model(&dir.join(f)))?;
    let plain = |name: &str| Found {
        probe: Probe::new(dir, name),
        warning: None,
    };
    let Some(parent) = folder.strip_suffix("/0") else {
        return Some(plain(folder));
    };
    let names = (0..MAX_PARTS).map(|i| format!("{parent}/{i}"));
    let parts = names.filter(|name| has_model(&dir.join(name)));
    let counted: Vec<(usize, String)> = parts
        .map(|name| {
            let model = read_model(&dir.join(&name));
            (model.map_or(0, |model| model.views.len()), name)
        })
        .collect();
    if counted.len() < 2 {
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

/// The folder of photographs of the model in `model`.
pub(super) fn image_dir(dir: &Path, model: &Path, warnings: &mut Vec<String>) -> PathBuf {
    let is_flat = model.canonicalize().ok() == dir.canonicalize().ok();
    // COLMAP's dense workspace has both in one folder.
    let beside = model.parent().filter(|_| !is_flat).unwrap_or(dir);
    for name in IMAGES {
        for folder in [beside.join(name), dir.join(name)] {
            if folder.is_dir() {
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

/// The folders' names for messages.
pub(super) fn expected_in() -> String {
    let below = FOLDERS.iter().filter(|folder| **folder != ".");
    let names: Vec<String> = below.map(|folder| format!("`{folder}`")).collect();
    format!("{} or beside the photographs", names.join(", "))
}
