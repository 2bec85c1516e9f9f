//! Poses of the training cameras refined with the Gaussians (as InstantSplat, Fan et al. 2024,
//! does; earlier BARF, Lin et al. 2021).
//!
//! Each training camera moves by Adam on the six motions of [`Camera::moved`], on the CPU in f64,
//! from a gradient that is read back every step. None is held: the cloud that the Gaussians start
//! from and the virtual views, which keep their poses, hold the frame; a camera held at a pose that
//! is off would drag the whole with it. What was made of the poses before training, the field and
//! the virtual views, stays as it is.

use serde::{Deserialize, Serialize};

use super::pose_adam::PoseAdam;
use super::supervision::TrainingView;
use super::trainer::Trainer;
use crate::camera::Camera;
use crate::config::PosesConfig;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::render::{Model, PoseGradient, PoseKernels, ViewUniform, Workspace, read_totals};

/// The training cameras on their way.
pub(super) struct Refinement {
    pub kernels: PoseKernels,
    /// None while it is bound to nothing.
    pub gradient: Option<PoseGradient>,
    pub poses: Vec<RefinedPose>,
}

/// A camera, canonical frame, and its optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefinedPose {
    /// Row by column, world to camera.
    rotation: [f64; 9],
    translation: [f64; 3],
    adam: PoseAdam,
}

impl Refinement {
    /// # Errors
    /// A buffer that the adapter cannot bind.
    pub fn new(
        gpu: &Gpu,
        workspace: &Workspace,
        model: &Model,
        views: &[TrainingView],
    ) -> Result<Refinement> {
        let kernels = PoseKernels::new(gpu);
        Ok(Refinement {
            gradient: Some(PoseGradient::new(gpu, &kernels, workspace, model)?),
            kernels,
            poses: views.iter().map(|v| RefinedPose::new(&v.camera)).collect(),
        })
    }

    /// Follows a workspace or model that has changed.
    pub fn rebind(&mut self, gpu: &Gpu, workspace: &Workspace, model: &Model) -> Result<()> {
        self.gradient = Some(PoseGradient::new(gpu, &self.kernels, workspace, model)?);
        Ok(())
    }

    /// Moves the camera of view `k` by the gradient of the step just done; returns it.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn step(
        &mut self,
        gpu: &Gpu,
        (k, view): (usize, &TrainingView),
        rates: [f64; 2],
    ) -> Result<Camera> {
        let pose = &mut self.poses[k];
        let Some(gradient) = &self.gradient else {
            return Ok(pose.camera(view));
        };
        let gradient = gradient.read(gpu)?;
        let camera = pose.adam.step(&pose.camera(view), gradient, rates);
        pose.set(&camera);
        Ok(camera)
    }
}

impl RefinedPose {
    fn new(camera: &Camera) -> RefinedPose {
        let mut pose = RefinedPose {
            rotation: [0.0; 9],
            translation: [0.0; 3],
            adam: PoseAdam::default(),
        };
        pose.set(camera);
        pose
    }

    fn set(&mut self, camera: &Camera) {
        self.rotation = camera.rotation.to_cols_array();
        self.translation = camera.translation.to_array();
    }

    /// The camera of `view` at this pose.
    pub fn camera(&self, view: &TrainingView) -> Camera {
        Camera {
            rotation: glam::DMat3::from_cols_array(&self.rotation),
            translation: glam::DVec3::from_array(self.translation),
            ..view.camera.clone()
        }
    }
}

impl Trainer<'_> {
    /// Moves the real view's camera by what the step just submitted has found, where poses are
    /// refined.
    pub(super) fn refine(&mut self, iteration: u32, real: usize) -> Result<()> {
        let config = self.config;
        let rates = pose_rates(&config.poses, iteration, config.iterations);
        let Some(refinement) = &mut self.refinement else {
            return Ok(());
        };
        // A step whose pairs did not fit has no gradient; it is taken again.
        if read_totals(self.gpu, &self.workspace)?.overflow_step != 0 {
            return Ok(());
        }
        let view = (real, &self.supervision.real[real]);
        let camera = refinement.step(self.gpu, view, rates)?;
        self.real[real] = ViewUniform::new(&camera, config.model.near, config.model.background);
        Ok(())
    }

    /// The training cameras now, canonical frame.
    pub(super) fn cameras(&self) -> Vec<Camera> {
        let views = self.supervision.real.iter().enumerate();
        let camera = |(k, view): (usize, &TrainingView)| match self.poses() {
            Some(poses) => poses[k].camera(view),
            None => view.camera.clone(),
        };
        views.map(camera).collect()
    }

    /// The refined poses, where the config asks for them.
    pub(super) fn poses(&self) -> Option<&Vec<RefinedPose>> {
        self.refinement.as_ref().map(|r| &r.poses)
    }

    /// Takes up poses of a state.
    pub(super) fn set_poses(&mut self, poses: Vec<RefinedPose>) {
        let model = &self.config.model;
        for (k, pose) in poses.iter().enumerate() {
            let camera = pose.camera(&self.supervision.real[k]);
            self.real[k] = ViewUniform::new(&camera, model.near, model.background);
        }
        if let Some(refinement) = &mut self.refinement {
            refinement.poses = poses;
        }
    }
}

/// Step sizes of turns (radians) and shifts (`R`) at `iteration` (from 0): exponential from the
/// first to the last. From the first iteration on, for Gaussians that have learned photographs from
/// poses that are off hold the poses there.
pub fn pose_rates(config: &PosesConfig, iteration: u32, iterations: u32) -> [f64; 2] {
    let progress = f64::from(iteration) / f64::from(iterations.max(1));
    [config.turn_lr, config.shift_lr].map(|rate| rate * config.rate_left.powf(progress))
}
