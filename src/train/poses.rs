//! This module has the trainer's cameras: the training views' poses, refined if the config asks for
//! it.

use super::capacity::uniform;
use super::refine::{RefinedPose, pose_rates};
use super::supervision::TrainingView;
use super::trainer::Trainer;
use crate::camera::Camera;
use crate::error::Result;
use crate::render::read_totals;

impl Trainer<'_> {
    /// Moves the real view's camera by what the step just submitted has found, where poses are
    /// refined.
    pub(super) fn refine(&mut self, iteration: u32, real: usize) -> Result<()> {
        let config = self.config;
        let share = self.settling.rate(iteration);
        let rates = pose_rates(&config.poses, iteration, config.iterations);
        let rates = rates.map(|rate| share * rate);
        let Some(refinement) = &mut self.refinement else {
            return Ok(());
        };
        // A step whose pairs did not fit has no gradient; it is taken again.
        if read_totals(self.gpu, &self.workspace)?.overflow_step != 0 {
            return Ok(());
        }
        let view = &self.supervision.real[real];
        let camera = refinement.step(self.gpu, real, view, rates)?;
        self.real[real] = uniform(&camera, self.supervision, config);
        Ok(())
    }

    /// Returns the training cameras now, canonical frame.
    pub(super) fn cameras(&self) -> Vec<Camera> {
        let views = self.supervision.real.iter().enumerate();
        let camera = |(k, view): (usize, &TrainingView)| match self.poses() {
            Some(poses) => poses[k].camera(view),
            None => view.camera.clone(),
        };
        views.map(camera).collect()
    }

    /// Returns the refined poses, `None` unless the config asks for them.
    pub(super) fn poses(&self) -> Option<&Vec<RefinedPose>> {
        self.refinement.as_ref().map(|r| &r.poses)
    }

    /// Takes up poses of a state.
    pub(super) fn set_poses(&mut self, poses: Vec<RefinedPose>) {
        for (k, pose) in poses.iter().enumerate() {
            let camera = pose.camera(&self.supervision.real[k]);
            self.real[k] = uniform(&camera, self.supervision, self.config);
        }
        if let Some(refinement) = &mut self.refinement {
            refinement.poses = poses;
        }
    }
}
