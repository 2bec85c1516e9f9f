//! What a training run notes as it goes, and what it leaves.

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
    pub real: ImageLoss,
    /// The loss of the iteration's virtual view, before its weight; null without virtual views.
    pub virt: Option<ImageLoss>,
}

/// The parts of an image loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageLoss {
    pub l1: f64,
    pub ssim: f64,
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

/// A change of the set of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlanRecord {
    /// Number of finished iterations.
    pub iteration: u32,
    /// Gaussians after it.
    pub n_gaussians: usize,
    pub counts: PlanCounts,
}

/// What a training run leaves.
pub struct Trained {
    /// Canonical frame.
    pub gaussians: Gaussians,
    /// The training cameras, refined where the config asks for it; canonical frame.
    pub cameras: Vec<Camera>,
    pub samples: Vec<LossSample>,
    pub plans: Vec<PlanRecord>,
}
