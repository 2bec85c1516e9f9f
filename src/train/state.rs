//! The state of a training run between two iterations lies here, but for the buffers.

use serde::{Deserialize, Serialize};

use super::guide::Guide;
use super::record::{LossSample, PlanRecord, SignalPoint, Trim};
use super::refine::RefinedPose;
use crate::render::{BLOCK_PLANES, n_blocks};

/// A state but for the optimizer's buffers, which are large.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Number of finished iterations.
    pub done: u32,
    /// Gaussians in the buffers, at most `stride`.
    pub n_gaussians: usize,
    /// Entries a plane of the buffers.
    pub stride: usize,
    /// SH degree that the buffers have room for, 0 to 3.
    pub sh_degree: u32,
    /// Losses read so far.
    pub samples: Vec<LossSample>,
    /// Densification and pruning steps so far.
    pub plans: Vec<PlanRecord>,
    /// The training cameras' poses; `None` unless they are refined.
    pub poses: Option<Vec<RefinedPose>>,
    /// One a view; empty unless dropout is guided.
    pub guides: Vec<Guide>,
    /// What the held-out views have said so far.
    pub signal: Vec<SignalPoint>,
    /// Prunings by contribution so far.
    pub trims: Vec<Trim>,
}

impl State {
    /// Returns the `vec4f`s of each buffer: the blocks of the parameters, of both moments, the
    /// statistics.
    pub(super) fn buffer_lens(&self) -> Vec<usize> {
        let planes = &BLOCK_PLANES[..n_blocks(self.sh_degree)];
        let planes = [planes, planes, planes, &[1]].concat();
        planes.iter().map(|planes| planes * self.stride).collect()
    }
}
