//! This module trains a scene: the stages run in a row, timed, into a run directory.

use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use glam::DVec3;

use super::calibrate::{calibrated, with_most_iterations};
use super::chosen::{chosen, lowered};
use super::job::record;
use super::keep::{Identity, Keeper, Log};
use super::measure::{Clouds, Seen, Subject, measure};
use super::outputs::{all_cameras, model_sizes, pose_changes, write_virtual_sheet};
use super::profile::Sampler;
use super::watch::{Curve, Watch, curve_point};
use super::{Clock, Forecast, Prepared, TrainJob, cameras, prepare};
use crate::camera::Camera;
use crate::camera::json::write_cameras;
use crate::config::Config;
use crate::error::{Error, ErrorKind, Result};
use crate::eval::EvalOptions;
use crate::gaussians::ply::write_ply;
use crate::gpu::Gpu;
use crate::live::{self, Phase};
use crate::render::{Device, Kernels, Renderer, most_gaussians};
use crate::report::write_run_page;
use crate::run::{
    COUNTERS, EnergyMeter, Evaluation, JobRecord, Memory, Metrics, PoseChange, RunDir, RunProfile,
    SceneRecord, Seconds, StepProfile, Stop, peak_host_bytes,
};
use crate::scene::{PointCloud, Scene};
use crate::terminal::progress::Progress;
use crate::train::{Trained, Trainer};
use crate::version::{COMMIT, VERSION};

/// Time that a command has taken before training; the default is one that begins now.
#[derive(Default)]
pub struct SoFar {
    /// Runs since the command began.
    pub clock: Clock,
    /// What its stages took.
    pub seconds: Seconds,
}

/// Trains on `scene`, which is `job`'s, evaluates at its test views as `options` say and writes all
/// into `run`. Goes on from the run's newest checkpoint if there is one, and once more from there
/// if the device is lost on the way.
pub fn train(
    gpu: &Gpu,
    scene: &Scene,
    job: &TrainJob,
    so_far: SoFar,
    options: &EvalOptions,
    run: &RunDir,
    stop: &Stop,
) -> Result<Evaluation> {
    let SoFar {
        mut clock,
        mut seconds,
    } = so_far;
    options.check(&scene.test)?;
    // The stamp is that of the files as they are now: a mask drawn while training runs was not
    // loaded.
    let stamp = job.source.stamp(job.cloud.as_ref());
    run.write_job(&JobRecord {
        scene: record(scene, job),
        eval_every: job.eval_every,
        checkpoint_every: job.checkpoint_every,
    })?;
    let mut files_s = clock.lap();
    let kernels = Kernels::of(&job.config.render, gpu)?;
    let mut prepared = thread::scope(|scope| {
        scope.spawn(|| kernels.prepare(gpu));
        prepare(scene, &job.config, &mut seconds)
    })?;
    if let Some(images) = &job.virtual_images {
        prepared.take_images(scene, images)?;
    }
    clock.lap();
    let config = fitted(&job.config, gpu, prepared.start.len())?;
    let given = job.config.need.iteration_s;
    let calibrated = calibrated(gpu, &prepared, &job.config)?;
    let job = &TrainJob {
        config: calibrated,
        ..job.clone()
    };
    let config = Config {
        need: job.config.need.clone(),
        ..config
    };
    let config = with_most_iterations(config, scene.train.len());
    if job.config.need.iteration_s != given {
        run.write_config(&job.config)?;
    }
    for warning in &prepared.warnings {
        log::warn!("{warning}");
    }
    if let Some(carved) = &prepared.carved {
        log_carving(&carved.removed, scene.cloud.len());
    }
    let task = Task {
        scene,
        job,
        config,
        prepared,
        options,
        stamp,
        run,
        stop,
    };
    let Prepared {
        virtual_cameras,
        supervision,
        start,
        ..
    } = &task.prepared;
    let n_points = task.cloud().len();
    let n_shell = supervision.shell.map_or(0, |shell| shell.count());
    let n_scene = start.len() - n_shell;
    log::info!("{n_scene} Gaussians from {n_points} points");
    if n_shell > 0 {
        log::info!("{n_shell} Gaussians in the far shell");
    }
    if !supervision.held_out.is_empty() {
        log::info!(
            "{} virtual views to train on, {} held out",
            supervision.virtual_views.len(),
            supervision.held_out.len()
        );
    }
    let forecast = Forecast::new(gpu, scene, &task.prepared, &task.config);
    log::info!("memory, predicted\n{}", forecast.tables());
    write_virtual_sheet(run, &supervision.virtual_views)?;
    let train = cameras(&scene.train);
    let offset = task.prepared.frame.offset();
    if offset != DVec3::ZERO {
        log::info!(
            "positions are stored without the offset {} {} {}, which point_cloud.ply and cameras.json note",
            offset.x,
            offset.y,
            offset.z
        );
    }
    let all = all_cameras(scene, train, virtual_cameras);
    write_cameras(&run.cameras(), &all, offset)?;
    if let Some(live) = &job.watch {
        live.subject(live::Subject {
            name: run.name(),
            cameras: all,
            frame: task.prepared.frame,
            config: task.config.clone(),
            scene: Some(record(scene, job)),
        });
    }
    files_s += clock.lap();
    seconds.files = Some(files_s);
    match task.attempt(gpu, &kernels, &mut clock, seconds) {
        Err(e) if e.kind() == ErrorKind::DeviceLost => {
            log::warn!("{e}; trying once more");
            clock.lap();
            let gpu = &Gpu::open()?;
            let kernels = Kernels::of(&job.config.render, gpu)?;
            task.attempt(gpu, &kernels, &mut clock, seconds)
        }
        outcome => outcome,
    }
}

