//! The layers of the nets, in f32.
//!
//! Tensors are `[height][width][channels]`, so that what a convolution sees of one pixel, and what
//! it makes of one, are contiguous. A convolution is a matrix product of its weights with the
//! patches of a band of pixels (im2col); nalgebra hands it to `matrixmultiply`. The file
//! `benches/runs/2026-11-22-llvmpipe/lpips.md` holds what else was measured, and how much faster
//! this is.

use nalgebra::{DMatrixView, DMatrixViewMut};
use rayon::prelude::*;

/// Pixels whose patches are gathered at once; a constant, so that sums do not depend on the
/// number of threads.
const BAND_PX: usize = 512;

/// Activations, `[height][width][channels]`.
#[derive(Clone, Debug)]
pub(super) struct Tensor {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    pub values: Vec<f32>,
}

/// A convolution with zeros beyond the border, followed by ReLU.
#[derive(Clone, Debug)]
pub(super) struct Conv {
    pub n_in: usize,
    pub n_out: usize,
    /// Side of the kernel.
    pub side: usize,
    pub stride: usize,
    pub padding: usize,
    /// `[side][side][n_in][n_out]`.
    pub weights: Vec<f32>,
    /// `[n_out]`.
    pub bias: Vec<f32>,
}

impl Conv {
    /// Returns the features of `input`, which has `n_in` channels and holds the kernel at least
    /// once.
    pub(crate) fn apply(&self, input: &Tensor) -> Tensor {
        let fits = |length: usize| (length + 2 * self.padding - self.side) / self.stride + 1;
        let (height, width) = (fits(input.height), fits(input.width));
        let patch_len = self.side * self.side * self.n_in;
        let weights = DMatrixView::from_slice(&self.weights, self.n_out, patch_len);
        let mut values = vec![0.0; height * width * self.n_out];
        values
            .par_chunks_mut(BAND_PX * self.n_out)
            .enumerate()
            .for_each_init(Vec::new, |patches, (band, out)| {
                let n = out.len() / self.n_out;
                patches.clear();
                patches.resize(n * patch_len, 0.0);
                for (patch, pixel) in patches.chunks_exact_mut(patch_len).zip(band * BAND_PX..) {
                    self.gather(input, pixel / width, pixel % width, patch);
                }
                let patches = DMatrixView::from_slice(patches, patch_len, n);
                DMatrixViewMut::from_slice(out, self.n_out, n).gemm(1.0, &weights, &patches, 0.0);
                for pixel in out.chunks_exact_mut(self.n_out) {
                    for (value, bias) in pixel.iter_mut().zip(&self.bias) {
                        *value = (*value + bias).max(0.0);
                    }
                }
            });
        Tensor {
            height,
            width,
            channels: self.n_out,
            values,
        }
    }

    /// Copies what the kernel sees for the output pixel (`y`, `x`) into `patch`
    /// (`[side][side][n_in]`, zeroed).
    fn gather(&self, input: &Tensor, y: usize, x: usize, patch: &mut [f32]) {
        // Each row of the kernel counts with the columns that lie within the image.
        let left = x * self.stride;
        let first = self.padding.saturating_sub(left);
        let end = (input.width + self.padding)
            .saturating_sub(left)
            .min(self.side);
        if first >= end {
            return;
        }
        let run = (end - first) * self.n_in;
        for ky in 0..self.side {
            let Some(row) = (y * self.stride + ky).checked_sub(self.padding) else {
                continue;
            };
            if row >= input.height {
                break;
            }
            let from = (row * input.width + left + first - self.padding) * self.n_in;
            let to = (ky * self.side + first) * self.n_in;
            patch[to..to + run].copy_from_slice(&input.values[from..from + run]);
        }
    }
}

/// Pools by maximum without padding; what does not fill a window at the far edges is left out.
pub(super) fn max_pool(input: &Tensor, side: usize, stride: usize) -> Tensor {
    let fits = |length: usize| (length - side) / stride + 1;
    let (height, width) = (fits(input.height), fits(input.width));
    let n = input.channels;
    let mut values = vec![f32::NEG_INFINITY; height * width * n];
    values
        .par_chunks_mut(width * n)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, out) in row.chunks_exact_mut(n).enumerate() {
                for ky in 0..side {
                    let from = ((y * stride + ky) * input.width + x * stride) * n;
                    for pixel in input.values[from..from + side * n].chunks_exact(n) {
                        for (most, &value) in out.iter_mut().zip(pixel) {
                            *most = most.max(value);
                        }
                    }
                }
            }
        });
    Tensor {
        height,
        width,
        channels: n,
        values,
    }
}
