//! This module has what a training run notes as it goes, and what it leaves.

use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::gaussians::Gaussians;

/// The losses of one iteration; means over all pixels, of a virtual view over its valid ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LossSample {
    /// Number of finished iterations.
    pub iteration: u32,
    /// `L_real + alpha_k L_virt`.
    pub loss: f64,
    /// The training view's, before its weight.
    pub real: ImageLoss,
    /// The loss of the iteration's virtual view, before its weight; null without virtual views.
    pub virt: Option<ImageLoss>,
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
    /// Gaussians removed for an opacity below the least.
    pub pruned_opacity: usize,
    /// Gaussians removed because they are large in space or on screen.
    pub pruned_size: usize,
    /// Gaussians removed by the paper's coverage-aware rule: `a_i` is above `tau_i`.
    pub pruned_anisotropy: usize,
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
}
