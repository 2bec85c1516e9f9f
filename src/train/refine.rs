//! Poses of the training cameras are refined with the Gaussians (as InstantSplat, Fan et al. 2024,
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
use crate::camera::Camera;
use crate::config::PosesConfig;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::render::{Model, PoseGradient, PoseKernels, Workspace};

/// The training cameras while they are refined.
pub(super) struct Refinement {
    pub kernels: PoseKernels,
    /// `None` while it is bound to nothing.
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
    /// Starts to refine the poses of `views`.
    ///
    /// # Errors
    /// A buffer that the adapter cannot bind.
    pub(crate) fn new(
        gpu: &Gpu,
        workspace: &Workspace,
        model: &Model,
        views: &[TrainingView],
    ) -> Result<Refinement> {
        let kernels = PoseKernels::default();
        Ok(Refinement {
            gradient: Some(PoseGradient::new(gpu, &kernels, workspace, model)?),
            kernels,
            poses: views.iter().map(|v| RefinedPose::new(&v.camera)).collect(),
        })
    }

    /// Follows a workspace or model that has changed.
    pub(crate) fn rebind(&mut self, gpu: &Gpu, workspace: &Workspace, model: &Model) -> Result<()> {
        self.gradient = Some(PoseGradient::new(gpu, &self.kernels, workspace, model)?);
        Ok(())
    }

    /// Moves the camera of view `k` by the gradient of the step just done; returns it.
    ///
    /// # Errors
    /// A GPU fault.
    pub(crate) fn step(
        &mut self,
        gpu: &Gpu,
        k: usize,
        view: &TrainingView,
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

    /// Returns the camera of `view` at this pose.
    pub fn camera(&self, view: &TrainingView) -> Camera {
        Camera {
            rotation: glam::DMat3::from_cols_array(&self.rotation),
            translation: glam::DVec3::from_array(self.translation),
            ..view.camera.clone()
        }
    }
}

/// Returns the step sizes of turns (radians) and shifts (`R`) at `iteration` (from 0): exponential
/// from the first to the last. They act from the first iteration on, since Gaussians that have
/// learned photographs from poses that are off hold the poses there.
pub fn pose_rates(config: &PosesConfig, iteration: u32, iterations: u32) -> [f64; 2] {
    let progress = f64::from(iteration) / f64::from(iterations.max(1));
    [config.turn_lr, config.shift_lr].map(|rate| rate * config.rate_left.powf(progress))
}
