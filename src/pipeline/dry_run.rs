//! A dry run tells what a training run would take, from its first iterations.

use std::time::Instant;

use super::train::fitted;
use super::{Forecast, Prepared, TrainJob, prepare};
use crate::cloud::agreement::Agreement;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::render::Kernels;
use crate::run::{Seconds, peak_host_bytes};
use crate::train::Trainer;

/// Iterations that warm up kernels and buffers, and iterations that are timed.
const N_WARM: u32 = 4;
const N_TIMED: u32 = 8;

/// A run as it starts. Nothing of it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct DryRun {
    /// The scene's source: what was loaded from where.
    pub scene: String,
    /// Photographs that are trained on.
    pub n_training_views: usize,
    /// Views that errors are measured at.
    pub n_test_views: usize,
    /// Points of the scene's cloud as loaded, before carving.
    pub n_points: usize,
    /// Iterations that the whole run would take.
    pub n_iterations: u32,
    /// Gaussians that training starts from, those of the far shell among them.
    pub n_gaussians: usize,
    /// Gaussians at which growth stops; `None` if nothing grows.
    pub max_gaussians: Option<usize>,
    /// Virtual views that are trained on.
    pub n_virtual_views: usize,
    /// Width and height of the first training view, pixels.
    pub image_size: [u32; 2],
    /// Seconds before the first iteration: field, sampling, splatting.
    pub prepare_s: f64,
    /// Seconds an iteration, measured over the first ones.
    pub iteration_s: f64,
    /// How cloud and training views agree.
    pub agreement: Agreement,
    /// Predicted memory of the whole run.
    pub memory: Forecast,
    /// Most bytes that buffers held so far.
    pub gpu_bytes: u64,
    /// Peak resident set of the process in bytes; `None` where the system does not tell.
    pub host_bytes: Option<u64>,
}

/// Loads and prepares the scene of `job` and takes the first iterations of training.
///
/// # Errors
/// What training refuses.
pub fn dry_run(job: &TrainJob) -> Result<DryRun> {
    let gpu = &Gpu::open()?;
    let (scene, config) = (job.load()?, &job.config);
    for warning in &scene.warnings {
        log::warn!("{warning}");
    }
    let agreement = Agreement::of(&scene)?;
    for warning in &agreement.warnings {
        log::warn!("{warning}");
    }
    let begin = Instant::now();
    let prepared = prepare(&scene, config, &mut Seconds::default())?;
    for warning in &prepared.warnings {
        log::warn!("{warning}");
    }
    let prepare_s = begin.elapsed().as_secs_f64();
    let config = fitted(config, gpu, prepared.start.len())?;
    let memory = Forecast::new(gpu, &scene, &prepared, &config);
    let Prepared {
        supervision, start, ..
    } = prepared;
    let kernels = Kernels::new(gpu);
    let mut trainer = Trainer::new(gpu, &kernels, &start, &supervision, &config)?;
    let mut run = |from: u32, n: u32| -> Result<f64> {
        let begin = Instant::now();
        for iteration in from..from + n {
            trainer.step(iteration, None);
        }
        // Steps that overflowed are taken again, with room, as training does.
        while trainer.make_room()?.is_some() {
            trainer.step(from, None);
        }
        gpu.wait()?;
        Ok(begin.elapsed().as_secs_f64())
    };
    run(0, N_WARM)?;
    let timed_s = run(N_WARM, N_TIMED)?;
    let camera = &supervision.real[0].camera;
    Ok(DryRun {
        n_training_views: scene.train.len(),
        n_test_views: scene.test.len(),
        n_points: scene.cloud.len(),
        scene: scene.source,
        n_iterations: config.iterations,
        n_gaussians: start.len(),
        max_gaussians: config
            .densify
            .enabled
            .then_some(config.densify.max_gaussians),
        n_virtual_views: supervision.virtual_views.len(),
        image_size: [camera.width, camera.height],
        prepare_s,
        iteration_s: timed_s / f64::from(N_TIMED),
        agreement,
        memory,
        gpu_bytes: gpu.peak_bytes(),
        host_bytes: peak_host_bytes(),
    })
}
