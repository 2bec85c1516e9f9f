//! Peak signal-to-noise ratio.

use super::{Pixels, check_pair, n_masked};
use crate::error::Result;

/// Returns the peak signal-to-noise ratio in dB over all pixels and channels,
/// `20 log10(1 / sqrt(mse))`; infinite for identical images.
///
/// # Errors
/// The images differ in size or are not whole.
pub fn psnr(render: &impl Pixels, truth: &impl Pixels) -> Result<f64> {
    check_pair(render, truth)?;
    let n = render.n_values();
    Ok(psnr_of(squared_error(render, truth, 0..n), n))
}

/// Returns [`psnr`] over the pixels whose `mask` (`height * width`) is set; `None` for an empty
/// mask.
///
/// # Errors
/// As [`psnr`], or a mask of another size.
pub fn masked_psnr(
    render: &impl Pixels,
    truth: &impl Pixels,
    mask: &[bool],
) -> Result<Option<f64>> {
    let Some(n_set) = n_masked(render, truth, mask)? else {
        return Ok(None);
    };
    let set = (0..render.n_values()).filter(|i| mask[i / 3]);
    Ok(Some(psnr_of(squared_error(render, truth, set), n_set * 3)))
}

/// Adds squares up in levels, so that the sum of an 8-bit pair is an integer and exact.
fn squared_error(
    render: &impl Pixels,
    truth: &impl Pixels,
    values: impl Iterator<Item = usize>,
) -> f64 {
    values
        .map(|i| (render.level(i) - truth.level(i)).powi(2))
        .sum()
}

/// Returns the PSNR of `n` values whose squared errors, in levels, add up to so much.
pub(super) fn psnr_of(squared_error: f64, n: usize) -> f64 {
    let mse = squared_error / (255.0 * 255.0 * n as f64);
    20.0 * (1.0 / mse.sqrt()).log10()
}
