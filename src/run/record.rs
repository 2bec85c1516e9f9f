//! This module has what `metrics.json` holds.
//!
//! Everything that may differ between two equal runs is under `seconds` and `memory`.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::config::RasterizerChoice;
use crate::scene::PoseProtocol;
use crate::train::{LossSample, Lowering, PlanCounts, SignalPoint, Trim};

/// The record of a training run, `metrics.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// This program's version.
    pub version: String,
    /// The commit that it was built from; null where that was not known.
    #[serde(default)]
    pub commit: Option<String>,
    /// The GPU adapter's name, driver and backend.
    pub adapter: String,
    /// The rasterizer that rendered on it; null in files of older versions.
    #[serde(default)]
    pub rasterizer: Option<RasterizerChoice>,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// Iterations that it took.
    pub iterations: u32,
    /// The scene, with what of it was taken.
    pub scene: SceneRecord,
    /// Wall-clock seconds of each stage.
    pub seconds: Seconds,
    /// Peak memory of the process and of the GPU.
    pub memory: Memory,
    /// Joules that the machine's processors took while it trained; null where the machine does not tell, and in a run
    /// that was resumed.
    #[serde(default)]
    pub energy_j: Option<f64>,
    /// Losses on the way, in the order of iterations.
    pub loss: Vec<LossSample>,
    /// Numbers of Gaussians: at the start, and after every densification or pruning step.
    pub model_size: Vec<ModelSize>,
    /// How far each training camera's pose was moved; empty where they were held.
    #[serde(default)]
    pub refined_poses: Vec<PoseChange>,
    /// Errors at the test views on the way, the last those of `eval.json`; empty unless asked for.
    #[serde(default)]
    pub curve: Vec<CurvePoint>,
    /// What the virtual views that are held out said on the way; empty where none is.
    #[serde(default)]
    pub signal: Vec<SignalPoint>,
    /// Prunings by contribution.
    #[serde(default)]
    pub trims: Vec<Trim>,
    /// How SH degrees were lowered after training; null where none was to be.
    #[serde(default)]
    pub lowering: Option<Lowering>,
    /// What the run chose for its scene and why, a sentence each; empty where all was stated.
    #[serde(default)]
    pub chosen: Vec<String>,
}

/// The change that refinement made to a training camera's pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseChange {
    /// Name of the training view.
    pub view: String,
    /// Angle between the given and the refined rotation, degrees.
    pub turn_deg: f64,
    /// How far the optical centre moved, in shares of the sphere's radius.
    pub shift: f64,
}

/// Mean errors over the test views after some iterations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Number of finished iterations.
    pub iteration: u32,
    /// Gaussians of the model then.
    pub n_gaussians: usize,
    /// Seconds of training alone until then; null in files of older versions.
    #[serde(default)]
    pub train_s: Option<f64>,
    /// dB; null for an identical image.
    pub psnr: Option<f64>,
    /// At most 1; null if no test view was measured.
    pub ssim: Option<f64>,
}

/// The scene that a run was trained on, enough to load it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord {
    /// An absolute folder, or `builtin:WIDTH`: what `--scene` takes.
    pub source: String,
    /// The cloud where it is not the scene's own: what `--cloud` takes, a file absolute.
    pub cloud: Option<String>,
    /// Short name for tables.
    pub name: String,
    /// Names of the training views, in the scene's order.
    pub train_views: Vec<String>,
    /// Names of the test views, in the scene's order.
    pub test_views: Vec<String>,
    /// Number of test views that were trained on, too: more than 0 only where a study asked for it,
    /// and no figure at them tells of places that were not seen.
    #[serde(default)]
    pub n_test_trained: usize,
    /// Points in the cloud as loaded.
    pub n_points: usize,
    /// Checksum of their places, colours and confidences; null in files of older versions.
    #[serde(default)]
    pub cloud_crc32: Option<u32>,
    /// What the photographs of the training and then the test views show, in 8x8 cells; null in
    /// files of older versions.
    #[serde(default)]
    pub thumbnails: Option<Vec<String>>,
    /// Images from outside that virtual views show; null where there are none.
    #[serde(default)]
    pub virtual_images: Option<VirtualImages>,
    /// Points that each round of carving removed; null where it was off.
    pub carved_points: Option<Vec<usize>>,
    /// How the test cameras came into the frame of the training cameras.
    pub pose_protocol: PoseProtocol,
}

