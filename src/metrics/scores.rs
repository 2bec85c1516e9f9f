//! Scores of test views, and their means over views. PSNR is in dB; JSON has no infinity, so the
//! PSNR of an identical image is written as null, as is what was not measured.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::lpips::{InputRange, Net};

/// The form in which a render's values are measured.
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

/// The LPIPS that was measured.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LpipsRecord {
    /// Net whose features were compared.
    pub net: Net,
    /// Range in which black to white was given to the net.
    pub range: InputRange,
    /// SHA-256 of the file of weights, in hex.
    pub weights_sha256: String,
}

impl fmt::Display for LpipsRecord {
    /// Writes the name of a table's column: `lpips(vgg,[0,1])`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "lpips({},{})", self.net, self.range)
    }
}

/// Errors of the bare point splat of the cloud at the test views, black where no point falls.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointSplatScore {
    /// Mean over the views, dB; null if there is no view.
    pub psnr: Option<f64>,
    /// Mean over the views; null if there is no view.
    pub ssim: Option<f64>,
    /// Mean over covered pixels alone, dB; null if a view has none.
    pub psnr_covered: Option<f64>,
    /// Mean share of covered pixels.
    pub coverage: f64,
}

/// Means over the views of their own values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    /// Mean of PSNR in dB, not PSNR of a mean error.
    pub psnr: Option<f64>,
    /// Mean of SSIM; 1 is best.
    pub ssim: Option<f64>,
    /// Mean of LPIPS, where smaller is nearer; null if it was not measured.
    pub lpips: Option<f64>,
}

/// Means over the views that have a mask with set pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaskedMean {
    /// Number of those views.
    pub n_views: usize,
    /// Means of their masked scores; in JSON beside `n_views`, not below a key.
    #[serde(flatten)]
    pub mean: Mean,
}

/// Errors at one test view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    /// The view's name: its image's file name.
    pub name: String,
    /// Over the whole image, dB.
    pub psnr: Option<f64>,
    /// Over the whole image; 1 is best.
    pub ssim: Option<f64>,
    /// Smaller is nearer; null if LPIPS was not measured.
    pub lpips: Option<f64>,
    /// PSNR after the render's colours were fitted to the photograph's ([`fitted_psnr`](super::errors::fitted_psnr)), dB;
    /// null in files of older versions.
    #[serde(default)]
    pub fitted_psnr: Option<f64>,
    /// Scores over the view's mask; null for a view without a mask, or with an empty one.
    #[serde(default)]
    pub masked: Option<MaskedScore>,
    /// Score over the pixels that the cloud covers; null in files of older versions.
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
    /// Over the mask's pixels, dB.
    pub psnr: Option<f64>,
    /// Mean of SSIM's map over the mask's pixels.
    pub ssim: Option<f64>,
    /// Null if LPIPS was not measured.
    pub lpips: Option<f64>,
    /// Share of the view's pixels.
    pub coverage: f64,
}

/// Returns the mean of values that are all there; `None` if one is missing or there are none.
pub fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let values = values.collect::<Option<Vec<f64>>>()?;
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
