//! This module holds training views to depths and normals beside their photographs.

use super::supervision::TrainingView;
use crate::config::{PriorConfig, PriorLoss, RenderedDepth};
use crate::error::Result;
use crate::gpu::{Commands, Gpu};
use crate::render::{
    DepthKernels, DepthLossKind, DepthLossUniform, DepthPass, DepthPlane, DepthSize, Model, Pass,
    ViewUniform, Workspace,
};

/// The losses of a view's depths and normals, without their weights.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DepthLosses {
    /// Over the image.
    pub image: f64,
    /// Over patches, in the mean.
    pub patches: f64,
    /// `1 - N n`, in the mean over pixels.
    pub normals: f64,
    /// Share of the pixels that count, by weight.
    pub share: f64,
}

/// The loss of depths and normals of a run.
pub(super) struct Depths {
    kernels: DepthKernels,
    /// `None` while it is bound to nothing.
    pub(super) pass: Option<DepthPass>,
    size: DepthSize,
    kind: DepthLossKind,
    uniform: DepthLossUniform,
    /// The first iteration with the last weight alone.
    end: u32,
    /// Weight of the loss over the image from there on.
    end_weight: f32,
    /// The last target, as the kernels take it.
    planes: Vec<f32>,
}

impl Depths {
    /// Allocates for the real views `views`.
    ///
    /// # Errors
    /// A buffer that the adapter cannot bind.
    pub(super) fn new(
        gpu: &Gpu,
        kernels: DepthKernels,
        (workspace, model): (&Workspace, &Model),
        views: &[ViewUniform],
        config: &PriorConfig,
    ) -> Result<Depths> {
        let size = size(config);
        let pass = DepthPass::new(gpu, &kernels, workspace, model, views, size)?;
        let kind = match config.loss {
            PriorLoss::Pearson => DepthLossKind::Pearson,
            PriorLoss::ScaleShift => DepthLossKind::ScaleShift,
            PriorLoss::L1 => DepthLossKind::L1,
        };
        let plane = match config.rendered {
            RenderedDepth::Expected => DepthPlane::Expected,
            RenderedDepth::Median => DepthPlane::Median,
            RenderedDepth::Mode => DepthPlane::Mode,
        };
        Ok(Depths {
            kernels,
            pass: Some(pass),
            size,
            kind,
            uniform: DepthLossUniform {
                weight: config.weight as f32,
                patch_weight: config.patch_weight as f32,
                normal_weight: config.normal_weight as f32,
                kind: kind as u32,
                plane: plane as u32,
                inverse: u32::from(config.compares_inverse()),
                patch_vectors: size.patch_vectors(),
                normals: u32::from(size.normals),
            },
            end: config.end,
            end_weight: config.end_weight as f32,
            planes: Vec::new(),
        })
    }

    /// Follows a workspace or model that has changed.
    pub(super) fn rebind(
        &mut self,
        gpu: &Gpu,
        (workspace, model): (&Workspace, &Model),
        views: &[ViewUniform],
    ) -> Result<()> {
        let kernels = &self.kernels;
        self.pass = Some(DepthPass::new(
            gpu, kernels, workspace, model, views, self.size,
        )?);
        Ok(())
    }

    /// Sets what the view of iteration `iteration` (from 0) is held to; returns whether it is.
    pub(super) fn set(
        &mut self,
        gpu: &Gpu,
        iteration: u32,
        view: &TrainingView,
        uniform: &ViewUniform,
    ) -> bool {
        let (Some(pass), Some(target)) = (&self.pass, &view.depths) else {
            return false;
        };
        let Some(loss) = self.loss_at(iteration) else {
            return false;
        };
        target.pack(uniform, self.size, &mut self.planes);
        pass.set_target(gpu, &self.planes);
        pass.set_loss(gpu, loss);
        true
    }

    /// Returns the loss of iteration `iteration` (from 0), where there is one.
    fn loss_at(&self, iteration: u32) -> Option<DepthLossUniform> {
        if iteration < self.end {
            return Some(self.uniform);
        }
        (self.end_weight > 0.0).then_some(DepthLossUniform {
            weight: self.end_weight,
            patch_weight: 0.0,
            normal_weight: 0.0,
            ..self.uniform
        })
    }

    /// Carries back the gradients of the image that `pass` has rendered and of its depths and normals.
    pub(super) fn backward(&self, pass: &Pass<'_>, commands: &mut Commands<'_>) {
        let Some(depth) = &self.pass else {
            return;
        };
        let kernels = &self.kernels;
        pass.project_depth(commands, kernels, depth);
        pass.rasterize_depth(commands, kernels, depth);
        pass.depth_loss(commands, kernels, depth, self.kind);
        pass.rasterize_backward(commands);
        pass.rasterize_depth_backward(commands, kernels, depth);
        pass.sum_pairs(commands);
        pass.project_backward(commands);
        pass.project_depth_backward(commands, kernels, depth);
    }

    /// Reads the losses of iteration `iteration` (from 0); `None` where its view is held to nothing.
    pub(super) fn losses(
        &self,
        gpu: &Gpu,
        iteration: u32,
        view: &TrainingView,
    ) -> Result<Option<DepthLosses>> {
        match (&self.pass, &view.depths) {
            (Some(pass), Some(_)) if self.loss_at(iteration).is_some() => {
                let [image, patches, normals, share] = pass.read_losses(gpu)?;
                Ok(Some(DepthLosses {
                    image,
                    patches,
                    normals,
                    share,
                }))
            }
            _ => Ok(None),
        }
    }

    /// Returns the weighted sum of the losses of iteration `iteration` (from 0).
    pub(super) fn total(&self, iteration: u32, losses: &DepthLosses) -> f64 {
        let weighted = |loss: DepthLossUniform| {
            f64::from(loss.weight) * losses.image
                + f64::from(loss.patch_weight) * losses.patches
                + f64::from(loss.normal_weight) * losses.normals
        };
        self.loss_at(iteration).map_or(0.0, weighted)
    }
}

/// Returns the sizes that buffers follow from.
pub(super) fn size(config: &PriorConfig) -> DepthSize {
    DepthSize {
        normals: config.has_normals(),
        patch_px: config.patch_px,
    }
}
