//! Training a scene: the stages in a row, timed, into a run directory.

use std::time::Instant;

use super::{Clock, Prepared, TrainJob, cameras, evaluate, prepare};
use crate::camera::Frame;
use crate::cameras_json::write_cameras;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::eval::{self, EvalOptions};
use crate::gaussians::ply::write_ply;
use crate::gpu::Gpu;
use crate::progress::Progress;
use crate::render::{Kernels, Model, Renderer, most_gaussians};
use crate::report::{ContactSheet, mask_image, write_png, write_run_page};
use crate::run::{
    CurvePoint, Evaluation, LossSample, Memory, Metrics, ModelSize, PoseProtocol, RunDir,
    SceneRecord, Seconds, peak_host_bytes,
};
use crate::scene::{Image, Scene, View};
use crate::train::{self, Observer, TrainingView};

/// Trains on `scene`, which is `job`'s, evaluates at its test views as `options` say and writes all
/// into `run`;
/// `load_s` is how long loading took.
pub fn train(
    gpu: &Gpu,
    scene: &Scene,
    job: &TrainJob,
    load_s: f64,
    options: &EvalOptions,
    run: &RunDir,
) -> Result<Evaluation> {
    let config = &job.config;
    options.check(&scene.test)?;
    // Of the files as they are now: a mask that is drawn while training runs was not loaded.
    let stamp = job.source.stamp(job.cloud.as_ref());
    let mut seconds = Seconds {
        load: Some(load_s),
        ..Seconds::default()
    };
    let Prepared {
        frame,
        carved,
        virtual_cameras,
        supervision,
        start,
        warnings,
    } = prepare(scene, config, &mut seconds)?;
    for warning in &warnings {
        log::warn!("{warning}");
    }
    let cloud = carved.as_ref().map_or(&scene.cloud, |c| &c.cloud);
    if let Some(carved) = &carved {
        log_carving(&carved.removed, scene.cloud.len());
    }
    let config = &fitted(config, gpu, start.len())?;
    log::info!("{} Gaussians from {} points", start.len(), cloud.len());
    write_virtual_sheet(run, &supervision.virtual_views)?;
    let all = [cameras(&scene.train), cameras(&scene.test), virtual_cameras].concat();
    write_cameras(&run.cameras(), &all)?;

    let mut clock = Clock::start();
    let kernels = Kernels::new(gpu);
    let mut log = Log {
        progress: Progress::new(config.iterations),
        curve: job.eval_every.map(|every| Curve {
            every,
            renderer: Renderer::new(gpu, &kernels),
            views: &scene.test,
            frame: &frame,
            config,
            options: EvalOptions {
                lpips: None,
                ..options.clone()
            },
            points: Vec::new(),
            seconds: 0.0,
        }),
    };
    let trained = train::train(gpu, &kernels, &start, &supervision, config, &mut log)?;
    log.progress.finish();
    let (mut curve, curve_s) = log
        .curve
        .map_or((Vec::new(), 0.0), |c| (c.points, c.seconds));
    seconds.train = Some(clock.lap() - curve_s);
    write_ply(&run.point_cloud(), &trained.gaussians, &frame)?;

    clock.lap();
    let device = (gpu, &kernels);
    let seen = (scene.test.as_slice(), cloud);
    let train_s = seconds.train;
    let what = (run, options, stamp);
    let evaluation = evaluate::measure(device, seen, &frame, config, what, train_s)?;
    seconds.eval = Some(clock.lap() + curve_s);
    if job.eval_every.is_some() {
        curve.push(curve_point(config.iterations, &evaluation));
    }
    let names = |views: &[View]| views.iter().map(|view| view.camera.name.clone()).collect();
    run.write_metrics(&Metrics {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        adapter: gpu.describe(),
        seed: config.seed,
        iterations: config.iterations,
        scene: SceneRecord {
            source: job.source.to_string(),
            cloud: job.cloud.as_ref().map(ToString::to_string),
            name: scene.name.clone(),
            train_views: names(&scene.train),
            test_views: names(&scene.test),
            n_points: scene.cloud.len(),
            carved_points: carved.map(|c| c.removed),
            pose_protocol: PoseProtocol::SharedFrame,
        },
        seconds,
        memory: Memory {
            host_peak_bytes: peak_host_bytes(),
            gpu_peak_bytes: Some(gpu.peak_bytes()),
        },
        loss: trained.samples,
        model_size: model_sizes(start.len(), &trained.plans),
        curve,
    })?;
    write_run_page(run, &scene.test, &frame)?;
    Ok(evaluation)
}

