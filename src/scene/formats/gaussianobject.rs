//! This module reads GaussianObject's DUSt3R output: `dust3r_N.json`, cameras as 3DGS lists them,
//! and the cloud `dust3r_N.ply`; test cameras, if there are any, are in `dust3r_N_test.json`.

use std::collections::BTreeSet;
use std::path::Path;

use super::{Probe, find_numbered};
use crate::camera::Camera;
use crate::camera::json::read_cameras;
use crate::error::{Error, Result};
use crate::scene::LoadOptions;
use crate::scene::images::check_name;
use crate::scene::layout::{Layout, NamedSplit, PosedCamera};

pub(super) fn find(dir: &Path, options: &LoadOptions) -> Result<Option<Probe>> {
    find_numbered(dir, ("dust3r_", ".json"), Path::is_file, options.n_train)
}

pub(super) fn read(dir: &Path, probe: &Probe, _: &LoadOptions) -> Result<Layout> {
    let train = read_views(&probe.path)?;
    if train.is_empty() {
        return Err(Error::new("the file lists no camera").at_path(&probe.path));
    }
    let cloud = probe.path.with_extension("ply");
    let cloud = if cloud.is_file() {
        Ok(cloud)
    } else {
        Err(Error::new("the point cloud is missing")
            .at_path(&cloud)
            .way_out("GaussianObject writes it beside the cameras: run pred_poses.py again"))
    };
    let names = |cameras: &[Camera]| cameras.iter().map(|c| c.name.clone()).collect();
    let mut split = NamedSplit {
        train: names(&train),
        test: None,
        place: probe.path.clone(),
    };
    let mut cameras = train;
    let stem = probe.name.trim_end_matches(".json");
    let test_path = dir.join(format!("{stem}_test.json"));
    if test_path.is_file() {
        let mut test = read_views(&test_path)?;
        let trained: BTreeSet<&String> = split.train.iter().collect();
        if let Some(both) = test.iter().find(|view| trained.contains(&view.name)) {
            return Err(Error::new(format!(
                "image `{}` is a training view in `{}`, too",
                both.name, probe.name
            ))
            .at_path(&test_path));
        }
        split.test = Some(names(&test));
        cameras.append(&mut test);
    }
    let posed = |camera| PosedCamera {
        camera,
        distortion: None,
        interpolated: false,
        mask: None,
    };
    Ok(Layout {
        source: format!("GaussianObject's {}", probe.name),
        cameras: cameras.into_iter().map(posed).collect(),
        unusable: Vec::new(),
        image_dir: dir.join("images"),
        cloud,
        split: Some(split),
        warnings: Vec::new(),
    })
}

fn read_views(path: &Path) -> Result<Vec<Camera>> {
    let cameras = read_cameras(path)?;
    for camera in &cameras {
        check_name(&camera.name).map_err(|e| e.at_path(path))?;
    }
    Ok(cameras)
}