/// Images from outside that virtual views show in place of the cloud's splats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VirtualImages {
    /// An absolute folder: what `--virtual-images` takes.
    pub folder: String,
    /// Multiplies the weight of those views.
    pub weight: f64,
}

impl SceneRecord {
    /// Names the scene in the folder `dir`, and a cloud that lay in its old folder there, too.
    pub(super) fn moved_to(&mut self, dir: &Path) {
        if let Some(cloud) = &mut self.cloud
            && let Ok(within) = Path::new(&cloud).strip_prefix(&self.source)
        {
            *cloud = dir.join(within).display().to_string();
        }
        self.source = dir.display().to_string();
    }
}

/// The request that an unfinished run was started with, beyond its config.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobRecord {
    /// The scene, with what of it is taken.
    pub scene: SceneRecord,
    /// Iterations between two points of the curve, where there is one.
    pub eval_every: Option<u32>,
    /// Iterations between two checkpoints, where stated.
    pub checkpoint_every: Option<u32>,
}

/// Wall-clock seconds of each stage; null where a stage was not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Seconds {
    /// Opening the adapter.
    pub open: Option<f64>,
    /// Reading the scene: cameras, photographs and cloud.
    pub load: Option<f64>,
    /// Focus, camera potential and coverage.
    pub field: Option<f64>,
    /// Carving the cloud; null if the config does not ask for it.
    pub carve: Option<f64>,
    /// Choosing the virtual cameras.
    pub sample: Option<f64>,
    /// Splatting the cloud into the virtual views.
    pub splat: Option<f64>,
    /// The first Gaussians, with their scales from the nearest points.
    pub gaussians: Option<f64>,
    /// Writing files before training, and taking checksums of what is learnt from.
    pub files: Option<f64>,
    /// Compiling the compute pipelines of the first iteration.
    pub compile: Option<f64>,
    /// Buffers allocated and filled, and a checkpoint read where the run is resumed.
    pub upload: Option<f64>,
    /// From the command to the first iteration: all of the above.
    pub to_first_iteration: Option<f64>,
    /// Part of `train`; where the run was profiled.
    pub first_iteration: Option<f64>,
    /// All iterations, with what is noted on the way.
    pub train: Option<f64>,
    /// Part of `train`: densification, pruning and opacity resets.
    pub densify: Option<f64>,
    /// Part of `train`: measuring the virtual views that are held out, and pruning by them; null where none is.
    #[serde(default)]
    pub signal: Option<f64>,
    /// Writing checkpoints, a part of `train`.
    pub checkpoints: Option<f64>,
    /// Writing the trained model.
    pub write: Option<f64>,
    /// Rendering and measuring the test views.
    pub eval: Option<f64>,
    /// The run's page; in `profile.json` alone.
    pub report: Option<f64>,
}

impl Seconds {
    /// Returns the seconds from loading the scene to the written model, without any evaluation;
    /// `None` if it was not trained.
    pub fn to_model(&self) -> Option<f64> {
        let beside = [
            self.load,
            self.field,
            self.carve,
            self.sample,
            self.splat,
            self.gaussians,
            self.files,
            self.compile,
            self.upload,
            self.write,
        ];
        Some(beside.iter().flatten().sum::<f64>() + self.train?)
    }
}

/// Peak memory in bytes; null where it cannot be told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// Peak resident set of the process.
    pub host_peak_bytes: Option<u64>,
    /// Most bytes that GPU buffers held at one time.
    pub gpu_peak_bytes: Option<u64>,
}

/// Number of Gaussians after an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelSize {
    /// Number of finished iterations; 0 for the start.
    pub iteration: u32,
    /// Gaussians after it.
    pub n_gaussians: usize,
    /// The step that changed the number, by reason; null for the start.
    pub plan: Option<PlanCounts>,
}
