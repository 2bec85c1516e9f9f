//! What is measured at a test view, and the means over views. PSNR in dB; JSON has no infinity, so
//! the PSNR of an identical image is written as null, as is what was not measured.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::lpips::{InputRange, Net};

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
    /// SHA-256 of the file of weights, in hex.
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

/// Mean of values that are all there.
pub fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let values = values.collect::<Option<Vec<f64>>>()?;
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
