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
    /// The set beside this one, whose buffers follow; `None` unless there is a partner.
    #[serde(default)]
    pub partner: Option<SetSize>,
    /// Parameters of the network that makes the Gaussians, which follow with their moments as `f32`; 0 without one.
    #[serde(default)]
    pub generator: usize,
}

/// A set of Gaussians and the room for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetSize {
    /// Gaussians in the buffers, at most `stride`.
    pub n_gaussians: usize,
    /// Entries a plane of the buffers.
    pub stride: usize,
}

impl State {
    /// Returns the size of the first set.
    pub(super) fn own_set(&self) -> SetSize {
        SetSize {
            n_gaussians: self.n_gaussians,
            stride: self.stride,
        }
    }

    /// Returns the sizes of the sets.
    pub(super) fn sets(&self) -> impl Iterator<Item = SetSize> + use<> {
        [self.own_set()].into_iter().chain(self.partner)
    }

    /// Returns the `vec4f`s of each buffer, set by set: the blocks of the parameters, of the first and of the
    /// second moment, the statistics.
    pub(super) fn buffer_lens(&self) -> Vec<usize> {
        let lens = |set: SetSize| set.buffer_lens(self.sh_degree);
        self.sets().flat_map(lens).collect()
    }
}

impl SetSize {
    /// Returns the `vec4f`s of each buffer of the set.
    pub(super) fn buffer_lens(&self, sh_degree: u32) -> Vec<usize> {
        let planes = &BLOCK_PLANES[..n_blocks(sh_degree)];
        let planes = [planes, planes, planes, &[1]].concat();
        planes.iter().map(|planes| planes * self.stride).collect()
    }
}
