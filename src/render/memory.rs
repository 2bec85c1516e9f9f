//! What the buffers will take, before there are any.

use super::capacity::Capacity;
use super::model::{BLOCK_PLANES, n_blocks};
use super::uniforms::{
    BinUniform, LossUniform, RadixUniform, ScanUniform, SliceUniform, Splat, ViewUniform,
};
use super::workspace::{
    N_DEPTH_PASSES, n_digits, n_pair_passes, n_partials, n_scan_blocks, n_slices,
};
use crate::gpu::constants::N_TOTALS;
use crate::gpu::{Buffer, Gpu};

/// (tile, Gaussian) pairs a Gaussian that there is room for at first. At 320 pixels, pairs are
/// about 4 a Gaussian, at 1600 up to 11; a step that has more is repeated with more room.
const FIRST_PAIRS: usize = 6;

/// Pairs of one view that there is room for at first.
pub fn first_pairs(gpu: &Gpu, n_gaussians: usize) -> usize {
    (FIRST_PAIRS * n_gaussians.max(2048)).min(most_pairs(gpu))
}

/// Most pairs of one view that the adapter can bind: a pair's largest entry is a `vec4f`.
pub fn most_pairs(gpu: &Gpu) -> usize {
    (gpu.max_binding() / 16) as usize
}

/// Bytes of a [`super::Model`].
pub fn model_bytes(stride: usize, sh_degree: u32) -> u64 {
    let planes = |(i, planes)| if i < n_blocks(sh_degree) { planes } else { 0 };
    let planes = BLOCK_PLANES.into_iter().enumerate().map(planes);
    planes.map(|n| vectors(n * stride)).sum()
}

/// Bytes of the largest of its blocks.
pub fn block_bytes(stride: usize, sh_degree: u32) -> u64 {
    let planes = BLOCK_PLANES[..n_blocks(sh_degree)].iter();
    planes.map(|n| vectors(n * stride)).max().unwrap_or(0)
}

/// Bytes of a [`super::Workspace`] for training, by what its buffers are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorkspaceBytes {
    /// Projected Gaussians.
    pub splats: u64,
    pub pairs: u64,
    /// Second halves of the sorts' buffers, and counts of digits.
    pub sorts: u64,
    /// The render, where each tile's pairs are, and the tiles' order.
    pub image: u64,
    pub goals: u64,
    /// L1 and SSIM, forward and backward.
    pub loss: u64,
    pub pair_gradients: u64,
    pub gradients: u64,
    pub uniforms: u64,
}

impl WorkspaceBytes {
    pub fn of(capacity: Capacity) -> WorkspaceBytes {
        let Capacity {
            stride,
            pairs,
            tiles,
            tile_rows: _,
            slices: _,
            tile_slots,
            plane,
        } = capacity;
        let partials = n_partials(plane);
        WorkspaceBytes {
            splats: Buffer::storage_bytes::<Splat>(stride)
                + two_words(stride)
                + words(stride.next_multiple_of(4)),
            pairs: vectors(pairs.div_ceil(2)) + words(pairs),
            sorts: 2 * vectors(stride.div_ceil(2))
                + vectors(pairs.div_ceil(2))
                + words(n_digits(capacity))
                + words(n_scan_blocks(capacity)),
            image: vectors(4 * plane) + vectors(plane) + two_words(tiles) + words(tile_slots),
            goals: 2 * vectors(plane),
            loss: vectors(13 * plane)
                + vectors(9 * plane)
                + vectors(4 * plane)
                + 2 * two_words(partials)
                + two_words(2),
            pair_gradients: 2 * vectors(pairs) + words(pairs),
            gradients: vectors(3 * stride) + vectors(2 * stride) + two_words(stride),
            uniforms: uniform_bytes(capacity),
        }
    }

    pub fn total(&self) -> u64 {
        let WorkspaceBytes {
            splats,
            pairs,
            sorts,
            image,
            goals,
            loss,
            pair_gradients,
            gradients,
            uniforms,
        } = *self;
        splats + pairs + sorts + image + goals + loss + pair_gradients + gradients + uniforms
    }
}

fn uniform_bytes(capacity: Capacity) -> u64 {
    let radix = size_of::<RadixUniform>();
    let slot = size_of::<ViewUniform>()
        + size_of::<LossUniform>()
        + 3 * size_of::<ScanUniform>()
        + N_DEPTH_PASSES as usize * radix;
    let passes = n_pair_passes(capacity.tiles) as usize * radix;
    let modes = 2 * size_of::<BinUniform>() + n_slices(capacity) * size_of::<SliceUniform>();
    (2 * slot + passes + modes) as u64 + words(N_TOTALS as usize)
}

/// Bytes of a buffer of `n` `vec4f`s, of `n` pairs of words, of `n` words.
fn vectors(n: usize) -> u64 {
    Buffer::storage_bytes::<[f32; 4]>(n)
}

fn two_words(n: usize) -> u64 {
    Buffer::storage_bytes::<[u32; 2]>(n)
}

fn words(n: usize) -> u64 {
    Buffer::storage_bytes::<u32>(n)
}
