//! The stages run in a row here, as the commands call them.

mod align;
mod calibrate;
mod chosen;
mod depth;
mod dry_run;
mod evaluate;
mod export;
mod field;
mod job;
mod keep;
mod marks;
mod measure;
mod memory;
mod moved;
mod orbit;
mod outputs;
mod photographs;
mod posed;
mod prepare;
mod priors;
mod profile;
mod render;
mod returned;
mod start;
mod train;
mod view;
mod watch;

pub use dry_run::{DryRun, dry_run};
pub use evaluate::{compare, evaluate, evaluation_at_hand};
pub use export::{Distance, ExportJob, Size, export};
pub use field::{Advice, FieldMaps, FieldReport, Place, Uncovered, field};
pub use job::TrainJob;
pub use memory::Forecast;
pub use photographs::{PriorOptions, cloud_of_scene, scene_of_photographs};
pub use prepare::{Prepared, n_start, prepare};
pub use profile::{kernel_table, profile_tables};
pub use render::render;
pub use start::{GoOn, Resumed};
pub use train::{SoFar, train};
pub use view::view;

use std::path::PathBuf;
use std::time::Instant;

use crate::camera::{Camera, Frame};
use crate::error::Result;
use crate::field::Focus;
use crate::report::FilmTarget;
use crate::scene::{self, LoadOptions, Scene, SceneSource, View};

/// A request to `render`.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderJob {
    /// A Gaussian PLY file.
    pub model: PathBuf,
    /// The scene or camera file whose cameras are rendered.
    pub cameras: CameraSource,
    /// The views to render; `None`: a scene's test views, or every camera of a file, and for a path
    /// the training views where they are known.
    pub views: Option<ViewSelection>,
    /// So many views on a smooth path through the chosen ones, in place of them.
    pub path: Option<u32>,
    /// What is written.
    pub target: RenderTarget,
}

/// What `render` writes.
#[derive(Clone, Debug, PartialEq)]
pub enum RenderTarget {
    /// A file or more a view.
    Images(ImageFiles),
    /// All views as one film.
    Film(FilmTarget),
}

/// The image files of `render`.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageFiles {
    /// Folder for the images; created if it is not there.
    pub folder: PathBuf,
    /// File format of the colour images.
    pub format: RenderFormat,
    /// Expected depth beside each image, 32-bit float EXR, in the scene's unit.
    pub depth: bool,
    /// Opacity beside each image, 16-bit PNG.
    pub alpha: bool,
}

/// A source of cameras for `render`.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSource {
    /// A scene as `--scene` takes it: it has training, test and virtual views.
    Scene(SceneSource),
    /// A run's `cameras.json`.
    File(PathBuf),
}

/// Which cameras `render` renders.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewSelection {
    /// The training views of a scene, or of the run whose camera file it is.
    Train,
    /// The test views of a scene, or of the run whose camera file it is.
    Test,
    /// The virtual views: drawn anew for a scene, those of the run for a camera file.
    Virtual,
    /// Views by name, in this order.
    Names(Vec<String>),
    /// So many views around the focus; they become an animation, too.
    Orbit(u32),
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
pub fn load_scene(source: &SceneSource, options: &LoadOptions) -> Result<Scene> {
    match source {
        SceneSource::Folder(folder) => scene::load(folder, options),
        SceneSource::Builtin { width } => scene::load_builtin(*width, options),
        SceneSource::Object { width } => scene::load_object(*width, options),
    }
}

/// Finds focus and frame of a scene's training cameras.
///
/// # Errors
/// A camera layout without a sphere.
pub fn focus_of(scene: &Scene) -> Result<(Focus, Frame)> {
    let focus = Focus::find(&cameras(&scene.train), &scene.cloud)?;
    let frame = focus.frame();
    Ok((focus, frame))
}

fn cameras(views: &[View]) -> Vec<Camera> {
    views.iter().map(|view| view.camera.clone()).collect()
}

/// Wall-clock time of stages in a row.
pub struct Clock {
    start: Instant,
    last: Instant,
}

impl Default for Clock {
    fn default() -> Clock {
        Clock::start()
    }
}

impl Clock {
    /// Starts the clock and its first lap.
    pub fn start() -> Clock {
        let now = Instant::now();
        Clock {
            start: now,
            last: now,
        }
    }

    /// Returns the seconds since the last lap.
    pub fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let lap = now.duration_since(self.last).as_secs_f64();
        self.last = now;
        lap
    }

    /// Returns the seconds since the start.
    pub fn total(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}
