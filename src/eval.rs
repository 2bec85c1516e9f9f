//! Errors at the test views.

use rayon::prelude::*;

use crate::camera::Frame;
use crate::config::ModelConfig;
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::Gpu;
use crate::metrics;
use crate::render::{Kernels, Model, Renderer, ViewUniform};
use crate::run::{Evaluation, ViewScore};
use crate::scene::{Image, View};

/// Renders Gaussians of the canonical `frame` at `views`, each rounded to 8 bit.
///
/// # Errors
/// A view that the adapter cannot hold, or a GPU fault.
pub fn render_views(
    gpu: &Gpu,
    kernels: &Kernels,
    gaussians: &Gaussians,
    frame: &Frame,
    views: &[View],
    config: &ModelConfig,
) -> Result<Vec<Image>> {
    let model = Model::upload(gpu, gaussians, gaussians.len())?;
    let mut renderer = Renderer::new(gpu, kernels);
    views
        .iter()
        .map(|view| {
            let camera = frame.camera_to_canonical(&view.camera);
            let uniform = ViewUniform::new(&camera, config.near, config.background);
            let rendered = renderer
                .render(&model, &uniform)
                .map_err(|e| e.at(&camera.name))?;
            metrics::quantize(rendered.width, rendered.height, &rendered.rgb)
        })
        .collect()
}

/// PSNR and SSIM of each render against its view's photograph.
pub fn score(
    renders: &[Image],
    views: &[View],
    n_gaussians: usize,
    train_s: Option<f64>,
) -> Result<Evaluation> {
    let scores: Result<Vec<ViewScore>> = renders
        .par_iter()
        .zip(views)
        .map(|(render, view)| {
            Ok(ViewScore {
                name: view.camera.name.clone(),
                psnr: Some(metrics::psnr(render, &view.image)?),
                ssim: Some(metrics::ssim(render, &view.image)?),
                lpips: None,
            })
        })
        .collect();
    Ok(Evaluation::new(scores?, n_gaussians, train_s))
}
