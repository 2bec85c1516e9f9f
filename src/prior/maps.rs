//! This module has maps of features, `[height][width][channels]`, and the layers of the dense head
//! on them.

use rayon::prelude::*;

use super::layers::Linear;
use super::math::{Strided, multiply};
use super::weights::Weights;
use crate::error::Result;

/// Pixels whose surroundings are gathered at once; a constant, so that sums do not depend on the
/// number of threads.
const BAND_PX: usize = 256;

/// Size of the embedding of places beside the features.
const PLACE_SHARE: f64 = 0.1;
/// Base of its frequencies.
const PLACE_BASE: f64 = 100.0;

#[derive(Clone, Debug)]
pub(super) struct Map {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    pub values: Vec<f32>,
}

impl Map {
    /// Adds where each pixel is, by sines and cosines of its place on an image plane of aspect
    /// `width / height` whose diagonal is 2.
    pub(crate) fn add_places(&mut self, aspect: f64) {
        let diagonal = aspect.hypot(1.0);
        let by_column = places(self.width, aspect / diagonal, self.channels / 4);
        let by_row = places(self.height, 1.0 / diagonal, self.channels / 4);
        let half = self.channels / 2;
        self.values
            .par_chunks_exact_mut(self.width * self.channels)
            .zip(by_row.par_chunks_exact(half))
            .for_each(|(row, v)| {
                for (pixel, u) in row
                    .chunks_exact_mut(2 * half)
                    .zip(by_column.chunks_exact(half))
                {
                    let place = u.iter().chain(v);
                    pixel
                        .iter_mut()
                        .zip(place)
                        .for_each(|(value, place)| *value += place);
                }
            });
    }

    /// Interpolates bilinearly, so that the corners of both maps coincide.
    pub(crate) fn resized(&self, height: usize, width: usize) -> Map {
        let (rows, columns) = (
            corner_taps(self.height, height),
            corner_taps(self.width, width),
        );
        let c = self.channels;
        let mut values = vec![0.0; height * width * c];
        values
            .par_chunks_exact_mut(width * c)
            .zip(rows)
            .for_each(|(out, (y, t))| {
                let row = |y: usize| {
                    &self.values[y.min(self.height - 1) * self.width * c..][..self.width * c]
                };
                let (above, below) = (row(y), row(y + 1));
                for (out, (x, s)) in out.chunks_exact_mut(c).zip(&columns) {
                    let (left, right) = (*x * c, (x + 1).min(self.width - 1) * c);
                    for (i, value) in out.iter_mut().enumerate() {
                        let top = (1.0 - s) * above[left + i] + s * above[right + i];
                        let bottom = (1.0 - s) * below[left + i] + s * below[right + i];
                        *value = (1.0 - t) * top + t * bottom;
                    }
                }
            });
        Map {
            height,
            width,
            channels: c,
            values,
        }
    }

    pub(crate) fn add(&mut self, other: &Map) {
        let (values, others) = (self.values.par_iter_mut(), other.values.par_iter());
        values.zip(others).for_each(|(a, b)| *a += b);
    }

    /// Applies a 1x1 convolution.
    pub(crate) fn pixelwise(&self, linear: &Linear) -> Map {
        Map {
            channels: linear.n_out,
            values: linear.apply(&self.values),
            ..*self
        }
    }
}

/// Returns `[n][2 frequencies]`: sines and cosines of the places between `-span` and `span`.
fn places(n: usize, span: f64, n_frequencies: usize) -> Vec<f32> {
    let end = span * (n as f64 - 1.0) / n as f64;
    let step = if n > 1 {
        2.0 * end / (n as f64 - 1.0)
    } else {
        0.0
    };
    let angles = |i: usize| {
        let place = i as f64 * step - end;
        (0..n_frequencies).map(move |k| place * PLACE_BASE.powf(-(k as f64) / n_frequencies as f64))
    };
    (0..n)
        .flat_map(|i| angles(i).map(f64::sin).chain(angles(i).map(f64::cos)))
        .map(|value| (PLACE_SHARE * value) as f32)
        .collect()
}

/// Returns for each of `n_out` places the stored one before it and the share of the one after that.
fn corner_taps(n_in: usize, n_out: usize) -> Vec<(usize, f32)> {
    let scale = if n_out > 1 {
        (n_in - 1) as f32 / (n_out - 1) as f32
    } else {
        0.0
    };
    let taps = (0..n_out).map(|i| {
        let source = i as f32 * scale;
        let before = (source as usize).min(n_in - 1);
        (before, source - before as f32)
    });
    taps.collect()
}

/// A 3x3 convolution with zeros around the map.
#[derive(Clone, Debug)]
pub(super) struct Conv3 {
    n_in: usize,
    n_out: usize,
    stride: usize,
    /// `[n_out][3][3][n_in]`.
    weight: Vec<f32>,
    /// `[n_out]`, or empty.
    bias: Vec<f32>,
}

impl Conv3 {
    pub(crate) fn read(
        weights: &mut Weights,
        name: &str,
        n_in: usize,
        n_out: usize,
    ) -> Result<Conv3> {
        let bias = weights.tensor(&format!("{name}.bias"), &[n_out])?;
        Ok(Conv3 {
            bias,
            ..Self::read_without_bias(weights, name, n_in, n_out)?
        })
    }

