//! This module measures errors at the test views.

mod fit;
mod poses;

pub use fit::fit_poses;
pub use poses::PoseErrors;

use rayon::prelude::*;

use crate::camera::Frame;
use crate::cloud::splat::{SplatImage, splat_views};
use crate::config::{Config, Footprint, ModelConfig, SplatConfig};
use crate::error::{Error, Result};
use crate::gaussians::Gaussians;
use crate::metrics::{self, FloatImage, Lpips, Pixels};
use crate::metrics::{
    CoveredScore, LpipsRecord, MaskedScore, PointSplatScore, Renders, ViewScore, mean,
};
use crate::render::{Device, Model, Rendered, Renderer, ViewUniform};
use crate::scene::{Image, PointCloud, PoseProtocol, View};
use crate::terminal::progress::Progress;

/// How test cameras come into the frame of a run's model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Alignment {
    /// As the scene has them: it shares the frame
    #[default]
    Shared,
    /// By the similarity that takes the scene's training cameras to the run's (Umeyama)
    Similarity,
    /// By that similarity, then each fitted to its photograph
    Fit,
}

impl Alignment {
    /// Returns the protocol that a scene's test cameras have after this alignment.
    pub fn protocol(self, scene: PoseProtocol) -> PoseProtocol {
        match self {
            Alignment::Shared => scene,
            Alignment::Similarity => PoseProtocol::TrainingSimilarity,
            Alignment::Fit => PoseProtocol::TestPoseFit,
        }
    }
}

/// How test views are measured.
#[derive(Clone, Debug, Default)]
pub struct EvalOptions {
    /// Without it LPIPS is not measured.
    pub lpips: Option<Lpips>,
    /// Whether renders are rounded to 8 bit before they are measured.
    pub renders: Renders,
    /// How the test cameras come into the model's frame.
    pub align: Alignment,
}

impl EvalOptions {
    /// Refuses views that cannot be measured so, before anything takes time.
    pub fn check(&self, views: &[View]) -> Result<()> {
        let Some(lpips) = &self.lpips else {
            return Ok(());
        };
        views.iter().try_for_each(|view| {
            lpips
                .check_size(view.image.width, view.image.height)
                .map_err(|e| e.at(format!("test view `{}`", view.camera.name)))
        })
    }

    /// Returns which LPIPS is measured, for the record; `None` if it is not.
    pub fn lpips_record(&self) -> Option<LpipsRecord> {
        self.lpips.as_ref().map(|lpips| LpipsRecord {
            net: lpips.net(),
            range: lpips.range(),
            weights_sha256: lpips.sha256().to_owned(),
        })
    }
}

/// Renders Gaussians of the canonical `frame` at `views` and hands each render to `look`.
///
/// # Errors
/// A view that the adapter cannot hold, a GPU fault, or what `look` returns.
pub fn render_views(
    Device { gpu, kernels }: Device<'_>,
    gaussians: &Gaussians,
    frame: &Frame,
    views: &[View],
    config: &ModelConfig,
    mut look: impl FnMut(&View, &Rendered) -> Result<()>,
) -> Result<()> {
    let model = Model::upload(gpu, gaussians, gaussians.len())?;
    let mut renderer = Renderer::new(gpu, kernels);
    let mut progress = Progress::stage("evaluation", views.len() as u32);
    let mut done = 0;
    let measured = |view: &View, rendered: &Rendered| {
        look(view, rendered)?;
        done += 1;
        progress.advance(done);
        Ok(())
    };
    render_model(&mut renderer, &model, frame, views, config, measured)?;
    progress.finish();
    Ok(())
}

/// Does what [`render_views`] does for a model that is on the GPU already.
///
/// # Errors
/// As [`render_views`].
pub fn render_model(
    renderer: &mut Renderer,
    model: &Model,
    frame: &Frame,
    views: &[View],
    config: &ModelConfig,
    mut look: impl FnMut(&View, &Rendered) -> Result<()>,
) -> Result<()> {
    views.iter().try_for_each(|view| {
        let camera = frame.camera_to_canonical(&view.camera);
        let uniform = ViewUniform::new(&camera, frame.near(config.near), config.background);
        let rendered = renderer
            .render(model, &uniform)
            .map_err(|e| e.at(&camera.name))?;
        look(view, &rendered)
    })
}

