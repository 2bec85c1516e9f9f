//! This module looks through the folder of photographs: which there are, and which pose belongs to
//! which.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::layout::PosedCamera;
use super::lookup::{Folder, How, Lookup, folded};
use crate::error::{Error, Result};

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

impl Matched {
    /// Returns whether a name is that of some view, pose or photograph.
    pub(crate) fn knows(&self, name: &str) -> bool {
        let known = self.without_image.contains(name) || self.without_pose.contains(name);
        known || self.index(name).is_some()
    }

    /// Returns the index of the view of a name, or else of the only one whose name differs in
    /// spelling alone.
    pub(crate) fn index(&self, name: &str) -> Option<usize> {
        if let Some(&index) = self.by_name.get(name) {
            return Some(index);
        }
        let alike = self
            .by_name
            .iter()
            .filter(|(n, _)| folded(n) == folded(name));
        let indices: BTreeSet<usize> = alike.map(|(_, &index)| index).collect();
        indices.first().copied().filter(|_| indices.len() == 1)
    }
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

/// The poses that a format states.
pub(super) struct Poses {
    pub cameras: Vec<PosedCamera>,
    /// By name, with what keeps each from being used.
    pub unusable: Vec<(String, Error)>,
}

/// The folder of a scene and that of its photographs.
#[derive(Clone, Copy)]
pub(super) struct Folders<'a> {
    pub scene: &'a Path,
    pub images: &'a Path,
}

/// Finds each camera's photograph in its folder by name, as [`Folder::find`] does: a file that is
/// some pose's by its own path is no other's, and one that two poses could mean is neither's. DUSt3R
/// pipelines, for one, name every image with the first one's suffix. Poses and photographs without
/// their counterpart are counted in `warnings`.
///
/// # Errors
///
/// No such folder, no photograph in it that has a pose, or a photograph whose camera is among the
/// `unusable`.
pub(super) fn match_images(
    Poses { cameras, unusable }: Poses,
    Folders { scene, images: dir }: Folders<'_>,
    warnings: &mut Vec<String>,
) -> Result<Matched> {
    std::fs::read_dir(dir).map_err(|e| {
        Error::new(format!("cannot list the images: {e}"))
            .at_path(dir)
            .way_out("put the photographs into `images/`")
    })?;
    let folder = Folder::new(dir);
    let names: Vec<&str> = cameras.iter().map(|c| c.camera.name.as_str()).collect();
    let own: BTreeSet<&str> = names.iter().copied().filter(|n| folder.has(n)).collect();
    let lookups: Vec<Lookup> = names
        .iter()
        .map(|name| folder.find(name, |file| file == *name || !own.contains(file)))
        .collect();
    for (name, error) in unusable {
        if let Lookup::Found(..) = folder.find(&name, |file| !own.contains(file)) {
            return Err(error);
        }
    }
    let mut n_claims: BTreeMap<&str, usize> = BTreeMap::new();
    for lookup in &lookups {
        if let Lookup::Found(file, _) = lookup {
            *n_claims.entry(file).or_default() += 1;
        }
    }
    let (files, unread) = listed(&folder, scene == dir, &names);
    let mut matched = Matched {
        views: Vec::with_capacity(cameras.len()),
        by_name: BTreeMap::new(),
        without_image: BTreeSet::new(),
        without_pose: files.iter().cloned().collect(),
    };
    let mut substituted: BTreeMap<How, Vec<String>> = BTreeMap::new();
    for (name, lookup) in names.iter().zip(&lookups) {
        match lookup {
            Lookup::Found(file, how) if n_claims.get(file.as_str()) == Some(&1) => {
                matched.without_pose.remove(file);
                if *how != How::Path {
                    let example = format!("`{file}` for `{}`", name.escape_debug());
                    substituted.entry(*how).or_default().push(example);
                }
            }
            _ => {
                matched.without_image.insert((*name).to_owned());
            }
        }
    }
    let (n_files, n_cameras) = (files.len(), cameras.len());
    let unread: BTreeSet<String> = unread.into_iter().collect();
    for (mut posed, lookup) in cameras.into_iter().zip(&lookups) {
        let posed_name = posed.camera.name.clone();
        let Lookup::Found(file, _) = lookup else {
            continue;
        };
        if matched.without_image.contains(&posed_name) {
            continue;
        }
        posed.camera.name.clone_from(file);
        let index = matched.views.len();
        matched.by_name.insert(file.clone(), index);
        matched.by_name.insert(posed_name, index);
        let path = dir.join(file);
        matched.views.push(PosedImage { posed, path });
    }
    if matched.views.is_empty() {
        let mut way_out =
            "images are matched to poses by name: put those that were posed here".to_owned();
        if let Some(first) = unread.first() {
            way_out = format!(
                "{} lie there in formats that are not read (`{first}`): convert them to JPEG or PNG",
                unread.len()
            );
        }
        return Err(Error::new(format!(
            "none of the {n_cameras} posed images (`{}`, ...) is among the {n_files} images here",
            matched.without_image.first().map_or("", |name| name)
        ))
        .at_path(dir)
        .way_out(way_out));
    }
    tell(&matched, &substituted, &unread, warnings);
    Ok(matched)
}

/// Lists the photographs that may have a pose, those that are not read apart. In the scene's own
/// folder, which holds other pictures, too, only what lies beside posed ones counts.
fn listed(folder: &Folder, is_scene: bool, names: &[&str]) -> (Vec<String>, Vec<String>) {
    if !is_scene {
        return folder.photographs();
    }
    let place = |name: &&str| {
        name.rsplit_once('/')
            .map_or(String::new(), |(p, _)| format!("{p}/"))
    };
    let places: BTreeSet<String> = names.iter().map(place).collect();
    let mut found = (Vec::new(), Vec::new());
    for place in &places {
        folder.photographs_in(place, &mut found);
    }
    found
}

/// Counts what was assumed and left out in `warnings`.
fn tell(
    matched: &Matched,
    substituted: &BTreeMap<How, Vec<String>>,
    unread: &BTreeSet<String>,
    warnings: &mut Vec<String>,
) {
    let more = |n: usize| if n > 1 { ", ..." } else { "" };
    for (how, examples) in substituted {
        let what = match how {
            How::Stem => "by their stem as their suffix differs from the pose's",
            How::Tail => "by the last parts of their name, as the pose's path is not here",
            How::Path | How::Spelling => "though their name is spelt differently from the pose's",
        };
        let n = examples.len();
        warnings.push(format!(
            "{n} images taken {what}: {}{}",
            examples[0],
            more(n)
        ));
    }
    for (names, what) in [
        (
            &matched.without_image,
            "poses have no image and are not used",
        ),
        (
            &matched.without_pose,
            "images have no pose and are not used",
        ),
        (
            unread,
            "photographs are in formats that are not read and not used (convert them to JPEG or PNG)",
        ),
    ] {
        if let Some(first) = names.first() {
            let n = names.len();
            warnings.push(format!("{n} {what}: `{}`{}", first.escape_debug(), more(n)));
        }
    }
}