    pub(crate) fn read_without_bias(
        weights: &mut Weights,
        name: &str,
        n_in: usize,
        n_out: usize,
    ) -> Result<Conv3> {
        let stored = weights.tensor(&format!("{name}.weight"), &[n_out, n_in, 3, 3])?;
        Ok(Conv3 {
            n_in,
            n_out,
            stride: 1,
            // The 9 taps of an input channel come one after the other in the file.
            weight: regrouped(&stored, n_in, 9),
            bias: Vec::new(),
        })
    }

    pub(crate) fn with_stride(self, stride: usize) -> Conv3 {
        Conv3 { stride, ..self }
    }

    pub(crate) fn apply(&self, input: &Map) -> Map {
        self.apply_after(input, |x| x)
    }

    /// Convolves the rectified map.
    pub(crate) fn apply_rectified(&self, input: &Map) -> Map {
        self.apply_after(input, |x| x.max(0.0))
    }

    fn apply_after(&self, input: &Map, first: impl Fn(f32) -> f32 + Sync) -> Map {
        let [height, width] = [input.height, input.width].map(|n| (n - 1) / self.stride + 1);
        let patch_len = 9 * self.n_in;
        let mut values = vec![0.0; height * width * self.n_out];
        values
            .par_chunks_mut(BAND_PX * self.n_out)
            .enumerate()
            .for_each_init(
                || vec![0.0; BAND_PX * patch_len],
                |patches, (band, out)| {
                    let n = out.len() / self.n_out;
                    let patches = &mut patches[..n * patch_len];
                    for (patch, pixel) in patches.chunks_exact_mut(patch_len).zip(band * BAND_PX..)
                    {
                        self.gather(input, pixel / width, pixel % width, patch, &first);
                    }
                    let weight = Strided::rows(&self.weight, self.n_out, patch_len).transposed();
                    multiply(
                        out,
                        self.n_out,
                        1.0,
                        Strided::rows(patches, n, patch_len),
                        weight,
                    );
                    for pixel in out.chunks_exact_mut(self.n_out) {
                        pixel
                            .iter_mut()
                            .zip(&self.bias)
                            .for_each(|(value, bias)| *value += bias);
                    }
                },
            );
        Map {
            height,
            width,
            channels: self.n_out,
            values,
        }
    }

    /// Gathers the 3x3 pixels around an output's, `[3][3][n_in]`.
    fn gather(
        &self,
        input: &Map,
        y: usize,
        x: usize,
        patch: &mut [f32],
        first: impl Fn(f32) -> f32,
    ) {
        for (tap, out) in patch.chunks_exact_mut(self.n_in).enumerate() {
            // One more than the place, which may be one before the first.
            let (y, x) = (y * self.stride + tap / 3, x * self.stride + tap % 3);
            if (1..=input.height).contains(&y) && (1..=input.width).contains(&x) {
                let at = ((y - 1) * input.width + x - 1) * self.n_in;
                let pixel = &input.values[at..][..self.n_in];
                out.iter_mut()
                    .zip(pixel)
                    .for_each(|(out, x)| *out = first(*x));
            } else {
                out.fill(0.0);
            }
        }
    }
}

/// Reorders `[rows][n_in][n_taps]` to `[rows][n_taps][n_in]`; nothing stays nothing.
fn regrouped(stored: &[f32], n_in: usize, n_taps: usize) -> Vec<f32> {
    let rows = stored.chunks_exact(n_in * n_taps);
    rows.flat_map(|row| {
        (0..n_taps).flat_map(move |tap| (0..n_in).map(move |i| row[i * n_taps + tap]))
    })
    .collect()
}

/// A transposed convolution whose stride is its side: each pixel becomes a square of pixels.
#[derive(Clone, Debug)]
pub(super) struct Spread {
    side: usize,
    channels: usize,
    /// `[side][side][n_out][n_in]`.
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Spread {
    pub(crate) fn read(
        weights: &mut Weights,
        name: &str,
        channels: usize,
        side: usize,
    ) -> Result<Spread> {
        let shape = [channels, channels, side, side];
        let stored = weights.tensor(&format!("{name}.weight"), &shape)?;
        // `[n_in][n_out][taps]` to `[taps][n_out][n_in]`.
        let n_taps = side * side;
        let mut weight = vec![0.0; stored.len()];
        for (at, value) in stored.iter().enumerate() {
            let (i, o, tap) = (at / n_taps / channels, at / n_taps % channels, at % n_taps);
            weight[(tap * channels + o) * channels + i] = *value;
        }
        Ok(Spread {
            side,
            channels,
            weight,
            bias: weights.tensor(&format!("{name}.bias"), &[channels])?,
        })
    }

    pub(crate) fn apply(&self, input: &Map) -> Map {
        let (side, c) = (self.side, self.channels);
        let (height, width) = (input.height * side, input.width * side);
        let mut values = vec![0.0; height * width * c];
        let rows = input.values.par_chunks_exact(input.width * c);
        values
            .par_chunks_exact_mut(side * width * c)
            .zip(rows)
            .for_each(|(out, row)| {
                let weight = Strided::rows(&self.weight, side * side * c, c).transposed();
                let mut squares = vec![0.0; input.width * side * side * c];
                let row = Strided::rows(row, input.width, c);
                multiply(&mut squares, side * side * c, 1.0, row, weight);
                for (x, square) in squares.chunks_exact(side * side * c).enumerate() {
                    for (tap, made) in square.chunks_exact(c).enumerate() {
                        let at = (tap / side * width + x * side + tap % side) * c;
                        for ((out, made), bias) in
                            out[at..][..c].iter_mut().zip(made).zip(&self.bias)
                        {
                            *out = made + bias;
                        }
                    }
                }
            });
        Map {
            height,
            width,
            channels: c,
            values,
        }
    }
}
