//! Structural similarity (Wang et al. 2004).

use rayon::prelude::*;

use super::{Pixels, check_pair, n_masked};
use crate::error::Result;

/// Side of the window, pixels.
const WINDOW: usize = 11;
/// Standard deviation of the window, pixels.
const WINDOW_SIGMA: f64 = 1.5;
/// SSIM's constants for values in `[0, 1]`.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Returns the structural similarity: 11x11 Gaussian window of sigma 1.5, each channel alone, zeros
/// beyond the border (`conv2d` with padding 5), mean over all pixels and channels.
///
/// # Errors
/// The images differ in size or are not whole.
pub fn ssim(render: &impl Pixels, truth: &impl Pixels) -> Result<f64> {
    let (width, height) = check_pair(render, truth)?;
    let sum = ssim_sum(render, truth, |_| true)?;
    Ok(sum / (width * height * 3) as f64)
}

/// Returns the mean of [`ssim`]'s map over the pixels whose `mask` (`height * width`) is set; the
/// windows of pixels at the mask's edge reach beyond it. `None` for an empty mask.
///
/// # Errors
/// As [`ssim`], or a mask of another size.
pub fn masked_ssim(
    render: &impl Pixels,
    truth: &impl Pixels,
    mask: &[bool],
) -> Result<Option<f64>> {
    let Some(n_set) = n_masked(render, truth, mask)? else {
        return Ok(None);
    };
    let sum = ssim_sum(render, truth, |pixel| mask[pixel])?;
    Ok(Some(sum / (n_set * 3) as f64))
}

/// Adds up the map over the pixels that `counts`, and their channels.
fn ssim_sum(
    render: &impl Pixels,
    truth: &impl Pixels,
    counts: impl Fn(usize) -> bool + Sync,
) -> Result<f64> {
    let (width, height) = check_pair(render, truth)?;
    let window = gaussian_window();
    let row_sums: Vec<f64> = (0..height)
        .into_par_iter()
        .map_init(
            || vec![[0.0; 4]; width * 3],
            |blurred, y| {
                blur_vertically(render, truth, y, &window, blurred);
                (0..width)
                    .filter(|x| counts(y * width + x))
                    .flat_map(|x| 3 * x..3 * x + 3)
                    .map(|i| ssim_at(blurred, i, &window))
                    .sum::<f64>()
            },
        )
        .collect();
    Ok(row_sums.iter().sum())
}

/// Returns the one-dimensional window; the two-dimensional one is its outer product with itself.
fn gaussian_window() -> [f64; WINDOW] {
    let mut window = std::array::from_fn(|i| {
        let x = i as f64 - (WINDOW / 2) as f64;
        (-x * x / (2.0 * WINDOW_SIGMA * WINDOW_SIGMA)).exp()
    });
    let sum: f64 = window.iter().sum();
    window.iter_mut().for_each(|w| *w /= sum);
    window
}

/// Weights row `y` of both images, their squares' sum and their product down the columns. SSIM
/// needs the two squares only as a sum. `blurred`: `width * 3` entries.
fn blur_vertically(
    render: &impl Pixels,
    truth: &impl Pixels,
    y: usize,
    window: &[f64; WINDOW],
    blurred: &mut [[f64; 4]],
) {
    let row_len = blurred.len();
    let height = render.n_values() / row_len;
    blurred.fill([0.0; 4]);
    for (i, &weight) in window.iter().enumerate() {
        let Some(row) = (y + i).checked_sub(WINDOW / 2) else {
            continue;
        };
        if row >= height {
            continue;
        }
        for (sums, at) in blurred.iter_mut().zip(row * row_len..) {
            let (a, b) = (render.level(at) / 255.0, truth.level(at) / 255.0);
            sums[0] += weight * a;
            sums[1] += weight * b;
            sums[2] += weight * (a * a + b * b);
            sums[3] += weight * (a * b);
        }
    }
}

/// Weights along the row around value `i` and gives its SSIM.
fn ssim_at(blurred: &[[f64; 4]], i: usize, window: &[f64; WINDOW]) -> f64 {
    let half = 3 * (WINDOW / 2);
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
    (2.0 * mu_product + C1) * (2.0 * (product - mu_product) + C2)
        / ((mu_squares + C1) * (squares - mu_squares + C2))
}
