//! This module hands the trainer's steps their target images: from the GPU where they stay there, or
//! unpacked and uploaded.

use super::supervision::{Supervision, TrainingView};
use super::trainer::Trainer;
use crate::config::Config;
use crate::error::Result;
use crate::gpu::constants::LEVEL_MAX;
use crate::gpu::{Commands, Gpu};
use crate::render::{Targets, ViewUniform};

impl Trainer<'_> {
    /// Uploads the target images that stay on the GPU; `views` are the real ones and then the virtual
    /// ones.
    ///
    /// # Errors
    /// A request that the adapter cannot hold.
    pub(super) fn upload_targets(
        gpu: &Gpu,
        views: &[ViewUniform],
        supervision: &Supervision,
        config: &Config,
    ) -> Result<Targets> {
        let trained: Vec<&TrainingView> = supervision.trained().collect();
        let budget = Targets::budget(config.render.targets_mib, gpu);
        Targets::upload(gpu, views, budget, |k, texels| {
            trained[k].goal.unpack(texels)
        })
    }

    /// Makes the target image of view `k` of all that of a slot; a cut-out subject stands before `background` there, RGB in
    /// multiples of 1/255, where there is one.
    pub(super) fn set_goal(
        &mut self,
        commands: &mut Commands<'_>,
        slot: usize,
        view: &TrainingView,
        uniform: &ViewUniform,
        k: usize,
        background: Option<[f64; 3]>,
    ) {
        let workspace = &self.workspace;
        let ground = background.filter(|_| view.has_ground);
        match self.targets.get(k) {
            Some(target) if ground.is_none() => workspace.copy_goal(commands, slot, target),
            _ => {
                view.goal.unpack(&mut self.goal);
                if let Some(color) = ground {
                    lay_ground(&mut self.goal, color);
                }
                workspace.set_goal(self.gpu, slot, uniform, &self.goal);
            }
        }
    }
}

/// Gives the pixels around a cut-out subject, whose alpha is 0, a colour.
fn lay_ground(goal: &mut [u32], color: [f64; 3]) {
    let [r, g, b] = color.map(|c| (LEVEL_MAX * c).round() as u8);
    let ground = u32::from_le_bytes([r, g, b, 0]);
    for texel in goal.iter_mut().filter(|texel| **texel >> 24 == 0) {
        *texel = ground;
    }
}
