//! This module tells where the squared error of a render lies, and what would take it away.
//!
//! Errors are squared differences in 8-bit levels, added up over the channels, as PSNR has them
//! before it takes their mean. What is left after a fit or within a window is no measure of a
//! method: it looks at the photograph.

use nalgebra::{Matrix3, Vector3};

use super::psnr::psnr_of;
use super::{Pixels, check_pair};
use crate::error::Result;

/// Singular values below this share of the largest are rounding: a grey render has one channel.
const LEAST_SINGULAR: f64 = 1e-9;

/// The colours that a render may take to fit its photograph, the same for all its pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColourFit {
    /// A gain and an offset for each channel, as exposure and white balance change it.
    Gains,
    /// A 3x4 matrix: each channel is a sum of all three and an offset.
    Matrix,
}

/// Returns the squared error of every pixel (`height * width`): the least that any pixel of the
/// render within `reach` pixels in x and in y has against the photograph's. A `reach` of 0 is the
/// error itself.
///
/// What a larger reach takes away is an upper bound of what misplacement by so many pixels costs:
/// among more colours some fits better by chance, too.
///
/// # Errors
/// The images differ in size or are not whole.
pub fn squared_errors(
    render: &impl Pixels,
    photograph: &impl Pixels,
    reach: usize,
) -> Result<Vec<f64>> {
    let (width, height) = check_pair(render, photograph)?;
    let squared = |i: usize, j: usize| -> f64 {
        let channels = (0..3).map(|c| render.level(3 * j + c) - photograph.level(3 * i + c));
        channels.map(|difference| difference * difference).sum()
    };
    let least = |i: usize| {
        let (x, y) = (i % width, i / width);
        let columns = x.saturating_sub(reach)..=(x + reach).min(width - 1);
        let rows = y.saturating_sub(reach)..=(y + reach).min(height - 1);
        let around = rows.flat_map(|row| columns.clone().map(move |column| row * width + column));
        around.map(|j| squared(i, j)).fold(f64::INFINITY, f64::min)
    };
    Ok((0..width * height).map(least).collect())
}

/// Returns the squared error of a whole render after its colours were fitted to the photograph's,
/// by least squares over all pixels and without clamping.
///
/// # Errors
/// As [`squared_errors`].
pub fn fitted_error(render: &impl Pixels, photograph: &impl Pixels, fit: ColourFit) -> Result<f64> {
    check_pair(render, photograph)?;
    let (from, to) = (mean_colour(render), mean_colour(photograph));
    // Sums of products of what the channels have beyond their means: an offset is fitted then.
    let (mut own, mut cross, mut total) = (Matrix3::zeros(), Matrix3::zeros(), 0.0);
    for i in 0..render.n_values() / 3 {
        let a = colour(render, i) - from;
        let b = colour(photograph, i) - to;
        own += a * a.transpose();
        cross += a * b.transpose();
        total += b.norm_squared();
    }
    let explained = match fit {
        ColourFit::Gains => (0..3)
            .filter(|&c| own[(c, c)] > 0.0)
            .map(|c| cross[(c, c)] * cross[(c, c)] / own[(c, c)])
            .sum(),
        ColourFit::Matrix => explained(own, cross),
    };
    Ok((total - explained).max(0.0))
}

/// Returns PSNR, dB, after the render's colours were fitted to the photograph's by the best 3x4 matrix
/// ([`fitted_error`]): what exposure and white balance take of it is the difference to PSNR itself. It looks at the
/// photograph, and stands beside PSNR, never in its place.
///
/// # Errors
/// As [`squared_errors`].
pub fn fitted_psnr(render: &impl Pixels, photograph: &impl Pixels) -> Result<f64> {
    let left = fitted_error(render, photograph, ColourFit::Matrix)?;
    Ok(psnr_of(left, render.n_values()))
}

/// Returns how much of the squares the best matrix explains, by the pseudo-inverse of `own`.
fn explained(own: Matrix3<f64>, cross: Matrix3<f64>) -> f64 {
    let svd = own.svd(true, true);
    let least = LEAST_SINGULAR * svd.singular_values.max();
    // Both factors are asked for, so that there is a solution.
    let solution = svd
        .solve(&cross, least)
        .unwrap_or_else(|_| Matrix3::zeros());
    (cross.transpose() * solution).trace()
}

fn colour(image: &impl Pixels, pixel: usize) -> Vector3<f64> {
    Vector3::from_fn(|c, _| image.level(3 * pixel + c))
}

fn mean_colour(image: &impl Pixels) -> Vector3<f64> {
    let n = image.n_values() / 3;
    let sum: Vector3<f64> = (0..n).map(|i| colour(image, i)).sum();
    sum / n as f64
}

/// Returns which pixels (`height * width`) of a photograph are edges: those in which the gradient
/// of brightness is steeper than in the share `quantile` of all pixels. A plain photograph has
/// none.
///
/// # Errors
/// An image that is not whole.
pub fn edges(photograph: &impl Pixels, quantile: f64) -> Result<Vec<bool>> {
    let (width, height) = check_pair(photograph, photograph)?;
    let brightness = |x: usize, y: usize| -> f64 {
        let first = 3 * (y * width + x);
        (first..first + 3).map(|i| photograph.level(i)).sum()
    };
    let steepness = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
        let (above, below) = (y.saturating_sub(1), (y + 1).min(height - 1));
        let slope = |difference: f64, pixels: usize| difference / pixels.max(1) as f64;
        let across = slope(brightness(right, y) - brightness(left, y), right - left);
        let down = slope(brightness(x, below) - brightness(x, above), below - above);
        across.hypot(down)
    };
    let steep: Vec<f64> = (0..width * height).map(steepness).collect();
    let mut sorted = steep.clone();
    let rank = (quantile.clamp(0.0, 1.0) * (sorted.len() - 1) as f64) as usize;
    let bound = *sorted.select_nth_unstable_by(rank, f64::total_cmp).1;
    Ok(steep.into_iter().map(|steep| steep > bound).collect())
}
