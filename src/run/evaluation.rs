//! What `eval.json` holds.
//!
//! JSON has no infinity: the PSNR of an identical image is written as null, as is what was not
//! measured; a table says `inf` for the former. Fields that older versions did not write are
//! optional. Of two equal runs only `train_s` may differ.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::PoseProtocol;
use crate::metrics::lpips::{InputRange, Net};

/// Errors at the test views: `eval.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    pub mean: Mean,
    /// Over the masks of the views that have one; null where none has.
    #[serde(default)]
    pub mean_masked: Option<MaskedMean>,
    /// Over the covered pixels of the views that have some; null in files of older versions.
    #[serde(default)]
    pub mean_covered: Option<CoveredScore>,
    pub views: Vec<ViewScore>,
    pub n_gaussians: usize,
    /// Seconds of training alone.
    pub train_s: Option<f64>,
    /// What the cloud gives without any training.
    pub point_splat: Option<PointSplatScore>,
    /// What was measured and how; null in files of older versions.
    #[serde(default)]
    pub measured: Option<Measured>,
}

/// What was measured and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// This program's version.
    pub version: String,
    /// Of `point_cloud.ply`, in hex.
    pub point_cloud_sha256: String,
    pub point_cloud_bytes: u64,
    /// Of `config.json`, which holds the near plane and the background.
    pub config_sha256: String,
    /// Of the scene's files ([`crate::scene::SceneSource::stamp`]).
    pub scene_stamp: Option<String>,
    /// Width and height of the first test view; null without one.
    pub image_px: Option<[u32; 2]>,
    pub pose_protocol: PoseProtocol,
    pub renders: Renders,
    /// Null: LPIPS was not measured.
    pub lpips: Option<LpipsRecord>,
}

/// What a render's values are when they are measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Renders {
    /// Rounded to 8 bit, as in the files that 3DGS measures.
    #[default]
    #[serde(rename = "8-bit")]
    Rounded,
    /// As rendered, clamped to `[0, 1]`.
    #[serde(rename = "float")]
    Float,
}

/// Which LPIPS was measured.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LpipsRecord {
    pub net: Net,
    pub range: InputRange,
    /// Of the file of weights, in hex.
    pub weights_sha256: String,
}

impl fmt::Display for LpipsRecord {
    /// As a table's column: `lpips(vgg,[0,1])`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "lpips({},{})", self.net, self.range)
    }
}

/// Errors of the bare point splat of the cloud at the test views, black where no point falls.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointSplatScore {
    /// Means over the views; dB.
    pub psnr: Option<f64>,
    pub ssim: Option<f64>,
    /// Over covered pixels alone; dB.
    pub psnr_covered: Option<f64>,
    /// Mean share of covered pixels.
    pub coverage: f64,
}

/// Means over the views of their own values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    /// dB.
    pub psnr: Option<f64>,
    pub ssim: Option<f64>,
    pub lpips: Option<f64>,
}

/// Means over the views that have a mask with set pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaskedMean {
    pub n_views: usize,
    #[serde(flatten)]
    pub mean: Mean,
}

/// Errors at one test view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    pub name: String,
    /// dB.
    pub psnr: Option<f64>,
    pub ssim: Option<f64>,
    pub lpips: Option<f64>,
    /// Null for a view without a mask, or with an empty one.
    #[serde(default)]
    pub masked: Option<MaskedScore>,
    /// Null in files of older versions.
    #[serde(default)]
    pub covered: Option<CoveredScore>,
}

/// Error over the pixels on which the bare splat of the scene's whole cloud puts a point: the same
/// pixels whatever a run made of the cloud. What lies beyond them no method can know.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CoveredScore {
    /// dB; null where no pixel is covered.
    pub psnr: Option<f64>,
    /// Share of the view's pixels.
    pub coverage: f64,
}

/// Errors over a view's mask: PSNR of its pixels, SSIM's map averaged over them, LPIPS of both
/// images black beyond them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaskedScore {
    /// dB.
    pub psnr: Option<f64>,
    pub ssim: Option<f64>,
    pub lpips: Option<f64>,
    /// Share of the view's pixels.
    pub coverage: f64,
}

impl Evaluation {
    /// With the means over `views`; a metric that a view lacks has no mean.
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

    /// As it was before it was written: PSNR is always measured with SSIM, or where pixels are
    /// covered, so a null beside one is the infinite PSNR of identical images.
    pub(super) fn with_infinities(mut self) -> Evaluation {
        let restore = |psnr: &mut Option<f64>, beside: Option<f64>| {
            if psnr.is_none() && beside.is_some() {
                *psnr = Some(f64::INFINITY);
            }
        };
        restore(&mut self.mean.psnr, self.mean.ssim);
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
            if let Some(masked) = &mut view.masked {
                restore(&mut masked.psnr, masked.ssim);
            }
        }
        self
    }
}

/// Mean of values that are all there.
pub fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let values = values.collect::<Option<Vec<f64>>>()?;
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
