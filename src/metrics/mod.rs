//! Image metrics as 3D Gaussian Splatting computes them (Kerbl et al. 2023, `metrics.py`).
//!
//! A render is measured as 3DGS measures the files that it wrote, rounded to 8 bit by [`quantize`],
//! or as a [`FloatImage`]. Metrics over a mask (`height * width`, row 0 on top) look at set pixels
//! alone; each says what it takes from beyond them. Sums run in a fixed order, so results do not
//! depend on the number of threads.

pub mod errors;
pub mod lpips;
mod psnr;
mod scores;
mod ssim;

pub use lpips::Lpips;
pub use psnr::{masked_psnr, psnr};
pub use scores::{
    CoveredScore, LpipsRecord, MaskedMean, MaskedScore, Mean, PointSplatScore, Renders, ViewScore,
    mean,
};
pub use ssim::{masked_ssim, ssim};

use crate::error::{Error, Result};
use crate::scene::Image;

/// An RGB image as metrics see it.
pub trait Pixels: Sync {
    /// Returns width and height, pixels.
    fn size(&self) -> (u32, u32);
    /// Returns the number of values, which is `height * width * 3` unless the image is damaged.
    fn n_values(&self) -> usize;
    /// Returns value `i` of `[height][width][3]` in 8-bit levels, `[0, 255]`.
    fn level(&self, i: usize) -> f64;
}

impl Pixels for Image {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn n_values(&self) -> usize {
        self.rgb.len()
    }

    fn level(&self, i: usize) -> f64 {
        f64::from(self.rgb[i])
    }
}

/// A render that was not rounded: `[height][width][3]`, clamped to `[0, 1]` when it is measured.
#[derive(Clone, Copy, Debug)]
pub struct FloatImage<'a> {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `[height][width][3]`, row 0 on top; 1 is white.
    pub rgb: &'a [f32],
}

impl Pixels for FloatImage<'_> {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn n_values(&self) -> usize {
        self.rgb.len()
    }

    /// Returns the level; NaN becomes 0, as in [`quantize`].
    fn level(&self, i: usize) -> f64 {
        let value = self.rgb[i];
        if value.is_nan() {
            return 0.0;
        }
        f64::from(value.clamp(0.0, 1.0)) * 255.0
    }
}

/// Rounds a render (`height * width * 3` values in `[0, 1]`, row 0 on top) to 8 bit: clamped,
/// nearest, halves upwards. NaN becomes 0.
///
/// # Errors
/// There are no values, or not `height * width * 3`.
pub fn quantize(width: u32, height: u32, rgb: &[f32]) -> Result<Image> {
    let image = Image {
        width,
        height,
        rgb: rgb
            .iter()
            // `as` saturates, which is the clamp.
            .map(|&value| (f64::from(value) * 255.0 + 0.5) as u8)
            .collect(),
    };
    check_size(&image)?;
    Ok(image)
}

/// Checks that both images are whole and of one size, and returns that, width and height in pixels.
fn check_pair(render: &impl Pixels, truth: &impl Pixels) -> Result<(usize, usize)> {
    check_size(render)?;
    check_size(truth)?;
    let (size, other) = (render.size(), truth.size());
    if size != other {
        return Err(Error::new(format!(
            "the render is {}x{} and the photograph {}x{}",
            size.0, size.1, other.0, other.1
        ))
        .way_out("render at the photograph's size"));
    }
    Ok((size.0 as usize, size.1 as usize))
}

fn check_size(image: &impl Pixels) -> Result<()> {
    let (width, height) = image.size();
    let n = (width as usize)
        .checked_mul(height as usize)
        .and_then(|n| n.checked_mul(3));
    if image.n_values() == 0 || n != Some(image.n_values()) {
        return Err(Error::new(format!(
            "an image of {width}x{height} has {} values",
            image.n_values()
        )));
    }
    Ok(())
}

/// Counts the set pixels of a mask for two images that [`check_pair`] accepts; `None` if it is
/// empty.
fn n_masked(render: &impl Pixels, truth: &impl Pixels, mask: &[bool]) -> Result<Option<usize>> {
    let (width, height) = check_pair(render, truth)?;
    let n_pixels = width * height;
    if mask.len() != n_pixels {
        return Err(Error::new(format!(
            "the mask has {} pixels, the images have {n_pixels}",
            mask.len()
        )));
    }
    let n_set = mask.iter().filter(|&&set| set).count();
    Ok((n_set > 0).then_some(n_set))
}
