//! Training a scene: the stages in a row, timed, into a run directory.

use super::{Clock, Prepared, cameras, evaluate, prepare};
use crate::cameras_json::write_cameras;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::eval::EvalOptions;
use crate::gaussians::ply::write_ply;
use crate::gpu::Gpu;
use crate::progress::Progress;
use crate::render::{Kernels, most_gaussians};
use crate::report::{ContactSheet, mask_image, write_png};
use crate::run::{
    Evaluation, LossSample, Memory, Metrics, ModelSize, PoseProtocol, RunDir, SceneRecord, Seconds,
    peak_host_bytes,
};
use crate::scene::{Image, Scene, SceneSource, View};
use crate::train::{self, Observer, TrainingView};

/// Trains on `scene`, evaluates at its test views as `options` say and writes all into `run`;
/// `load_s` is how long loading took.
pub fn train(
    gpu: &Gpu,
    scene: &Scene,
    source: &SceneSource,
    config: &Config,
    load_s: f64,
    options: &EvalOptions,
    run: &RunDir,
) -> Result<Evaluation> {
    options.check(&scene.test)?;
    // Of the files as they are now: a mask that is drawn while training runs was not loaded.
    let stamp = source.stamp();
    let mut seconds = Seconds {
        load: Some(load_s),
        ..Seconds::default()
    };
    let Prepared {
        frame,
        virtual_cameras,
        supervision,
        start,
        warnings,
    } = prepare(scene, config, &mut seconds)?;
    for warning in &warnings {
        eprintln!("warning: {warning}");
    }
    let config = &fitted(config, gpu, start.len())?;
    eprintln!(
        "{} Gaussians from {} points",
        start.len() - config.shell.count,
        scene.cloud.len()
    );
    if config.shell.count > 0 {
        eprintln!("{} Gaussians in the far shell", config.shell.count);
    }
    write_virtual_sheet(run, &supervision.virtual_views)?;
    let all = [cameras(&scene.train), cameras(&scene.test), virtual_cameras].concat();
    write_cameras(&run.cameras(), &all)?;

    let mut clock = Clock::start();
    let kernels = Kernels::new(gpu);
    let mut log = Log {
        progress: Progress::new(config.iterations),
    };
    let trained = train::train(gpu, &kernels, &start, &supervision, config, &mut log)?;
    log.progress.finish();
    seconds.train = Some(clock.lap());
    write_ply(&run.point_cloud(), &trained.gaussians, &frame)?;

    clock.lap();
    let device = (gpu, &kernels);
    let train_s = seconds.train;
    let what = (run, options, stamp);
    let evaluation = evaluate::measure(device, scene, &frame, config, what, train_s)?;
    seconds.eval = Some(clock.lap());
    let names = |views: &[View]| views.iter().map(|view| view.camera.name.clone()).collect();
    run.write_metrics(&Metrics {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        adapter: gpu.describe(),
        seed: config.seed,
        iterations: config.iterations,
        scene: SceneRecord {
            source: source.to_string(),
            name: scene.name.clone(),
            train_views: names(&scene.train),
            test_views: names(&scene.test),
            n_points: scene.cloud.len(),
            pose_protocol: PoseProtocol::SharedFrame,
        },
        seconds,
        memory: Memory {
            host_peak_bytes: peak_host_bytes(),
            gpu_peak_bytes: Some(gpu.peak_bytes()),
        },
        loss: trained.samples,
        model_size: model_sizes(start.len(), &trained.plans),
    })?;
    Ok(evaluation)
}

/// The config with its cap on Gaussians lowered to what the adapter can bind.
///
/// # Errors
/// The start itself does not fit.
fn fitted(config: &Config, gpu: &Gpu, n_start: usize) -> Result<Config> {
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
        eprintln!("densification stops at {most} Gaussians, which is what the adapter can bind");
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
        let mask: Vec<u8> = goal.iter().map(|texel| texel.to_le_bytes()[3]).collect();
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

/// Shows the training's progress.
struct Log {
    progress: Progress,
}

impl Observer for Log {
    fn look(&mut self, sample: &LossSample, n_gaussians: usize) {
        self.progress
            .update(sample.iteration, sample.loss, n_gaussians);
    }
}
