//! This module has what `eval.json` holds.
//!
//! JSON has no infinity: the PSNR of an identical image is written as null, as is what was not
//! measured; a table says `inf` for the former. Fields that older versions did not write are
//! optional. Two equal runs may differ in `train_s` alone.

use serde::{Deserialize, Serialize};

use crate::metrics::{
    CoveredScore, LpipsRecord, MaskedMean, MaskedScore, Mean, PointSplatScore, Renders, ViewScore,
    mean,
};
use crate::scene::PoseProtocol;

/// Errors at the test views: `eval.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Means over all test views.
    pub mean: Mean,
    /// Means over the masks of the views that have one; null if none has.
    #[serde(default)]
    pub mean_masked: Option<MaskedMean>,
    /// Mean PSNR after each view's colours were fitted, dB; null in files of older versions.
    #[serde(default)]
    pub mean_fitted_psnr: Option<f64>,
    /// Mean over the covered pixels of the views that have some; null in files of older versions.
    #[serde(default)]
    pub mean_covered: Option<CoveredScore>,
    /// One entry a test view.
    pub views: Vec<ViewScore>,
    /// Gaussians of the model that was measured.
    pub n_gaussians: usize,
    /// Seconds of training alone.
    pub train_s: Option<f64>,
    /// Errors of the bare point splat of the cloud, without any training.
    pub point_splat: Option<PointSplatScore>,
    /// The model, scene and way of measuring; null in files of older versions.
    #[serde(default)]
    pub measured: Option<Measured>,
}

/// The model and scene that were measured, and the way of measuring.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// This program's version.
    pub version: String,
    /// SHA-256 of `point_cloud.ply`, in hex.
    pub point_cloud_sha256: String,
    /// Size of `point_cloud.ply`.
    pub point_cloud_bytes: u64,
    /// SHA-256 of `config.json`, which holds the near plane and the background.
    pub config_sha256: String,
    /// Stamp of the scene's files ([`crate::scene::SceneSource::stamp`]).
    pub scene_stamp: Option<String>,
    /// Width and height of the first test view; null without one.
    pub image_px: Option<[u32; 2]>,
    /// How the test cameras came into the frame of the model.
    pub pose_protocol: PoseProtocol,
    /// Whether renders were rounded to 8 bit before they were measured.
    pub renders: Renders,
    /// The LPIPS that was measured; null if none was.
    pub lpips: Option<LpipsRecord>,
}

impl Evaluation {
    /// Makes an evaluation with the means over `views`; a metric that a view lacks has no mean.
    pub fn new(views: Vec<ViewScore>, n_gaussians: usize, train_s: Option<f64>) -> Evaluation {
        let masked: Vec<MaskedScore> = views.iter().filter_map(|view| view.masked).collect();
        let covered: Vec<CoveredScore> = views.iter().filter_map(|view| view.covered).collect();
        let coverage = mean(covered.iter().map(|score| Some(score.coverage)));
        Evaluation {
            mean: Mean {
                psnr: mean(views.iter().map(|view| view.psnr)),
                ssim: mean(views.iter().map(|view| view.ssim)),
                lpips: mean(views.iter().map(|view| view.lpips)),
            },
            mean_masked: (!masked.is_empty()).then(|| MaskedMean {
                n_views: masked.len(),
                mean: Mean {
                    psnr: mean(masked.iter().map(|score| score.psnr)),
                    ssim: mean(masked.iter().map(|score| score.ssim)),
                    lpips: mean(masked.iter().map(|score| score.lpips)),
                },
            }),
            mean_fitted_psnr: mean(views.iter().map(|view| view.fitted_psnr)),
            mean_covered: coverage.map(|coverage| CoveredScore {
                psnr: mean(covered.iter().filter(|s| s.coverage > 0.0).map(|s| s.psnr)),
                coverage,
            }),
            views,
            n_gaussians,
            train_s,
            point_splat: None,
            measured: None,
        }
    }

    /// Returns the evaluation as it was before it was written: PSNR is always measured with SSIM,
    /// or where pixels are covered, so a null beside one is the infinite PSNR of identical images.
    pub(super) fn with_infinities(mut self) -> Evaluation {
        let restore = |psnr: &mut Option<f64>, beside: Option<f64>| {
            if psnr.is_none() && beside.is_some() {
                *psnr = Some(f64::INFINITY);
            }
        };
        // Identical images are so after a fit, too; a null beside a finite PSNR was not measured.
        let restore_fitted = |fitted: &mut Option<f64>, psnr: Option<f64>| {
            restore(fitted, psnr.filter(|psnr| psnr.is_infinite()));
        };
        restore(&mut self.mean.psnr, self.mean.ssim);
        restore_fitted(&mut self.mean_fitted_psnr, self.mean.psnr);
        if let Some(MaskedMean { mean, .. }) = &mut self.mean_masked {
            restore(&mut mean.psnr, mean.ssim);
        }
        let covered = self
            .views
            .iter_mut()
            .filter_map(|view| view.covered.as_mut());
        for score in covered.chain(&mut self.mean_covered) {
            let measured = (score.coverage > 0.0).then_some(score.coverage);
            restore(&mut score.psnr, measured);
        }
        for view in &mut self.views {
            restore(&mut view.psnr, view.ssim);
            restore_fitted(&mut view.fitted_psnr, view.psnr);
            if let Some(masked) = &mut view.masked {
                restore(&mut masked.psnr, masked.ssim);
            }
        }
        self
    }
}
