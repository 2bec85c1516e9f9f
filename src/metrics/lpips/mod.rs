//! LPIPS, the learned perceptual distance (Zhang et al. 2018, version 0.1), on AlexNet and VGG16.
//!
//! Both images go through the net's convolutions. After each of its five slices the features of
//! every pixel are scaled to unit length; their squared difference, weighted by channel with the
//! trained `lin` layers and averaged over the pixels, is the slice's distance, and the sum of the
//! five is LPIPS. Smaller is nearer.
//!
//! The weights are a file of the user's own, see [`WEIGHTS_RECIPE`].

mod layers;
mod net;
mod weights;

use std::fmt;

use serde::{Deserialize, Serialize};

use super::{Pixels, check_pair, n_masked};
use crate::error::{Error, Result};
use layers::{Conv, Tensor, max_pool};

/// Command line that makes the file of weights with one line of Python.
pub const WEIGHTS_RECIPE: &str = "python -c \"import lpips, safetensors.torch as s; \
     s.save_file({k: v.clone() for k, v in lpips.LPIPS(net='vgg').state_dict().items()}, \
     'lpips_vgg.safetensors')\"";

/// The net whose features are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Net {
    /// AlexNet, torchvision's.
    Alex,
    /// VGG16.
    Vgg,
}

impl fmt::Display for Net {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Net::Alex => "alex",
            Net::Vgg => "vgg",
        })
    }
}

/// The range in which black to white is given to the net.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
pub enum InputRange {
    /// As 3DGS's `metrics.py` and the papers that follow it
    #[default]
    #[serde(rename = "0,1")]
    #[value(name = "0,1")]
    Unit,
    /// As the net was trained, and the LPIPS package asks for
    #[serde(rename = "-1,1")]
    #[value(name = "-1,1")]
    Signed,
}

impl fmt::Display for InputRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            InputRange::Unit => "[0,1]",
            InputRange::Signed => "[-1,1]",
        })
    }
}

/// LPIPS with a net's weights, ready to measure.
#[derive(Clone, Debug)]
pub struct Lpips {
    net: Net,
    range: InputRange,
    /// SHA-256 of the weights' file, in hex.
    sha256: String,
    /// Subtracted from and divided out of the input, by channel.
    shift: [f32; 3],
    scale: [f32; 3],
    slices: Vec<Slice>,
}

/// A part of the net between two of the features that are compared.
#[derive(Clone, Debug)]
struct Slice {
    /// Side and stride of the max pooling before the convolutions.
    pool: Option<(usize, usize)>,
    convs: Vec<Conv>,
    /// Weight of each channel's squared difference.
    lin: Vec<f32>,
}

impl Lpips {
    /// Returns the net that the weights are of.
    pub fn net(&self) -> Net {
        self.net
    }

    /// Returns the range in which images are given to the net.
    pub fn range(&self) -> InputRange {
        self.range
    }

    /// Returns the SHA-256 of the weights' file, in hex.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// Returns the shortest side of an image that the net leaves a pixel of.
    pub fn min_side_px(&self) -> u32 {
        self.net.min_side_px()
    }

    /// Refuses images that the net leaves nothing of.
    ///
    /// # Errors
    /// A side is shorter than [`Lpips::min_side_px`].
    pub fn check_size(&self, width: u32, height: u32) -> Result<()> {
        let least = self.min_side_px();
        if width.min(height) < least {
            return Err(Error::new(format!(
                "an image of {width}x{height} is too small for LPIPS on {}, which needs \
                 {least} pixels a side",
                self.net
            ))
            .way_out("measure larger images, or without LPIPS"));
        }
        Ok(())
    }

    /// Returns LPIPS of two images of one size.
    ///
    /// # Errors
    /// The images differ in size, are too small for the net, or are not whole.
    pub fn distance(&self, render: &impl Pixels, truth: &impl Pixels) -> Result<f64> {
        self.distance_where(render, truth, |_| true)
    }

    /// Returns LPIPS of both images with the pixels black whose `mask` (`height * width`) is not
    /// set: a mean over the whole image, to which pixels far from the mask add nothing. `None` for
    /// an empty mask.
    ///
    /// # Errors
    /// As [`Lpips::distance`], or a mask of another size.
    pub fn masked_distance(
        &self,
        render: &impl Pixels,
        truth: &impl Pixels,
        mask: &[bool],
    ) -> Result<Option<f64>> {
        if n_masked(render, truth, mask)?.is_none() {
            return Ok(None);
        }
        self.distance_where(render, truth, |pixel| mask[pixel])
            .map(Some)
    }

    fn distance_where(
        &self,
        render: &impl Pixels,
        truth: &impl Pixels,
        shows: impl Fn(usize) -> bool,
    ) -> Result<f64> {
        check_pair(render, truth)?;
        self.check_size(render.size().0, render.size().1)?;
        let mut a = self.input(render, &shows);
        let mut b = self.input(truth, &shows);
        // Slice by slice, so that no more than one of them lies in memory for each image.
        let mut sum = 0.0;
        for slice in &self.slices {
            a = slice.features(a);
            b = slice.features(b);
            sum += slice_distance(&a, &b, &slice.lin);
        }
        Ok(sum)
    }

    /// Returns the tensor that the first convolution sees.
    fn input(&self, image: &impl Pixels, shows: impl Fn(usize) -> bool) -> Tensor {
        let (width, height) = image.size();
        let value = |i: usize| {
            let level = if shows(i / 3) { image.level(i) } else { 0.0 };
            let input = match self.range {
                InputRange::Unit => level / 255.0,
                InputRange::Signed => level / 127.5 - 1.0,
            };
            (input as f32 - self.shift[i % 3]) / self.scale[i % 3]
        };
        Tensor {
            height: height as usize,
            width: width as usize,
            channels: 3,
            values: (0..image.n_values()).map(value).collect(),
        }
    }
}

impl Slice {
    fn features(&self, input: Tensor) -> Tensor {
        let pooled = match self.pool {
            Some((side, stride)) => max_pool(&input, side, stride),
            None => input,
        };
        self.convs
            .iter()
            .fold(pooled, |tensor, conv| conv.apply(&tensor))
    }
}

/// Returns the mean over the pixels of `sum_c lin_c (a_c / |a| - b_c / |b|)^2`.
fn slice_distance(a: &Tensor, b: &Tensor, lin: &[f32]) -> f64 {
    /// Keeps the divisor from 0; the LPIPS package's.
    const EPSILON: f64 = 1e-10;
    let norm = |pixel: &[f32]| {
        let squares: f64 = pixel.iter().map(|&x| f64::from(x).powi(2)).sum();
        squares.sqrt() + EPSILON
    };
    let pixels = a
        .values
        .chunks_exact(a.channels)
        .zip(b.values.chunks_exact(b.channels));
    let sum: f64 = pixels
        .map(|(a, b)| {
            let (norm_a, norm_b) = (norm(a), norm(b));
            a.iter()
                .zip(b)
                .zip(lin)
                .map(|((&a, &b), &w)| {
                    let difference = f64::from(a) / norm_a - f64::from(b) / norm_b;
                    f64::from(w) * difference.powi(2)
                })
                .sum::<f64>()
        })
        .sum();
    sum / (a.width * a.height) as f64
}
