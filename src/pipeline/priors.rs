//! This module makes what training views are held to beside their photographs, of the cloud or of files.

use glam::DVec3;
use rayon::prelude::*;

use super::cameras;
use crate::camera::Frame;
use crate::cloud::splat::splat_depths;
use crate::config::{Config, PriorDepths, PriorSource};
use crate::dense::{DepthMap, normals};
use crate::error::{Error, Result};
use crate::scene::{PointCloud, Scene, View};
use crate::train::{DepthTarget, TrainingView};

/// Sets the depths and normals of the training views `views`, which are those of `scene`, if `config` asks
/// for them. `cloud` is the scene's or what carving has left of it.
///
/// # Errors
/// A cloud that cannot be splatted, or of which no view shows anything.
pub(super) fn set_depths(
    views: &mut [TrainingView],
    scene: &Scene,
    cloud: &PointCloud,
    frame: &Frame,
    config: &Config,
) -> Result<()> {
    if !config.prior.is_on() {
        return Ok(());
    }
    let targets: Vec<DepthTarget> = match config.prior.source {
        PriorSource::None => return Ok(()),
        PriorSource::Cloud => of_cloud(scene, cloud, frame, config)?,
        PriorSource::Files => {
            let views = scene.train.par_iter();
            views.map(|view| of_files(view, frame, config)).collect()
        }
    };
    let holds = |t: &DepthTarget| {
        let has_depth = t.weight.iter().any(|w| *w > 0.0);
        has_depth || t.normal.iter().any(|n| *n != [0.0; 3])
    };
    if !targets.iter().any(holds) {
        return Err(
            Error::new("no pixel of any training view has a depth to be held to")
                .at("config section `prior`")
                .way_out("train with `--set prior.source=none`, or give depths above 0"),
        );
    }
    for (view, target) in views.iter_mut().zip(targets) {
        view.depths = Some(target);
    }
    Ok(())
}

/// Takes the depths of the nearest points, but for edges, and their normals.
fn of_cloud(
    scene: &Scene,
    cloud: &PointCloud,
    frame: &Frame,
    config: &Config,
) -> Result<Vec<DepthTarget>> {
    let cameras = cameras(&scene.train);
    let near = frame.near(config.model.near);
    let both = (&cameras[..], &cameras[..]);
    let depths = splat_depths(cloud, frame, both, &config.splat, near)?;
    let target = |(view, depth): (&View, Vec<f32>)| {
        let map = DepthMap {
            camera: frame.camera_to_canonical(&view.camera),
            depth,
            confidence: Vec::new(),
            colors: Vec::new(),
        };
        let mut target = DepthTarget::default();
        for (i, normal) in normals(&map).into_iter().enumerate() {
            let normal = normal.filter(|_| view.counts(i));
            let depth = normal.map(|_| compared(map.depth[i], config));
            target.depth.push(depth.unwrap_or(0.0));
            target.weight.push(if depth.is_some() { 1.0 } else { 0.0 });
            if config.prior.has_normals() {
                target
                    .normal
                    .push(normal.unwrap_or(DVec3::ZERO).as_vec3().to_array());
            }
        }
        target
    };
    let views = scene.train.par_iter().zip(depths);
    Ok(views.map(target).collect())
}

/// Returns a canonical depth in the form that is compared.
fn compared(depth: f32, config: &Config) -> f32 {
    match config.prior.compares_inverse() {
        true => 1.0 / depth,
        false => depth,
    }
}

/// Takes what files say of a view; masks, confidence and what is no depth decide the weights.
fn of_files(view: &View, frame: &Frame, config: &Config) -> DepthTarget {
    let n = view.image.width as usize * view.image.height as usize;
    let Some(prior) = &view.prior else {
        return DepthTarget {
            depth: vec![0.0; n],
            weight: vec![0.0; n],
            normal: Vec::new(),
        };
    };
    let confidence = |i: usize| match &prior.confidence {
        _ if !view.counts(i) => 0.0,
        Some(confidence) if confidence[i].is_finite() => confidence[i].max(0.0),
        Some(_) => 0.0,
        None => 1.0,
    };
    let form = |depth: f32| {
        let is_there = depth > 0.0 && depth.is_finite();
        let depth = match config.prior.depths {
            PriorDepths::Metric => compared((f64::from(depth) / frame.radius) as f32, config),
            PriorDepths::Relative | PriorDepths::Inverse => depth,
        };
        Some(depth).filter(|depth| is_there && depth.is_finite())
    };
    let depths = prior.depth.as_ref();
    let depth: Vec<Option<f32>> = (0..n).map(|i| form(depths?[i])).collect();
    let weight = |i: usize| {
        if depth[i].is_some() {
            confidence(i)
        } else {
            0.0
        }
    };
    let normal = |(i, n): (usize, &[f32; 3])| n.map(|n| confidence(i) * n);
    let normals = prior.normal.as_ref();
    DepthTarget {
        weight: (0..n).map(weight).collect(),
        depth: depth.iter().map(|depth| depth.unwrap_or(0.0)).collect(),
        normal: normals.map_or_else(Vec::new, |n| n.iter().enumerate().map(normal).collect()),
    }
}
