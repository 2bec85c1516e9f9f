//! The stages in a row, as the commands call them.

use std::path::PathBuf;

use crate::config::Config;
use crate::error::{Error, Result};
use crate::run::{Evaluation, RunDir};
use crate::scene::{LoadOptions, Scene, SceneSource};

/// What `render` renders.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderJob {
    /// A Gaussian PLY file.
    pub model: PathBuf,
    pub cameras: CameraSource,
    /// Otherwise a scene's test views, or every camera of a file.
    pub views: Option<ViewSelection>,
    pub out: PathBuf,
    pub format: RenderFormat,
}

/// Where `render` takes its cameras from.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSource {
    Scene(SceneSource),
    /// A run's `cameras.json`.
    File(PathBuf),
}

/// Which cameras `render` renders.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewSelection {
    Train,
    Test,
    Virtual,
    Names(Vec<String>),
}

/// File format of `render`'s images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum RenderFormat {
    /// 8 bit, clamped.
    Png,
    /// 32-bit float, unclamped.
    Exr,
}

/// Loads or makes the scene.
pub fn load_scene(_source: &SceneSource, _options: &LoadOptions) -> Result<Scene> {
    Err(unavailable("loading a scene"))
}

/// Trains on `scene`, evaluates at its test views and writes all into `run`; `load_s` is how
/// long loading took.
pub fn train(
    _scene: &Scene,
    _source: &SceneSource,
    _config: &Config,
    _load_s: f64,
    _run: &RunDir,
) -> Result<Evaluation> {
    Err(unavailable("training"))
}

/// Renders the test views of a run from its model and measures them; writes `eval.json` and
/// `test/` anew.
pub fn evaluate(_run: &RunDir) -> Result<Evaluation> {
    Err(unavailable("evaluation"))
}

/// Renders a model; returns the number of images written.
pub fn render(_job: &RenderJob) -> Result<usize> {
    Err(unavailable("rendering"))
}

/// The one place that refuses what this build has no stage for.
fn unavailable(what: &str) -> Error {
    Error::new(format!("{what} is not part of this build"))
}
