//! This module evaluates a run at its scene's test views.

use std::path::Path;

use super::align;
use super::job::cloud_of;
use super::measure::{Clouds, Seen, Subject, measure, measured};
use super::moved::check_same;
use super::prepare::carved;
use super::{TrainJob, focus_of};
use crate::error::{Error, Result};
use crate::eval::{Alignment, EvalOptions};
use crate::gpu::Gpu;
use crate::render::{Device, Kernels};
use crate::report::{SceneRuns, write_comparison, write_run_page};
use crate::run::{Evaluation, RunDir, SceneRecord};
use crate::scene::PoseProtocol;
use crate::scene::SceneSource;

/// Returns the evaluation that `run` holds if it is that of its model, config and scene as they are
/// now, by this version, as `options` ask. It may have an LPIPS that they do not ask for. A scene
/// that is not there any more could not be measured again and counts as unchanged.
///
/// # Errors
/// A run without a readable model, config or metrics.
pub fn evaluation_at_hand(run: &RunDir, options: &EvalOptions) -> Result<Option<Evaluation>> {
    // Absent, damaged, or of another version: measured anew.
    let Ok(evaluation) = run.evaluation() else {
        return Ok(None);
    };
    let Some(held) = &evaluation.measured else {
        return Ok(None);
    };
    let record = run.metrics()?.scene;
    let stamp = stamp_of(&record)?;
    let mut now = measured(
        run,
        options,
        stamp,
        options.align.protocol(record.pose_protocol),
    )?;
    now.image_px = held.image_px;
    if now.scene_stamp.is_none() {
        now.scene_stamp = held.scene_stamp.clone();
    }
    if now.lpips.is_none() {
        now.lpips = held.lpips.clone();
    }
    let names = evaluation.views.iter().map(|view| &view.name);
    let is_current = now == *held && names.eq(&record.test_views);
    Ok(is_current.then_some(evaluation))
}

/// Renders the test views of a run from its model and measures them; writes `eval.json` and
/// `test/` and `report.html` anew.
///
/// # Errors
/// Another process at work on the run, a scene that is not what it was, and anything that fails on
/// the way.
pub fn evaluate(run: &RunDir, options: &EvalOptions) -> Result<Evaluation> {
    let run = &run.claimed()?;
    let config = run.config()?;
    let metrics = run.metrics()?;
    let protocol = metrics.scene.pose_protocol;
    if !matches!(
        protocol,
        PoseProtocol::SharedFrame | PoseProtocol::Interpolated
    ) {
        return Err(Error::new(format!(
            "the run's test cameras are {protocol}, which this version cannot do again"
        ))
        .at_path(run.root())
        .way_out("evaluate it with the version that made it"));
    }
    let job = TrainJob::recorded(&metrics.scene, config.clone()).map_err(|e| {
        e.at_path(run.root())
            .way_out("name the folder to which the scene has moved with --scene DIR")
    })?;
    let stamp = stamp_of(&metrics.scene)?;
    let scene = job.load_again().map_err(|e| e.at_path(run.root()))?;
    if run.has_moved_scene() {
        check_same(run, &metrics, &scene).map_err(|e| e.at_path(run.root()))?;
    }
    if scene.pose_protocol != protocol {
        return Err(Error::new(format!(
            "the scene's test cameras are {}, and were {protocol}",
            scene.pose_protocol
        ))
        .at_path(run.root())
        .way_out("restore its files, or train again"));
    }
    options
        .check(&scene.test)
        .map_err(|e| e.at_path(run.root()))?;
    let (_, frame) = focus_of(&scene)?;
    let carved = carved(&scene, &frame, &config)?;
    let clouds = Clouds {
        whole: &scene.cloud,
        used: carved.as_ref().map_or(&scene.cloud, |c| &c.cloud),
    };
    let gpu = Gpu::open()?;
    let kernels = Kernels::of(&config.render, &gpu)?;
    let device = Device {
        gpu: &gpu,
        kernels: &kernels,
    };
    let aligned = match options.align {
        Alignment::Shared => None,
        _ => Some(align::by_similarity(run, &scene, &frame)?),
    };
    let subject = Subject {
        run,
        config: &config,
        options,
        own: Seen {
            views: &scene.test,
            frame: &frame,
        },
        clouds,
        aligned,
        scene_stamp: stamp,
        pose_protocol: options.align.protocol(protocol),
        train_s: metrics.seconds.train,
    };
    let evaluation = measure(device, subject)?;
    write_run_page(run, &scene.test, &frame)?;
    Ok(evaluation)
}

/// Writes one page over several runs that have been evaluated.
///
/// # Errors
/// A scene that is no longer as a run was trained on it, or a file that cannot be read.
pub fn compare(runs: &[&RunDir], path: &Path) -> Result<()> {
    let mut scenes: Vec<SceneRuns> = Vec::new();
    for run in runs {
        let (config, metrics) = (run.config()?, run.metrics()?);
        if let Some(scene) = scenes.iter_mut().find(|s| s.is_of(&metrics.scene)) {
            scene.add(run)?;
            continue;
        }
        let loaded = TrainJob::recorded(&metrics.scene, config)
            .and_then(|job| job.load_again())
            .map_err(|e| e.at_path(run.root()))?;
        let mut scene = SceneRuns::new(&metrics.scene, &loaded.test, runs.len())?;
        scene.add(run)?;
        scenes.push(scene);
    }
    write_comparison(path, &scenes)
}

fn stamp_of(record: &SceneRecord) -> Result<Option<String>> {
    let source = record.source.parse::<SceneSource>()?;
    Ok(source.stamp(cloud_of(record)?.as_ref()))
}
