//! A dry run tells what a training run would take, from its first iterations.

use std::time::Instant;

use super::calibrate::{iteration_s, with_most_iterations};
use super::start::decided;
use super::train::fitted;
use super::{Forecast, Prepared, TrainJob, prepare};
use crate::cloud::agreement::Agreement;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::run::{Seconds, peak_host_bytes};

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
    /// Whether the run may end before.
    pub may_end: bool,
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
    let scene = job.load()?;
    let config = &decided(&job.config, gpu, &scene)?;
    for warning in &scene.warnings {
        log::warn!("{warning}");
    }
    let agreement = Agreement::of(&scene)?;
    for warning in &agreement.warnings {
        log::warn!("{warning}");
    }
    let begin = Instant::now();
    let mut prepared = prepare(&scene, config, &mut Seconds::default())?;
    if let Some(images) = &job.virtual_images {
        prepared.take_images(&scene, images)?;
    }
    for warning in &prepared.warnings {
        log::warn!("{warning}");
    }
    let prepare_s = begin.elapsed().as_secs_f64();
    let config = fitted(config, gpu, prepared.start.len())?;
    let memory = Forecast::new(gpu, &scene, &prepared, &config);
    let iteration_s = iteration_s(gpu, &prepared, &config)?;
    let mut timed = config.clone();
    timed.need.iteration_s.get_or_insert(iteration_s);
    let Prepared {
        supervision, start, ..
    } = prepared;
    let camera = &supervision.real[0].camera;
    Ok(DryRun {
        n_training_views: scene.train.len(),
        n_test_views: scene.test.len(),
        n_points: scene.cloud.len(),
        scene: scene.source,
        n_iterations: with_most_iterations(timed, scene.train.len()).iterations,
        may_end: config.need.ends,
        n_gaussians: start.len(),
        max_gaussians: config
            .densify
            .enabled
            .then_some(config.densify.max_gaussians),
        n_virtual_views: supervision.virtual_views.len() + supervision.held_out.len(),
        image_size: [camera.width, camera.height],
        prepare_s,
        iteration_s,
        agreement,
        memory,
        gpu_bytes: gpu.peak_bytes(),
        host_bytes: peak_host_bytes(),
    })
}
