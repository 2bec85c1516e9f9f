//! A job says what a training run is asked for.

use super::load_scene;
use super::moved::thumbnail;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::live::Live;
use crate::run::{SceneRecord, VirtualImages};
use crate::scene::{CloudSource, LoadOptions, PriorFiles, Scene, SceneSource, View};

/// A single training view has no pseudo-focus to put virtual views around.
const MIN_TRAIN_VIEWS: usize = 2;

/// A scene, what of it is taken, how it is trained, and what is noted on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainJob {
    /// A folder is absolute, so that the run can be evaluated from anywhere.
    pub source: SceneSource,
    /// Names of the views; `None`: the scene's own split.
    pub train_views: Option<Vec<String>>,
    /// Names of the views; `None`: the scene's own split.
    pub test_views: Option<Vec<String>>,
    /// Whether a view may be named in both lists, which a study of what is left to gain asks for.
    pub overlap: bool,
    /// The cloud to take; `None`: the scene's own.
    pub cloud: Option<CloudSource>,
    /// Images from outside that virtual views show; `None`: none.
    pub virtual_images: Option<VirtualImages>,
    /// The resolved config.
    pub config: Config,
    /// Iterations between two points of the curve in `metrics.json`; `None`: no curve.
    pub eval_every: Option<u32>,
    /// Iterations between two checkpoints; `None`: about a minute.
    pub checkpoint_every: Option<u32>,
    /// Whether `profile.json` is written.
    pub profile: bool,
    /// The page that shows the training as it runs; `None`: none.
    pub watch: Option<Live>,
}

impl TrainJob {
    /// Makes a job with a scene's own split and cloud, without a curve.
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
            overlap: false,
            cloud: None,
            virtual_images: None,
            config,
            eval_every: None,
            checkpoint_every: None,
            profile: false,
            watch: None,
        })
    }

    /// Makes the job of a run whose scene was `record`, without a curve.
    ///
    /// # Errors
    /// A folder that is no longer there.
    pub fn recorded(record: &SceneRecord, config: Config) -> Result<TrainJob> {
        Ok(TrainJob {
            train_views: Some(record.train_views.clone()),
            test_views: Some(record.test_views.clone()),
            overlap: record.n_test_trained > 0,
            cloud: cloud_of(record)?,
            virtual_images: record.virtual_images.clone(),
            ..Self::new(record.source.parse()?, config)?
        })
    }

    /// Does what [`TrainJob::load`] does for a job that was recorded.
    pub fn load_again(&self) -> Result<Scene> {
        // What is wrong is the scene, not the command.
        self.load_with(None).map_err(|e| {
            Error::new(format!("the scene is no longer as it was trained on: {e}"))
                .way_out("restore its files, or train again")
        })
    }

    /// Loads or makes the scene.
    ///
    /// # Errors
    /// What loading refuses, and a scene with too few training views for the config.
    pub fn load(&self) -> Result<Scene> {
        self.load_with(PriorFiles::of(&self.config))
    }

    fn load_with(&self, priors: Option<PriorFiles>) -> Result<Scene> {
        let options = LoadOptions {
            train_views: self.train_views.clone(),
            test_views: self.test_views.clone(),
            overlap: self.overlap,
            cloud: self.cloud.clone(),
            priors,
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
}

/// Returns the cloud that is not the scene's own, if there is one.
pub(super) fn cloud_of(record: &SceneRecord) -> Result<Option<CloudSource>> {
    record.cloud.as_deref().map(str::parse).transpose()
}

/// Records the scene before it is carved.
pub(super) fn record(scene: &Scene, job: &TrainJob) -> SceneRecord {
    let names = |views: &[View]| views.iter().map(|view| view.camera.name.clone()).collect();
    SceneRecord {
        source: job.source.to_string(),
        cloud: job.cloud.as_ref().map(ToString::to_string),
        name: scene.name.clone(),
        train_views: names(&scene.train),
        test_views: names(&scene.test),
        n_test_trained: scene.n_test_trained(),
        n_points: scene.cloud.len(),
        cloud_crc32: Some(scene.cloud.crc32()),
        thumbnails: Some(
            scene
                .train
                .iter()
                .chain(&scene.test)
                .map(thumbnail)
                .collect(),
        ),
        virtual_images: job.virtual_images.clone(),
        carved_points: None,
        pose_protocol: scene.pose_protocol,
    }
}
