//! What a training run is asked for.

use std::path::Path;

use super::{Clock, load_scene, train};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::eval::EvalOptions;
use crate::gpu::Gpu;
use crate::run::{Evaluation, RunDir, SceneRecord, Seconds, Stop};
use crate::scene::{CloudSource, LoadOptions, Scene, SceneSource};

/// A single training view has no pseudo-focus to put virtual views around.
const MIN_TRAIN_VIEWS: usize = 2;

/// A scene, what of it is taken, how it is trained, and what is noted on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainJob {
    /// A folder is absolute, so that the run can be evaluated from anywhere.
    pub source: SceneSource,
    /// Names; otherwise the scene's own split.
    pub train_views: Option<Vec<String>>,
    pub test_views: Option<Vec<String>>,
    /// Otherwise the scene's own.
    pub cloud: Option<CloudSource>,
    pub config: Config,
    /// Iterations between two points of the curve in `metrics.json`; otherwise it has none.
    pub eval_every: Option<u32>,
    /// Iterations between two checkpoints; otherwise about a minute.
    pub checkpoint_every: Option<u32>,
    /// Whether `profile.json` is written.
    pub profile: bool,
}

impl TrainJob {
    /// A scene's own split and cloud, without a curve.
    ///
    /// # Errors
    /// A folder that is not there.
    pub fn new(source: SceneSource, config: Config) -> Result<TrainJob> {
        let max_px = config.scene.max_size_px;
        let max_px = max_px.unwrap_or(config.scene.max_width_px);
        Ok(TrainJob {
            source: source.resolved()?.at_most(max_px),
            train_views: None,
            test_views: None,
            cloud: None,
            config,
            eval_every: None,
            checkpoint_every: None,
            profile: false,
        })
    }

    /// The job of a run whose scene was `record`, without a curve.
    ///
    /// # Errors
    /// A folder that is no longer there.
    pub fn recorded(record: &SceneRecord, config: Config) -> Result<TrainJob> {
        Ok(TrainJob {
            train_views: Some(record.train_views.clone()),
            test_views: Some(record.test_views.clone()),
            cloud: cloud_of(record)?,
            ..Self::new(record.source.parse()?, config)?
        })
    }

    /// [`TrainJob::load`] of a job that was recorded.
    pub fn load_again(&self) -> Result<Scene> {
        // What is wrong is the scene, not the command.
        self.load().map_err(|e| {
            Error::new(format!("the scene is no longer as it was trained on: {e}"))
                .way_out("restore its files, or train again")
        })
    }

    /// Loads or makes the scene.
    ///
    /// # Errors
    /// What loading refuses, and a scene with too few training views for the config.
    pub fn load(&self) -> Result<Scene> {
        let options = LoadOptions {
            train_views: self.train_views.clone(),
            test_views: self.test_views.clone(),
            cloud: self.cloud.clone(),
            ..LoadOptions::new(&self.config)
        };
        let scene = load_scene(&self.source, &options)?;
        if self.config.views.count > 0 && scene.train.len() < MIN_TRAIN_VIEWS {
            return Err(Error::new(format!(
                "virtual views need {MIN_TRAIN_VIEWS} training views, there are {}",
                scene.train.len()
            ))
            .at(format!("scene `{}`", scene.name))
            .way_out("name more with --train-views, or train with --preset 3dgs"));
        }
        Ok(scene)
    }

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
        let scene = announced(self.load()?);
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
        let scene = announced(job.load_again()?);
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

/// The cloud that is not the scene's own.
pub(super) fn cloud_of(record: &SceneRecord) -> Result<Option<CloudSource>> {
    record.cloud.as_deref().map(str::parse).transpose()
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
fn announced(scene: Scene) -> Scene {
    log::info!("scene: {}", scene.source);
    for warning in &scene.warnings {
        log::warn!("{warning}");
    }
    scene
}
