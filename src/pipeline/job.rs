//! What a training run is asked for.

use std::path::Path;
use std::time::Instant;

use super::{load_scene, train};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::eval::EvalOptions;
use crate::gpu::Gpu;
use crate::run::{Evaluation, RunDir};
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

    /// Loads, trains and evaluates as `options` say into the run directory `out`; a run that is there is replaced
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
        RunDir::check(out, overwrite)?;
        // Before anything takes time or is written: a machine without an adapter is told at once,
        // and the same command works once it has one.
        let gpu = Gpu::open()?;
        log::info!("adapter: {}", gpu.describe());
        let start = Instant::now();
        let scene = self.load()?;
        let load_s = start.elapsed().as_secs_f64();
        options.check(&scene.test)?;
        for warning in &scene.warnings {
            log::warn!("{warning}");
        }
        let run = RunDir::create(out, &self.config, overwrite)?;
        let evaluation = train(&gpu, &scene, self, load_s, options, &run)?;
        Ok((run, evaluation))
    }
}
