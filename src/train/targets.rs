//! This module hands the trainer's steps their target images: from the GPU where they stay there, or
//! unpacked and uploaded.

use super::supervision::{Supervision, TrainingView};
use super::trainer::Trainer;
use crate::config::Config;
use crate::error::Result;
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

    /// Makes the target image of view `k` of all that of a slot.
    pub(super) fn set_goal(
        &mut self,
        commands: &mut Commands<'_>,
        slot: usize,
        view: &TrainingView,
        uniform: &ViewUniform,
        k: usize,
    ) {
        let workspace = &self.workspace;
        match self.targets.get(k) {
            Some(target) => workspace.copy_goal(commands, slot, target),
            None => {
                view.goal.unpack(&mut self.goal);
                workspace.set_goal(self.gpu, slot, uniform, &self.goal);
            }
        }
    }
}
