//! This module hands over between two sets of Gaussians on the GPU: renders, which become the other's target
//! images at 8 bits a channel, and the news that a step did not fit.

use super::PSEUDO_SLOT;
use crate::gpu::shader::{self, Sources};
use crate::gpu::{Commands, Gpu, Kernel, Stage};
use crate::render::{ViewUniform, Workspace};

/// The kernels of this stage, which only partners need.
pub struct ExchangeKernels {
    hand_over: Kernel,
    share_overflow: Kernel,
}

impl Default for ExchangeKernels {
    /// Takes the program's own shaders.
    fn default() -> ExchangeKernels {
        Self::from_sources(&shader::compose)
    }
}

impl ExchangeKernels {
    /// Takes other sources than the program's.
    pub fn from_sources(sources: Sources<'_>) -> ExchangeKernels {
        let stage = Stage::new("exchange", sources("exchange", 0));
        ExchangeKernels {
            hand_over: stage.kernel("hand_over"),
            share_overflow: stage.kernel("share_overflow"),
        }
    }
}

/// Bind groups of two sets' buffers.
pub struct Exchange {
    /// From the first to the second, and back.
    hand_over: [wgpu::BindGroup; 2],
    share_overflow: wgpu::BindGroup,
}

impl Exchange {
    /// Binds the buffers of two workspaces that train, whichever comes first.
    pub fn new(gpu: &Gpu, kernels: &ExchangeKernels, [a, b]: [&Workspace; 2]) -> Exchange {
        let hand_over = |from: &Workspace, to: &Workspace| {
            let buffers = [
                ("view", from.of_slot("view", PSEUDO_SLOT)),
                ("rendered", from.buffer("rendered")),
                ("goal", to.of_slot("goal", PSEUDO_SLOT)),
            ];
            kernels.hand_over.bind(gpu, &buffers)
        };
        let totals = [
            ("totals", a.buffer("totals")),
            ("other_totals", b.buffer("totals")),
        ];
        Exchange {
            hand_over: [hand_over(a, b), hand_over(b, a)],
            share_overflow: kernels.share_overflow.bind(gpu, &totals),
        }
    }

    /// Records that each set's render of the pseudo view, which is the last of its renders, becomes the target
    /// image of the other's.
    pub fn hand_over(
        &self,
        commands: &mut Commands<'_>,
        kernels: &ExchangeKernels,
        view: &ViewUniform,
    ) {
        for group in &self.hand_over {
            commands.dispatch(&kernels.hand_over, group, view.plane_len() as u64);
        }
    }

    /// Records that a step which one set has no room for, and every later one, is left out by both.
    pub fn share_overflow(&self, commands: &mut Commands<'_>, kernels: &ExchangeKernels) {
        commands.dispatch(&kernels.share_overflow, &self.share_overflow, 1);
    }
}
