//! What `metrics.json` and `eval.json` hold.
//!
//! Everything that may differ between two equal runs is under `seconds` and `memory`
//! (`train_s` in `eval.json`).

use serde::{Deserialize, Serialize};

/// What a training run did: `metrics.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// This program's version.
    pub version: String,
    /// The GPU adapter's name, driver and backend.
    pub adapter: String,
    pub seed: u64,
    pub iterations: u32,
    pub scene: SceneRecord,
    pub seconds: Seconds,
    pub memory: Memory,
    pub loss: Vec<LossSample>,
    pub model_size: Vec<ModelSize>,
}

/// The scene that a run was trained on, enough to load it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord {
    /// An absolute folder, or `builtin:WIDTH`: what `--scene` takes.
    pub source: String,
    /// Short name for tables.
    pub name: String,
    pub train_views: Vec<String>,
    pub test_views: Vec<String>,
    /// Points in the cloud as loaded.
    pub n_points: usize,
    pub pose_protocol: PoseProtocol,
}

/// How the test cameras came into the frame of the training cameras. Figures under different
/// protocols do not compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseProtocol {
    /// The scene gives both in one frame.
    SharedFrame,
    /// Some were interpolated between training cameras and never fitted to their photographs
    /// (InstantSplat's starting values).
    Interpolated,
}

/// Wall-clock seconds of each stage; null where a stage was not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Seconds {
    pub load: Option<f64>,
    pub field: Option<f64>,
    pub sample: Option<f64>,
    pub splat: Option<f64>,
    pub train: Option<f64>,
    pub eval: Option<f64>,
}

/// Peak memory in bytes; null where it cannot be told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// Peak resident set of the process.
    pub host_peak_bytes: Option<u64>,
    /// Most bytes that GPU buffers held at one time.
    pub gpu_peak_bytes: Option<u64>,
}

/// The losses of one iteration; means over all pixels, of a virtual view over its valid ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LossSample {
    /// Number of finished iterations.
    pub iteration: u32,
    /// `L_real + alpha_k L_virt`.
    pub loss: f64,
    pub real: ImageLoss,
    /// Of the iteration's virtual view, before its weight; null without virtual views.
    pub virt: Option<ImageLoss>,
}

/// The parts of an image loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageLoss {
    pub l1: f64,
    pub ssim: f64,
}

/// Number of Gaussians after an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelSize {
    pub iteration: u32,
    pub n_gaussians: usize,
    /// What changed it; null for the start.
    pub plan: Option<PlanCounts>,
}

/// How many Gaussians a densification or pruning step touched, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlanCounts {
    pub cloned: usize,
    pub split: usize,
    pub pruned_opacity: usize,
    pub pruned_size: usize,
    pub pruned_anisotropy: usize,
}

/// Errors at the test views: `eval.json`. JSON has no infinity: the PSNR of an identical image
/// is written as null, as is what was not measured; a table says `inf` for the former.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    pub mean: Mean,
    pub views: Vec<ViewScore>,
    pub n_gaussians: usize,
    /// Seconds of training alone.
    pub train_s: Option<f64>,
    /// What the cloud gives without any training.
    pub point_splat: Option<PointSplatScore>,
}

/// Errors of the bare point splat of the cloud at the test views, black where no point falls.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointSplatScore {
    /// Means over the views; dB.
    pub psnr: Option<f64>,
    pub ssim: Option<f64>,
    /// Over covered pixels alone; dB.
    pub psnr_covered: Option<f64>,
    /// Mean share of covered pixels.
    pub coverage: f64,
}

/// Means over the views of their own values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    /// dB.
    pub psnr: Option<f64>,
    pub ssim: Option<f64>,
    pub lpips: Option<f64>,
}

/// Errors at one test view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    pub name: String,
    /// dB.
    pub psnr: Option<f64>,
    pub ssim: Option<f64>,
    pub lpips: Option<f64>,
}

impl Evaluation {
    /// With the means over `views`; a metric that a view lacks has no mean.
    pub fn new(views: Vec<ViewScore>, n_gaussians: usize, train_s: Option<f64>) -> Evaluation {
        let mean = |value: fn(&ViewScore) -> Option<f64>| mean(views.iter().map(value));
        Evaluation {
            mean: Mean {
                psnr: mean(|view| view.psnr),
                ssim: mean(|view| view.ssim),
                lpips: mean(|view| view.lpips),
            },
            views,
            n_gaussians,
            train_s,
            point_splat: None,
        }
    }
}

/// Mean of values that are all there.
pub fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let values = values.collect::<Option<Vec<f64>>>()?;
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Peak resident set of this process in bytes, where the system tells (Linux).
pub fn peak_host_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}
