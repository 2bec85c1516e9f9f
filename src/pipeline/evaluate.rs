//! Evaluation of a run at its scene's test views.

use std::path::Path;

use super::align::{self, Aligned};
use super::job::cloud_of;
use super::prepare::carved;
use super::{TrainJob, focus_of};
use crate::camera::Frame;
use crate::config::Config;
use crate::digest::sha256;
use crate::error::{Error, Result, read_file};
use crate::eval::{self, Alignment, EvalOptions};
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::metrics::quantize;
use crate::render::Kernels;
use crate::report::{ContactSheet, SceneRuns, write_comparison, write_png, write_run_page};
use crate::run::{Evaluation, Measured, PoseProtocol, RunDir, SceneRecord, file_names};
use crate::scene::{PointCloud, SceneSource, View};

/// The evaluation that `run` holds, where it is that of its model, config and scene as they are
/// now, by this version, as `options` ask. Where they ask for no LPIPS it may have one. A scene
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
    let job =
        TrainJob::recorded(&metrics.scene, config.clone()).map_err(|e| e.at_path(run.root()))?;
    let stamp = stamp_of(&metrics.scene)?;
    let scene = job.load_again().map_err(|e| e.at_path(run.root()))?;
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
    let kernels = Kernels::new(&gpu);
    let device = (&gpu, &kernels);
    let what = (run, options, stamp, options.align.protocol(protocol));
    let own = Seen {
        views: &scene.test,
        frame: &frame,
    };
    let aligned = match options.align {
        Alignment::Shared => None,
        _ => Some(align::by_similarity(run, &scene, &frame)?),
    };
    let train_s = metrics.seconds.train;
    let evaluation = measure(device, (own, clouds), aligned, &config, what, train_s)?;
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

/// Test views and the canonical frame of what they show.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub views: &'a [View],
    pub frame: &'a Frame,
}

/// A scene's point cloud.
#[derive(Clone, Copy)]
pub(super) struct Clouds<'a> {
    /// As the scene has it. The pixels that it covers are those of every run on the scene.
    pub whole: &'a PointCloud,
    /// What the run made of it before training.
    pub used: &'a PointCloud,
}

/// Measures the model in `run` and the bare splat of the cloud at the scene's test views and writes
/// what it finds. The model is seen from the views as `aligned` where it does not share their frame.
pub(super) fn measure(
    device: (&Gpu, &Kernels),
    (own, clouds): (Seen<'_>, Clouds<'_>),
    aligned: Option<Aligned>,
    config: &Config,
    (run, options, scene_stamp, pose_protocol): (
        &RunDir,
        &EvalOptions,
        Option<String>,
        PoseProtocol,
    ),
    train_s: Option<f64>,
) -> Result<Evaluation> {
    // The file, not the model in memory: what is measured is what others will open.
    let gaussians = read_ply(&run.point_cloud())?;
    let frame = aligned.as_ref().map_or(own.frame, |a| &a.frame);
    let gaussians = gaussians.to_canonical(frame);
    let fit = |aligned| align::fitted(device, &gaussians, config, options.align, aligned);
    let aligned = aligned.map(fit).transpose()?;
    let Seen { views, frame } = aligned.as_ref().map_or(own, |aligned| Seen {
        views: &aligned.views,
        frame: &aligned.frame,
    });
    let names: Vec<&str> = views.iter().map(|view| view.camera.name.as_str()).collect();
    let files = file_names(&names, "png");
    let mut sheet = match views.first() {
        Some(View { image, .. }) => Some(ContactSheet::new(
            views.len(),
            2,
            image.width,
            image.height,
        )?),
        None => None,
    };
    let covered = eval::covered_pixels(clouds.whole, own.frame, own.views, config)?;
    let mut scores = Vec::with_capacity(views.len());
    eval::render_views(
        device,
        &gaussians,
        frame,
        views,
        &config.model,
        |view, rendered| {
            let image = quantize(rendered.width, rendered.height, &rendered.rgb)?;
            write_png(&run.test_views().join(&files[scores.len()]), &image)?;
            if let Some(sheet) = &mut sheet {
                sheet.add(&[&image, &view.image])?;
            }
            let covered = covered.get(scores.len()).map(Vec::as_slice);
            scores.push(eval::score(rendered, view, covered, options)?);
            Ok(())
        },
    )?;
    if let Some(sheet) = sheet {
        write_png(&run.test_sheet(), &sheet.finish())?;
    }
    let mut evaluation = Evaluation::new(scores, gaussians.len(), train_s);
    if !views.is_empty() {
        let splat = eval::score_point_splat(clouds.used, own.frame, own.views, config)?;
        evaluation.point_splat = Some(splat);
    }
    let mut measured = measured(run, options, scene_stamp, pose_protocol)?;
    measured.image_px = views.first().map(|v| [v.image.width, v.image.height]);
    evaluation.measured = Some(measured);
    run.write_evaluation(&evaluation)?;
    Ok(evaluation)
}

/// What an evaluation of `run` with `options` is an evaluation of, but for the image size.
fn measured(
    run: &RunDir,
    options: &EvalOptions,
    scene_stamp: Option<String>,
    pose_protocol: PoseProtocol,
) -> Result<Measured> {
    let point_cloud = read_file(&run.point_cloud())?;
    Ok(Measured {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        point_cloud_sha256: sha256(&point_cloud),
        point_cloud_bytes: point_cloud.len() as u64,
        config_sha256: sha256(&read_file(&run.config_file())?),
        scene_stamp,
        image_px: None,
        pose_protocol,
        renders: options.renders,
        lpips: options.lpips_record(),
    })
}