/// How many of `n_points` each round took.
fn log_carving(removed: &[usize], n_points: usize) {
    let rounds: Vec<String> = removed.iter().map(usize::to_string).collect();
    log::info!(
        "carved {} of {n_points} points: {} in {} rounds",
        removed.iter().sum::<usize>(),
        if rounds.is_empty() {
            "none".to_owned()
        } else {
            rounds.join(" + ")
        },
        rounds.len()
    );
}

/// The config with its cap on Gaussians lowered to what the adapter can bind.
///
/// # Errors
/// The start itself does not fit.
pub(super) fn fitted(config: &Config, gpu: &Gpu, n_start: usize) -> Result<Config> {
    let most = most_gaussians(gpu, config.model.sh_degree);
    if n_start > most {
        return Err(Error::new(format!(
            "{n_start} Gaussians of SH degree {} do not fit: the adapter binds {} bytes at once, \
             enough for {most}",
            config.model.sh_degree,
            gpu.max_binding()
        ))
        .at(&gpu.info.name)
        .way_out(format!("start from fewer with --max-points {most}")));
    }
    let mut fitted = config.clone();
    if config.densify.enabled && config.densify.max_gaussians > most {
        log::info!("densification stops at {most} Gaussians, which is what the adapter can bind");
        fitted.densify.max_gaussians = most;
    }
    Ok(fitted)
}

fn write_virtual_sheet(run: &RunDir, views: &[TrainingView]) -> Result<()> {
    let Some(first) = views.first() else {
        return Ok(());
    };
    let (width, height) = (first.camera.width, first.camera.height);
    let mut sheet = ContactSheet::new(views.len(), 2, width, height)?;
    for TrainingView { camera, goal, .. } in views {
        let (width, height) = (camera.width, camera.height);
        let rgb = goal
            .iter()
            .flat_map(|t| t.to_le_bytes().into_iter().take(3))
            .collect();
        let mask: Vec<bool> = goal.iter().map(|&texel| texel >= 0xff00_0000).collect();
        sheet.add(&[
            &Image { width, height, rgb },
            &mask_image(width, height, &mask),
        ])?;
    }
    write_png(&run.virtual_sheet(), &sheet.finish())
}

fn model_sizes(start: usize, plans: &[train::PlanRecord]) -> Vec<ModelSize> {
    let first = ModelSize {
        iteration: 0,
        n_gaussians: start,
        plan: None,
    };
    let rest = plans.iter().map(|plan| ModelSize {
        iteration: plan.iteration,
        n_gaussians: plan.n_gaussians,
        plan: Some(plan.counts),
    });
    std::iter::once(first).chain(rest).collect()
}

/// Shows the training's progress, and measures on the way where a curve is asked for.
struct Log<'a> {
    progress: Progress,
    curve: Option<Curve<'a>>,
}

/// Errors at the test views every so many iterations. The last iteration's are those of the
/// written model, which are measured anyway.
struct Curve<'a> {
    every: u32,
    renderer: Renderer<'a>,
    views: &'a [View],
    frame: &'a Frame,
    config: &'a Config,
    /// Without LPIPS, which takes longer than many iterations.
    options: EvalOptions,
    points: Vec<CurvePoint>,
    /// Time spent here, which is not training's.
    seconds: f64,
}

fn curve_point(iteration: u32, evaluation: &Evaluation) -> CurvePoint {
    CurvePoint {
        iteration,
        n_gaussians: evaluation.n_gaussians,
        psnr: evaluation.mean.psnr,
        ssim: evaluation.mean.ssim,
    }
}

impl Observer for Log<'_> {
    fn inspects(&self, done: u32) -> bool {
        let due = |c: &Curve| done.is_multiple_of(c.every) && done < c.config.iterations;
        self.curve.as_ref().is_some_and(due)
    }

    fn inspect(&mut self, done: u32, model: &Model) -> Result<()> {
        let Some(curve) = &mut self.curve else {
            return Ok(());
        };
        let start = Instant::now();
        let (views, config) = (curve.views, &curve.config.model);
        let mut scores = Vec::with_capacity(views.len());
        let renderer = &mut curve.renderer;
        eval::render_model(
            renderer,
            model,
            curve.frame,
            views,
            config,
            |view, render| {
                scores.push(eval::score(render, view, &curve.options)?);
                Ok(())
            },
        )?;
        let evaluation = Evaluation::new(scores, model.n, None);
        curve.points.push(curve_point(done, &evaluation));
        curve.seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn look(&mut self, sample: &LossSample, n_gaussians: usize) {
        self.progress
            .update(sample.iteration, sample.loss, n_gaussians);
    }
}
