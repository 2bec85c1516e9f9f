//! This module reads InstantSplat's output: `sparse_N/0`, a COLMAP model of the N training views
//! with a cloud and its confidences, and `sparse_N/1`, one of the test views.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::colmap::{has_model, read_model};
use super::{Probe, find_numbered};
use crate::error::{Error, Result};
use crate::scene::LoadOptions;
use crate::scene::layout::{Layout, NamedSplit, PosedCamera};

pub(super) fn find(dir: &Path, options: &LoadOptions) -> Result<Option<Probe>> {
    let is_one = |path: &Path| has_model(&path.join("0"));
    find_numbered(dir, ("sparse_", ""), is_one, options.n_train)
}

pub(super) fn read(dir: &Path, probe: &Probe, _: &LoadOptions) -> Result<Layout> {
    let train_dir = probe.path.join("0");
    let train = read_model(&train_dir)?;
    let cloud = train_dir.join("points3D.ply");
    let no_cloud = || {
        Error::new("no point cloud beside the model")
            .at_path(&train_dir)
            .way_out("InstantSplat writes points3D.ply there: run init_geo.py again")
    };
    let cloud = cloud.is_file().then_some(cloud).ok_or_else(no_cloud);
    let mut warnings = train.warnings();
    let mut cameras = train.views;
    let mut unusable = train.unusable;
    let train_names = names(&cameras);

    let test_dir = probe.path.join("1");
    let mut test_names = Vec::new();
    if has_model(&test_dir) {
        let mut test = read_model(&test_dir)?;
        warnings.extend(test.warnings());
        test_names = names(&test.views);
        let trained: BTreeSet<&String> = train_names.iter().collect();
        if let Some(name) = test_names.iter().find(|name| trained.contains(name)) {
            return Err(Error::new(format!(
                "image `{name}` is a test view here and a training view in `{}/0`",
                probe.name
            ))
            .at_path(&test_dir)
            .way_out("run init_geo.py again"));
        }
        // They are only where InstantSplat's fit of the test poses starts from.
        test.views
            .iter_mut()
            .for_each(|view| view.interpolated = true);
        cameras.append(&mut test.views);
        unusable.append(&mut test.unusable);
    }
    Ok(Layout {
        source: format!("InstantSplat's {} ({})", probe.name, train.encoding),
        cameras,
        unusable,
        image_dir: dir.join("images"),
        cloud,
        split: Some(NamedSplit {
            train: train_names,
            test: Some(test_names),
            place: probe.path.clone(),
        }),
        warnings,
    })
}

/// Finds the `.npy` file with one confidence for every point of the PLY beside it, where there is
/// one.
pub(in crate::scene) fn confidence_of(cloud: &Path) -> Option<PathBuf> {
    let beside = cloud.with_file_name("confidence_dsp.npy");
    (cloud.ends_with("points3D.ply") && beside.is_file()).then_some(beside)
}

fn names(views: &[PosedCamera]) -> Vec<String> {
    views.iter().map(|view| view.camera.name.clone()).collect()
}
