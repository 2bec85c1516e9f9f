//! Image metrics as 3D Gaussian Splatting computes them (Kerbl et al. 2023, `metrics.py`), in f64.
//!
//! Both images are 8-bit, as 3DGS compares the files that it wrote: a render is rounded by
//! [`quantize`] first. Sums run in a fixed order, so results do not depend on the number of
//! threads.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::scene::Image;

/// Side of the SSIM window, pixels.
const WINDOW: usize = 11;
/// Standard deviation of the SSIM window, pixels.
const WINDOW_SIGMA: f64 = 1.5;
/// The constants of SSIM (Wang et al. 2004) for values in `[0, 1]`.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Rounds a render (`height * width * 3` values in `[0, 1]`, row 0 on top) to 8 bit: clamped,
/// nearest, halves upwards. NaN becomes 0.
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

/// Peak signal-to-noise ratio in dB over all pixels and channels, `20 log10(1 / sqrt(mse))`;
/// infinite for identical images.
pub fn psnr(render: &Image, truth: &Image) -> Result<f64> {
    check_pair(render, truth)?;
    let sum = squared_error(render.rgb.iter().zip(&truth.rgb));
    Ok(psnr_of(sum, render.rgb.len()))
}

/// [`psnr`] over the pixels whose `mask` (`height * width`) is set; an empty mask has none.
pub fn masked_psnr(render: &Image, truth: &Image, mask: &[bool]) -> Result<Option<f64>> {
    check_pair(render, truth)?;
    let n_pixels = render.rgb.len() / 3;
    if mask.len() != n_pixels {
        return Err(Error::new(format!(
            "the mask has {} pixels, the images have {n_pixels}",
            mask.len()
        )));
    }
    let n_set = mask.iter().filter(|&&set| set).count();
    if n_set == 0 {
        return Ok(None);
    }
    let channels = render.rgb.iter().zip(&truth.rgb).enumerate();
    let sum = squared_error(channels.filter(|(i, _)| mask[i / 3]).map(|(_, pair)| pair));
    Ok(Some(psnr_of(sum, n_set * 3)))
}

/// Structural similarity: 11x11 Gaussian window of sigma 1.5, each channel alone, zeros beyond
/// the border (`conv2d` with padding 5), mean over all pixels and channels.
pub fn ssim(render: &Image, truth: &Image) -> Result<f64> {
    check_pair(render, truth)?;
    let (width, height) = (render.width as usize, render.height as usize);
    let window = gaussian_window();
    let row_sums: Vec<f64> = (0..height)
        .into_par_iter()
        .map_init(
            || vec![[0.0; 4]; width * 3],
            |blurred, y| {
                blur_vertically(render, truth, y, &window, blurred);
                ssim_row(blurred, &window)
            },
        )
        .collect();
    Ok(row_sums.iter().sum::<f64>() / (width * height * 3) as f64)
}

/// The one-dimensional window; the two-dimensional one is its outer product with itself.
fn gaussian_window() -> [f64; WINDOW] {
    let mut window = std::array::from_fn(|i| {
        let x = i as f64 - (WINDOW / 2) as f64;
        (-x * x / (2.0 * WINDOW_SIGMA * WINDOW_SIGMA)).exp()
    });
    let sum: f64 = window.iter().sum();
    window.iter_mut().for_each(|w| *w /= sum);
    window
}

/// Row `y` of both images, their squares' sum and their product, weighted down the columns.
/// SSIM needs the two squares only as a sum. `blurred`: `width * 3` entries.
fn blur_vertically(
    render: &Image,
    truth: &Image,
    y: usize,
    window: &[f64; WINDOW],
    blurred: &mut [[f64; 4]],
) {
    let row_len = blurred.len();
    blurred.fill([0.0; 4]);
    for (i, &weight) in window.iter().enumerate() {
        let Some(row) = (y + i).checked_sub(WINDOW / 2) else {
            continue;
        };
        if row >= render.height as usize {
            continue;
        }
        let row = row * row_len..(row + 1) * row_len;
        let pixels = render.rgb[row.clone()].iter().zip(&truth.rgb[row]);
        for (sums, (&a, &b)) in blurred.iter_mut().zip(pixels) {
            let (a, b) = (f64::from(a) / 255.0, f64::from(b) / 255.0);
            sums[0] += weight * a;
            sums[1] += weight * b;
            sums[2] += weight * (a * a + b * b);
            sums[3] += weight * (a * b);
        }
    }
}

/// Weights along the row and sums the SSIM of its pixels and channels.
fn ssim_row(blurred: &[[f64; 4]], window: &[f64; WINDOW]) -> f64 {
    let half = 3 * (WINDOW / 2);
    let mut sum = 0.0;
    for i in 0..blurred.len() {
        let mut m = [0.0; 4];
        for (k, &weight) in window.iter().enumerate() {
            // Neighbours in a row are 3 channels apart; an index before 0 wraps beyond the end.
            if let Some(column) = blurred.get((i + 3 * k).wrapping_sub(half)) {
                for (total, value) in m.iter_mut().zip(column) {
                    *total += weight * value;
                }
            }
        }
        let [mu_a, mu_b, squares, product] = m;
        let mu_squares = mu_a * mu_a + mu_b * mu_b;
        let mu_product = mu_a * mu_b;
        sum += (2.0 * mu_product + C1) * (2.0 * (product - mu_product) + C2)
            / ((mu_squares + C1) * (squares - mu_squares + C2));
    }
    sum
}

/// Exact: 8-bit differences are integers. 2^64 is beyond any image in memory.
fn squared_error<'a>(pairs: impl Iterator<Item = (&'a u8, &'a u8)>) -> u64 {
    pairs.map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2)).sum()
}

fn psnr_of(squared_error: u64, n: usize) -> f64 {
    let mse = squared_error as f64 / (255.0 * 255.0 * n as f64);
    20.0 * (1.0 / mse.sqrt()).log10()
}

fn check_pair(render: &Image, truth: &Image) -> Result<()> {
    check_size(render)?;
    check_size(truth)?;
    if (render.width, render.height) != (truth.width, truth.height) {
        return Err(Error::new(format!(
            "the render is {}x{} and the photograph {}x{}",
            render.width, render.height, truth.width, truth.height
        ))
        .way_out("render at the photograph's size"));
    }
    Ok(())
}

fn check_size(image: &Image) -> Result<()> {
    let n = (image.width as usize)
        .checked_mul(image.height as usize)
        .and_then(|n| n.checked_mul(3));
    if image.rgb.is_empty() || n != Some(image.rgb.len()) {
        return Err(Error::new(format!(
            "an image of {}x{} has {} bytes",
            image.width,
            image.height,
            image.rgb.len()
        )));
    }
    Ok(())
}
