//! A training run from the command on: started anew, or gone on with.

use std::path::Path;

use super::Clock;
use super::job::TrainJob;
use super::train::train;
use crate::cloud::agreement::Agreement;
use crate::error::Result;
use crate::eval::EvalOptions;
use crate::gpu::Gpu;
use crate::run::{Evaluation, RunDir, Seconds, Stop};
use crate::scene::Scene;

impl TrainJob {
    /// Loads, trains and evaluates into the run directory `out`; a run that is there is replaced
    /// with `overwrite` and refused without.
    ///
    /// # Errors
    /// Anything that fails on the way. Nothing is written before the scene is loaded.
    pub fn run(
        &self,
        out: &Path,
        overwrite: bool,
        options: &EvalOptions,
    ) -> Result<(RunDir, Evaluation)> {
        let (mut clock, mut seconds) = (Clock::start(), Seconds::default());
        RunDir::check(out, overwrite)?;
        // Before anything takes time or is written: a machine without an adapter is told at once,
        // and the same command works once it has one.
        let gpu = open_gpu()?;
        seconds.open = Some(clock.lap());
        let scene = announced(self.load()?)?;
        seconds.load = Some(clock.lap());
        options.check(&scene.test)?;
        let run = RunDir::create(out, &self.config, overwrite)?;
        let stop = Stop::on_signals()?;
        let so_far = (clock, seconds);
        let evaluation = train(&gpu, &scene, self, so_far, options, &run, &stop)?;
        Ok((run, evaluation))
    }

    /// Goes on with the run in `root` where it was stopped, measures it as `options` say;
    /// `checkpoint_every` replaces what it was started with, and `profile` asks for `profile.json`.
    ///
    /// # Errors
    /// No run, another process at work on it, a scene or config that is not what it was, and
    /// anything that fails on the way.
    pub fn resume(
        root: &Path,
        (checkpoint_every, profile): (Option<u32>, bool),
        options: &EvalOptions,
    ) -> Result<Resumed> {
        let (mut clock, mut seconds) = (Clock::start(), Seconds::default());
        let run = RunDir::claim(root)?;
        if run.is_finished() {
            run.checkpoints().clear()?;
            return Ok(Resumed {
                run,
                evaluation: None,
            });
        }
        let record = run.job()?;
        let gpu = open_gpu()?;
        seconds.open = Some(clock.lap());
        let job = TrainJob {
            eval_every: record.eval_every,
            checkpoint_every: checkpoint_every.or(record.checkpoint_every),
            profile,
            ..Self::recorded(&record.scene, run.config()?)?
        };
        let scene = announced(job.load_again()?)?;
        seconds.load = Some(clock.lap());
        let stop = Stop::on_signals()?;
        let so_far = (clock, seconds);
        let evaluation = train(&gpu, &scene, &job, so_far, options, &run, &stop)?;
        Ok(Resumed {
            run,
            evaluation: Some(evaluation),
        })
    }
}

/// What [`TrainJob::resume`] did.
pub struct Resumed {
    pub run: RunDir,
    /// None where the run was finished already.
    pub evaluation: Option<Evaluation>,
}

fn open_gpu() -> Result<Gpu> {
    let gpu = Gpu::open()?;
    log::info!("adapter: {}", gpu.describe());
    Ok(gpu)
}

/// Says what was taken of a scene and what is wrong with it.
///
/// # Errors
/// A cloud that no training view sees.
fn announced(scene: Scene) -> Result<Scene> {
    log::info!("scene: {}", scene.source);
    for warning in &scene.warnings {
        log::warn!("{warning}");
    }
    for warning in &Agreement::of(&scene)?.warnings {
        log::warn!("{warning}");
    }
    Ok(scene)
}
