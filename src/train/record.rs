//! This module has what a training run notes as it goes, and what it leaves.

use serde::{Deserialize, Serialize};

use super::depths::DepthLosses;
use crate::camera::Camera;
use crate::gaussians::Gaussians;

/// The losses of one iteration; means over all pixels, of a virtual view over its valid ones. A partner's pseudo view stands
/// where the virtual view else does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LossSample {
    /// Number of finished iterations.
    pub iteration: u32,
    /// `L_real + alpha_k L_virt`, and the weighted losses of depths and normals.
    pub loss: f64,
    /// The training view's, before its weight.
    pub real: ImageLoss,
    /// The loss of the iteration's virtual view, before its weight; null without virtual views.
    pub virt: Option<ImageLoss>,
    /// Those of the training view's depths and normals, before their weights, where it is held to some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depths: Option<DepthLosses>,
}

/// The parts of an image loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageLoss {
    /// Mean absolute difference from the target image.
    pub l1: f64,
    /// Mean SSIM, at most 1; the loss takes `1 - ssim`.
    pub ssim: f64,
}

/// How many Gaussians a densification or pruning step touched, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlanCounts {
    /// Gaussians that got a copy of themselves.
    pub cloned: usize,
    /// Gaussians that two smaller ones replaced.
    pub split: usize,
    /// Gaussians added half-way to a neighbour that is far away.
    #[serde(default)]
    pub unpooled: usize,
    /// Gaussians removed for an opacity below the least.
    pub pruned_opacity: usize,
    /// Gaussians removed because they are large in space or on screen.
    pub pruned_size: usize,
    /// Gaussians removed by the paper's coverage-aware rule: `a_i` is above `tau_i`.
    pub pruned_anisotropy: usize,
    /// Gaussians removed because they lie apart from all others.
    #[serde(default)]
    pub pruned_outliers: usize,
    /// Gaussians removed because they contribute least to the views.
    #[serde(default)]
    pub pruned_contribution: usize,
    /// Gaussians removed because the partner's are all far away.
    #[serde(default)]
    pub pruned_apart: usize,
    /// Gaussians removed because they float before a surface.
    #[serde(default)]
    pub pruned_floaters: usize,
}

/// A change of the set of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlanRecord {
    /// Number of finished iterations.
    pub iteration: u32,
    /// Gaussians after it.
    pub n_gaussians: usize,
    /// Gaussians touched, by reason.
    pub counts: PlanCounts,
}

/// What the held-out views say of the Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SignalPoint {
    /// Number of finished iterations.
    pub iteration: u32,
    /// Gaussians of the model.
    pub n_gaussians: usize,
    /// Mean PSNR of the held-out virtual views over their visible pixels, dB.
    pub held_out: f64,
    /// The same of up to 16 training photographs, evenly over all; null where masks leave nothing of them.
    pub photographs: Option<f64>,
}

/// A pruning by contribution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trim {
    /// Number of finished iterations.
    pub iteration: u32,
    /// Gaussians before it.
    pub n_before: usize,
    /// Gaussians after it; as before where pruning would not have paid.
    pub n_after: usize,
    /// What it was allowed to cost, dB.
    pub allowed_db: f64,
    /// Gaussians that went beyond that, whatever they cost, for the file to have the size that it may.
    #[serde(default)]
    pub over_budget: usize,
    /// By how much the PSNR of the held-out views fell, or would have had their error risen as the photographs' did; below 0 if it rose.
    pub cost_db: f64,
    /// Share of all that Gaussians contribute to the views that went with them.
    pub contribution: f64,
}

/// SH degrees of the Gaussians as they were lowered after training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lowering {
    /// Gaussians of degree 0, 1, 2 and 3 after it.
    pub of_degree: [usize; 4],
    /// What it was allowed to cost, dB.
    pub allowed_db: f64,
    /// What it cost at once, dB, as prunings are measured.
    pub cost_db: f64,
}

/// The outcome of a training run.
pub struct Trained {
    /// The trained Gaussians, canonical frame.
    pub gaussians: Gaussians,
    /// The training cameras, refined where the config asks for it; canonical frame.
    pub cameras: Vec<Camera>,
    /// Losses on the way: of every tenth iteration, of the last, and of those that densification,
    /// pruning or an opacity reset follows.
    pub samples: Vec<LossSample>,
    /// Every densification and pruning step, in order.
    pub plans: Vec<PlanRecord>,
    /// What the held-out views said on the way.
    pub signal: Vec<SignalPoint>,
    /// Prunings by contribution, in order.
    pub trims: Vec<Trim>,
    /// How far SH degrees were lowered; `None` where none was to be.
    pub lowering: Option<Lowering>,
    /// Number of iterations that it took.
    pub iterations: u32,
}
