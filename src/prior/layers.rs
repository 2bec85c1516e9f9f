//! This module has the layers that the parts of the network share.

use rayon::prelude::*;

use super::math::{Strided, multiply, sum};
use super::weights::Weights;
use crate::error::Result;

/// Rows of a product that one thread makes at once; a constant, so that sums do not depend on
/// the number of threads.
const BAND_ROWS: usize = 128;

/// `y = W x + b` for each row.
#[derive(Clone, Debug)]
pub(super) struct Linear {
    pub n_in: usize,
    pub n_out: usize,
    /// `[n_out][n_in]`.
    weight: Vec<f32>,
    /// `[n_out]`.
    bias: Vec<f32>,
}

impl Linear {
    pub(crate) fn read(
        weights: &mut Weights,
        name: &str,
        n_in: usize,
        n_out: usize,
    ) -> Result<Linear> {
        Self::read_shaped(weights, name, &[n_out, n_in])
    }

    /// Reads the weights of a convolution whose every input pixel is used once: 1x1, or patches
    /// side by side. The shape begins with `n_out`.
    pub(crate) fn read_shaped(
        weights: &mut Weights,
        name: &str,
        shape: &[usize],
    ) -> Result<Linear> {
        let n_out = shape[0];
        Ok(Linear {
            n_in: shape[1..].iter().product(),
            n_out,
            weight: weights.tensor(&format!("{name}.weight"), shape)?,
            bias: weights.tensor(&format!("{name}.bias"), &[n_out])?,
        })
    }

    /// Maps `[rows][n_in]` to `[rows][n_out]`.
    pub(crate) fn apply(&self, x: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; x.len() / self.n_in * self.n_out];
        out.par_chunks_mut(BAND_ROWS * self.n_out)
            .zip(x.par_chunks(BAND_ROWS * self.n_in))
            .for_each(|(out, x)| self.band(out, x));
        out
    }

    /// Computes `x += gamma (W values + b)`, gamma one a channel.
    pub(crate) fn add_scaled_to(&self, x: &mut [f32], values: &[f32], gamma: &[f32]) {
        x.par_chunks_mut(BAND_ROWS * self.n_out)
            .zip(values.par_chunks(BAND_ROWS * self.n_in))
            .for_each_init(Vec::new, |made, (x, values)| {
                made.clear();
                made.resize(x.len(), 0.0);
                self.band(made, values);
                for (x, made) in x
                    .chunks_exact_mut(self.n_out)
                    .zip(made.chunks_exact(self.n_out))
                {
                    for ((x, made), gamma) in x.iter_mut().zip(made).zip(gamma) {
                        *x += gamma * made;
                    }
                }
            });
    }

    fn band(&self, out: &mut [f32], x: &[f32]) {
        let rows = out.len() / self.n_out;
        let weight = Strided::rows(&self.weight, self.n_out, self.n_in).transposed();
        multiply(
            out,
            self.n_out,
            1.0,
            Strided::rows(x, rows, self.n_in),
            weight,
        );
        for row in out.chunks_exact_mut(self.n_out) {
            for (value, bias) in row.iter_mut().zip(&self.bias) {
                *value += bias;
            }
        }
    }
}

/// Layer normalisation (Ba et al. 2016).
#[derive(Clone, Debug)]
pub(super) struct LayerNorm {
    weight: Vec<f32>,
    bias: Vec<f32>,
    epsilon: f32,
}

impl LayerNorm {
    pub(crate) fn read(
        weights: &mut Weights,
        name: &str,
        n: usize,
        epsilon: f32,
    ) -> Result<LayerNorm> {
        Ok(LayerNorm {
            weight: weights.tensor(&format!("{name}.weight"), &[n])?,
            bias: weights.tensor(&format!("{name}.bias"), &[n])?,
            epsilon,
        })
    }

    pub(crate) fn apply(&self, x: &[f32]) -> Vec<f32> {
        let mut out = x.to_vec();
        let n = self.weight.len();
        out.par_chunks_mut(BAND_ROWS * n)
            .for_each(|band| band.chunks_exact_mut(n).for_each(|row| self.row(row)));
        out
    }

    /// Normalises one row in place.
    pub(crate) fn row(&self, row: &mut [f32]) {
        let n = row.len() as f32;
        let mean = sum(row, |x| x) / n;
        let variance = sum(row, |x| (x - mean) * (x - mean)) / n;
        let scale = 1.0 / (variance + self.epsilon).sqrt();
        for ((x, weight), bias) in row.iter_mut().zip(&self.weight).zip(&self.bias) {
            *x = (*x - mean) * scale * weight + bias;
        }
    }
}

/// Rectifies in place.
pub(super) fn relu(values: &mut [f32]) {
    for value in values {
        *value = value.max(0.0);
    }
}