/// Measures a render against its view's photograph: over all pixels, over the mask, and over the
/// pixels that are set in `covered`, where it is given.
pub fn score(
    rendered: &Rendered,
    view: &View,
    covered: Option<&[bool]>,
    options: &EvalOptions,
) -> Result<ViewScore> {
    let &Rendered { width, height, .. } = rendered;
    let rgb = &rendered.rgb;
    let score = match options.renders {
        Renders::Rounded => {
            let image = metrics::quantize(width, height, rgb)?;
            score_image(&image, view, covered, options.lpips.as_ref())
        }
        Renders::Float => {
            let image = FloatImage { width, height, rgb };
            score_image(&image, view, covered, options.lpips.as_ref())
        }
    };
    score.map_err(|e: Error| e.at(&view.camera.name))
}

fn score_image(
    render: &impl Pixels,
    view: &View,
    covered: Option<&[bool]>,
    lpips: Option<&Lpips>,
) -> Result<ViewScore> {
    let truth = &view.image;
    Ok(ViewScore {
        name: view.camera.name.clone(),
        psnr: Some(metrics::psnr(render, truth)?),
        ssim: Some(metrics::ssim(render, truth)?),
        lpips: lpips.map(|l| l.distance(render, truth)).transpose()?,
        fitted_psnr: Some(metrics::errors::fitted_psnr(render, truth)?),
        masked: match &view.mask {
            Some(mask) => score_masked(render, truth, &mask.set, lpips)?,
            None => None,
        },
        covered: covered
            .map(|covered| score_covered(render, truth, covered))
            .transpose()?,
    })
}

fn score_covered(render: &impl Pixels, truth: &Image, covered: &[bool]) -> Result<CoveredScore> {
    Ok(CoveredScore {
        psnr: metrics::masked_psnr(render, truth, covered)?,
        coverage: share(covered),
    })
}

/// Returns the share of set pixels.
fn share(mask: &[bool]) -> f64 {
    mask.iter().filter(|&&set| set).count() as f64 / mask.len() as f64
}

/// Measures a render over a mask; an empty mask has no errors.
fn score_masked(
    render: &impl Pixels,
    truth: &Image,
    mask: &[bool],
    lpips: Option<&Lpips>,
) -> Result<Option<MaskedScore>> {
    let Some(psnr) = metrics::masked_psnr(render, truth, mask)? else {
        return Ok(None);
    };
    let lpips = lpips.map(|l| l.masked_distance(render, truth, mask));
    Ok(Some(MaskedScore {
        psnr: Some(psnr),
        ssim: metrics::masked_ssim(render, truth, mask)?,
        lpips: lpips.transpose()?.flatten(),
        coverage: share(mask),
    }))
}

/// Returns the pixels of each view on which the bare splat of `cloud` puts a point: one pixel a
/// point, then the connectivity filter.
///
/// # Errors
/// What [`splat_views`] refuses.
pub fn covered_pixels(
    cloud: &PointCloud,
    frame: &Frame,
    views: &[View],
    config: &Config,
) -> Result<Vec<Vec<bool>>> {
    let splats = splat_test_views(cloud, frame, views, config)?;
    Ok(splats.iter().map(|splat| splat.mask().collect()).collect())
}

fn splat_test_views(
    cloud: &PointCloud,
    frame: &Frame,
    views: &[View],
    config: &Config,
) -> Result<Vec<SplatImage>> {
    let cameras: Vec<_> = views.iter().map(|view| view.camera.clone()).collect();
    // One pixel whatever the virtual views' footprint is, so that runs have a common measure.
    let splat = SplatConfig {
        footprint: Footprint::Pixel,
        ..config.splat.clone()
    };
    splat_views(
        cloud,
        frame,
        (&cameras, &[]),
        &splat,
        frame.near(config.model.near),
    )
}

/// Measures the bare point splat of a cloud at `views`: one pixel a point, black where there is
/// none.
///
/// # Errors
/// What [`splat_views`] refuses.
pub fn score_point_splat(
    cloud: &PointCloud,
    frame: &Frame,
    views: &[View],
    config: &Config,
) -> Result<PointSplatScore> {
    score_splats(&splat_test_views(cloud, frame, views, config)?, views)
}

/// Measures splats against the photographs of `views`, one each.
///
/// # Errors
/// An image whose size is not its view's.
pub fn score_splats(splats: &[SplatImage], views: &[View]) -> Result<PointSplatScore> {
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
