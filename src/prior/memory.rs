//! This module predicts what the network takes, before it is read.

use super::PATCH_PX;
use super::block::BAND_QUERIES;
use super::model::Model;

/// Bytes that a prediction takes at its peak.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// The parameters, four bytes each.
    pub weights: u64,
    /// Images, tokens, attention and features.
    pub activations: u64,
}

impl Memory {
    /// Returns the sum of both, which saturates.
    pub fn total(&self) -> u64 {
        self.weights.saturating_add(self.activations)
    }
}

/// Returns the peak for so many views of one size, with `n_threads` at work.
pub fn memory(
    model: &Model,
    n_views: usize,
    (width, height): (u32, u32),
    n_threads: usize,
) -> Memory {
    let side = PATCH_PX as u64;
    let (width, height) = (u64::from(width), u64::from(height));
    let patches = (width / side) * (height / side);
    let [views, c] = [n_views, model.channels].map(|n| n as u64);
    let tokens = views * (patches + 1);
    let images = views * width * height * 3;
    // Four maps of two widths, all kept for the head.
    let features = 8 * views * patches * c;
    // A block has the tokens, those of the last local block, a normalised copy and four widths.
    let block = 7 * tokens * c + n_threads as u64 * BAND_QUERIES as u64 * tokens;
    let f = model.features as u64;
    let outs: u64 = model.out_channels.iter().map(|n| *n as u64).sum();
    // One view in the head: the maps of four levels, and the last ones at full size.
    let head =
        patches * (4 * c + 16 * (outs + f)) + width * height * (f / 2 + 32) + 64 * patches * 2 * f;
    let floats = images + features + block.max(head);
    Memory {
        weights: 4 * model.n_parameters,
        activations: 4 * floats,
    }
}
