//! This module leads a training run from the command on: it is started anew, or gone on with.

use std::path::Path;
use std::sync::Arc;

use super::job::TrainJob;
use super::train::{SoFar, train};
use crate::cloud::agreement::Agreement;
use crate::config::Config;
use crate::error::Result;
use crate::eval::EvalOptions;
use crate::gpu::{Exp2, Gpu};
use crate::live::Live;
use crate::render::rasterizer_for;
use crate::run::{Evaluation, RunDir, Stop};
use crate::scene::{Scene, SceneSource, View};

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
        let mut so_far = SoFar::default();
        RunDir::check(out, overwrite)?;
        // Before anything takes time or is written: a machine without an adapter is told at once,
        // and the same command works once it has one.
        let gpu = open_gpu()?;
        so_far.seconds.open = Some(so_far.clock.lap());
        let scene = shown(announced(self.load()?, self)?, self);
        so_far.seconds.load = Some(so_far.clock.lap());
        options.check(&scene.test)?;
        // What the rule gives this adapter is the run's from here on.
        let job = TrainJob {
            config: decided(&self.config, &gpu, &scene)?,
            ..self.clone()
        };
        let run = RunDir::create(out, &job.config, overwrite)?;
        let stop = Stop::on_signals()?;
        let evaluation = train(&gpu, &scene, &job, so_far, options, &run, &stop)?;
        Ok((run, evaluation))
    }

    /// Goes on with the run in `root` as `how` says, and measures it as `options` say.
    ///
    /// # Errors
    /// No run, another process at work on it, a scene or config that is not what it was, and
    /// anything that fails on the way.
    pub fn resume(root: &Path, how: GoOn, options: &EvalOptions) -> Result<Resumed> {
        let mut so_far = SoFar::default();
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
        so_far.seconds.open = Some(so_far.clock.lap());
        let job = TrainJob {
            eval_every: record.eval_every,
            checkpoint_every: how.checkpoint_every.or(record.checkpoint_every),
            profile: how.profile,
            watch: how.watch,
            ..Self::recorded(&record.scene, run.config()?)?
        };
        let scene = shown(announced(job.load_again()?, &job)?, &job);
        so_far.seconds.load = Some(so_far.clock.lap());
        let stop = Stop::on_signals()?;
        let evaluation = train(&gpu, &scene, &job, so_far, options, &run, &stop)?;
        Ok(Resumed {
            run,
            evaluation: Some(evaluation),
        })
    }
}

/// Options for going on with a run.
#[derive(Clone, Debug, Default)]
pub struct GoOn {
    /// Iterations between two checkpoints, in place of what the run was started with.
    pub checkpoint_every: Option<u32>,
    /// Whether `profile.json` is written.
    pub profile: bool,
    /// The page that shows the training as it runs; `None`: none.
    pub watch: Option<Live>,
}

/// The outcome of [`TrainJob::resume`].
pub struct Resumed {
    /// The run, still locked for this process.
    pub run: RunDir,
    /// Errors at the test views; `None` if the run was finished already.
    pub evaluation: Option<Evaluation>,
}

/// Returns the config with what it leaves to the adapter and the scene decided.
///
/// # Errors
/// A GPU fault.
pub(super) fn decided(config: &Config, gpu: &Gpu, scene: &Scene) -> Result<Config> {
    let mut config = config.clone();
    let pixels = |view: &View| view.image.width as usize * view.image.height as usize;
    let most = scene.train.iter().map(pixels).max().unwrap_or(0);
    let render = &mut config.render;
    let rasterizer = rasterizer_for(render.rasterizer, gpu, scene.cloud.len(), most);
    render.rasterizer = rasterizer.choice();
    render.exp2 = Exp2::of(render.exp2, gpu)?.choice();
    Ok(config)
}

fn open_gpu() -> Result<Gpu> {
    let gpu = Gpu::open()?;
    log::info!("adapter: {}", gpu.describe());
    Ok(gpu)
}

/// Has the scene's photographs shown on the job's page, if it has one.
fn shown(scene: Scene, job: &TrainJob) -> Arc<Scene> {
    let scene = Arc::new(scene);
    if let Some(live) = &job.watch {
        live.photographs(Arc::clone(&scene));
    }
    scene
}

/// Training pixels for each point beyond which a cloud fills no view, as one of structure from
/// motion.
const SPARSE_PX: usize = 100;

fn is_sparse(scene: &Scene) -> bool {
    let pixels = |view: &View| view.image.width as usize * view.image.height as usize;
    scene.train.iter().map(pixels).sum::<usize>() > SPARSE_PX * scene.cloud.len()
}

/// Says what was taken of a scene and what is wrong with it.
///
/// # Errors
/// A cloud that no training view sees.
fn announced(scene: Scene, job: &TrainJob) -> Result<Scene> {
    log::info!("scene: {}", scene.source);
    if let SceneSource::Folder(dir) = &job.source
        && job.cloud.is_none()
        && is_sparse(&scene)
    {
        log::info!(
            "the cloud is sparse, {} points; `gspotential scene --cameras {} --weights \
             model.safetensors --out dense.ply` makes a dense one, which --cloud dense.ply takes",
            scene.cloud.len(),
            dir.display()
        );
    }
    let n_trained = scene.n_test_trained();
    if n_trained > 0 {
        log::warn!(
            "{n_trained} of {} test views are trained on: errors at them say what the model can \
             hold, not what it can tell of places that it has not seen",
            scene.test.len()
        );
    }
    for warning in &scene.warnings {
        log::warn!("{warning}");
    }
    for warning in &Agreement::of(&scene)?.warnings {
        log::warn!("{warning}");
    }
    Ok(scene)
}
