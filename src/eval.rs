//! Errors at the test views.

use rayon::prelude::*;

use crate::camera::Frame;
use crate::config::{Config, ModelConfig};
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::Gpu;
use crate::metrics;
use crate::progress::Progress;
use crate::render::{Kernels, Model, Renderer, ViewUniform};
use crate::run::{Evaluation, PointSplatScore, ViewScore, mean};
use crate::scene::{Image, PointCloud, View};
use crate::splat::splat_views;

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
    let mut progress = Progress::stage("evaluation", views.len() as u32);
    let renders = views
        .iter()
        .zip(1..)
        .map(|(view, done)| {
            let camera = frame.camera_to_canonical(&view.camera);
            let uniform = ViewUniform::new(&camera, config.near, config.background);
            let rendered = renderer
                .render(&model, &uniform)
                .map_err(|e| e.at(&camera.name))?;
            progress.advance(done);
            metrics::quantize(rendered.width, rendered.height, &rendered.rgb)
        })
        .collect();
    progress.finish();
    renders
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

/// Errors of the bare point splat of a cloud at `views`, splatted as the virtual views are.
///
/// # Errors
/// What [`splat_views`] refuses.
pub fn score_point_splat(
    cloud: &PointCloud,
    frame: &Frame,
    views: &[View],
    config: &Config,
) -> Result<PointSplatScore> {
    let cameras: Vec<_> = views.iter().map(|view| view.camera.clone()).collect();
    let splats = splat_views(cloud, frame, &cameras, &config.splat, config.model.near)?;
    let scores = splats.par_iter().zip(views).map(|(splat, view)| {
        let rgb = splat
            .rgba
            .chunks_exact(4)
            .flat_map(|p| [p[0], p[1], p[2]])
            .collect();
        let image = Image {
            width: splat.width,
            height: splat.height,
            rgb,
        };
        let mask: Vec<bool> = splat.mask().collect();
        Ok((
            metrics::psnr(&image, &view.image)?,
            metrics::ssim(&image, &view.image)?,
            metrics::masked_psnr(&image, &view.image, &mask)?,
            splat.coverage(),
        ))
    });
    let scores = scores.collect::<Result<Vec<_>>>()?;
    Ok(PointSplatScore {
        psnr: mean(scores.iter().map(|s| Some(s.0))),
        ssim: mean(scores.iter().map(|s| Some(s.1))),
        psnr_covered: mean(scores.iter().map(|s| s.2)),
        coverage: mean(scores.iter().map(|s| Some(s.3))).unwrap_or(0.0),
    })
}