/// All that training needs but the GPU.
struct Task<'a> {
    scene: &'a Scene,
    job: &'a TrainJob,
    /// The job's, as the adapter can hold it.
    config: Config,
    prepared: Prepared,
    options: &'a EvalOptions,
    /// Stamp of the scene's files when they were loaded.
    stamp: Option<String>,
    run: &'a RunDir,
    stop: &'a Stop,
}

impl Task<'_> {
    /// Returns the cloud, as carved.
    fn cloud(&self) -> &PointCloud {
        let carved = self.prepared.carved.as_ref();
        carved.map_or(&self.scene.cloud, |c| &c.cloud)
    }

    /// Trains, evaluates and writes the results; `seconds` are those of the stages before.
    fn attempt(
        &self,
        gpu: &Gpu,
        kernels: &Kernels,
        clock: &mut Clock,
        mut seconds: Seconds,
    ) -> Result<Evaluation> {
        let Task {
            scene,
            job,
            prepared,
            run,
            ..
        } = self;
        let (trained, log, step) = self.train(gpu, kernels, clock, &mut seconds)?;
        let Trained {
            gaussians,
            cameras,
            samples,
            plans,
            signal,
            trims,
            lowering,
            iterations,
        } = trained;
        let mut chosen = chosen(
            prepared.virtual_cameras.len(),
            iterations,
            &signal,
            &trims,
            &self.config,
        );
        chosen.extend(lowering.as_ref().map(lowered));
        for sentence in &chosen {
            log::info!("{sentence}");
        }
        let gaussians = match self.config.need.chooses() {
            true => gaussians.without_empty_degrees(),
            false => gaussians,
        };
        if let Some(live) = &job.watch {
            live.show(iterations, gaussians.base(), Duration::ZERO);
            live.phase(Phase::Measuring);
        }
        write_ply(&run.point_cloud(), &gaussians, &prepared.frame)?;
        // What is measured is what was written.
        drop(gaussians);
        let refined_poses = self.write_refined(&cameras)?;
        seconds.write = Some(clock.lap());
        let (config, frame) = (&job.config, &prepared.frame);
        let device = Device { gpu, kernels };
        let subject = Subject {
            run,
            config,
            options: self.options,
            own: Seen {
                views: &scene.test,
                frame,
            },
            clouds: Clouds {
                whole: &scene.cloud,
                used: self.cloud(),
            },
            aligned: None,
            scene_stamp: self.stamp.clone(),
            pose_protocol: scene.pose_protocol,
            train_s: seconds.train,
        };
        let evaluation = measure(device, subject)?;
        seconds.eval = Some(clock.lap() + log.curve_s);
        let mut curve = log.curve;
        let point = curve_point(iterations, &evaluation);
        if let Some(live) = &job.watch {
            live.tested(&point);
        }
        if job.eval_every.is_some() {
            curve.push(point);
        }
        gpu.check()?;
        run.write_metrics(&Metrics {
            version: VERSION.to_owned(),
            commit: COMMIT.map(str::to_owned),
            adapter: gpu.describe(),
            rasterizer: Some(kernels.rasterizer.choice()),
            seed: config.seed,
            iterations,
            scene: SceneRecord {
                carved_points: prepared.carved.as_ref().map(|c| c.removed.clone()),
                ..record(scene, job)
            },
            seconds,
            memory: Memory {
                host_peak_bytes: peak_host_bytes(),
                gpu_peak_bytes: Some(gpu.peak_bytes()),
            },
            energy_j: log.energy_j,
            loss: samples,
            model_size: model_sizes(prepared.start.len(), &plans),
            refined_poses,
            curve,
            signal,
            trims,
            lowering,
            chosen,
        })?;
        clock.lap();
        write_run_page(run, &scene.test, frame)?;
        seconds.report = Some(clock.lap());
        if let Some(step) = step {
            run.write_profile(&RunProfile {
                adapter: gpu.describe(),
                seconds,
                step,
            })?;
        }
        // Nothing is left to resume.
        run.checkpoints().clear()?;
        if let Some(live) = &job.watch {
            live.phase(Phase::Finished);
        }
        Ok(evaluation)
    }

    /// Writes the training cameras of the canonical frame in place of those that the scene came
    /// with, and says how far they are from them; leaves all as it is where they were held.
    fn write_refined(&self, cameras: &[Camera]) -> Result<Vec<PoseChange>> {
        if !self.job.config.poses.refine {
            return Ok(Vec::new());
        }
        let frame = &self.prepared.frame;
        let world = cameras.iter().map(|c| frame.camera_to_world(c));
        let all = all_cameras(self.scene, world.collect(), &self.prepared.virtual_cameras);
        write_cameras(&self.run.cameras(), &all, frame.offset())?;
        Ok(pose_changes(cameras, &self.prepared.supervision.real))
    }

    /// Runs all iterations that are left and adds the parts' times to `seconds`.
    fn train(
        &self,
        gpu: &Gpu,
        kernels: &Kernels,
        clock: &mut Clock,
        seconds: &mut Seconds,
    ) -> Result<(Trained, Log, Option<StepProfile>)> {
        let Task {
            scene,
            job,
            prepared,
            run,
            stop,
            ..
        } = self;
        let config = &self.config;
        let identity = Identity::new(gpu, &job.config, scene, prepared)?;
        seconds.files = Some(seconds.files.unwrap_or(0.0) + clock.lap());
        let mut keeper = Keeper::new(run, stop, identity, job.checkpoint_every, config.iterations);
        let (start, supervision) = (&prepared.start, &prepared.supervision);
        let mut trainer = Trainer::new(gpu, kernels, start, supervision, config)?;
        let log = keeper.resume(&mut trainer)?;
        seconds.upload = Some(clock.lap());
        trainer.compile();
        clock.lap();
        seconds.compile = Some(trainer.seconds().compile);
        seconds.to_first_iteration = Some(clock.total());
        let state = trainer.state();
        let done = state.done;
        if let Some(live) = &job.watch {
            live.begin(&state, &log.curve, config.loss.ssim_weight);
        }
        let (before_s, kept_s) = (log.train_s, log.keep_s);
        let mut watch = Watch {
            progress: Progress::new(config.iterations).from(done),
            curve: job.eval_every.map(|every| Curve {
                every,
                renderer: Renderer::new(gpu, kernels),
                views: &scene.test,
                frame: &prepared.frame,
                config,
                options: EvalOptions {
                    lpips: None,
                    ..self.options.clone()
                },
            }),
            keeper,
            sampler: job
                .profile
                .then(|| Sampler::new(gpu, done, config.iterations)),
            live: job.watch.as_ref(),
            gpu,
            before_s: log.train_s + log.curve_s,
            clock: Instant::now(),
            log,
            iterations: config.iterations,
        };
        let gentle = stop.gentle();
        // A run that goes on has taken more than this process sees.
        let meter = EnergyMeter::start(Path::new(COUNTERS)).filter(|_| done == 0);
        let trained = trainer.run(&mut watch);
        // The iterations have a clock of their own, which goes on where an interrupted run is resumed.
        clock.lap();
        drop(gentle);
        watch.log.energy_j = meter.and_then(|meter| meter.joules());
        watch.log.train_s = watch.train_s();
        watch.progress.finish();
        let trained = trained?;
        let log = watch.log;
        seconds.train = Some(log.train_s);
        seconds.densify = Some(trainer.seconds().densify);
        seconds.signal = (!supervision.held_out.is_empty()).then_some(trainer.seconds().signal);
        seconds.checkpoints = Some(log.keep_s);
        seconds.first_iteration = watch.sampler.as_ref().and_then(Sampler::first_s);
        let trained_s = log.train_s - before_s - (log.keep_s - kept_s);
        let step = watch.sampler.map(|sampler| sampler.finish(trained_s));
        Ok((trained, log, step))
    }
}

/// Logs how many of `n_points` each round took.
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

/// Returns the config with its cap on Gaussians lowered to what the adapter can bind.
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
