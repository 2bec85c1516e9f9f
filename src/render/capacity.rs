//! The room that a workspace has, and the sizes that no workspace may be asked for.

use super::uniforms::ViewUniform;
use crate::config::RasterizerChoice;
use crate::error::{Error, Result};
use crate::gpu::constants::{LIST_SLICE, LOOP_TURNS, MOST_TILE_ROWS, PAIR_BLOCK};
use crate::gpu::{Gpu, Rasterizer};

/// (tile, Gaussian) pairs a Gaussian that there is room for at first. At 320 pixels, pairs are
/// about 4 a Gaussian, at 1600 up to 11; a step that has more is repeated with more room.
const FIRST_PAIRS: usize = 6;

/// Returns the pairs of one view that there is room for at first.
pub fn first_pairs(gpu: &Gpu, n_gaussians: usize) -> usize {
    (FIRST_PAIRS * n_gaussians.max(2048)).min(most_pairs(gpu))
}

/// Returns the most pairs of one view that the adapter can bind: a pair's largest entry is a
/// `vec4f`.
pub fn most_pairs(gpu: &Gpu) -> usize {
    (gpu.max_binding() / 16) as usize
}

/// Returns the (tile, Gaussian) pairs that a view of `pixels` pixels of `n` Gaussians may be expected to have with tiles of
/// a thread: 1.9 times `n + 4 sqrt(n pixels) + 2 pixels`. The sum is what Gaussians have that fill the image, larger where they are
/// fewer, and meets the counts of `benches/growth` within a quarter, from 10,000 to 2,000,000 Gaussians and from 200 to 1600
/// pixels; scenes have had up to 2.3 times as many.
fn expected_pairs(n: usize, pixels: usize) -> f64 {
    let (n, pixels) = (n as f64, pixels as f64);
    1.9 * (n + 4.0 * (n * pixels).sqrt() + 2.0 * pixels)
}

/// Resolves which rasterizer a config asks for, where it is known how many Gaussians the largest view shows, and on how many pixels:
/// as [`Rasterizer::of`], but that a driver that runs on a CPU takes the workgroup's as well where it could not bind the pairs of
/// the thread's small tiles.
pub fn rasterizer_for(choice: RasterizerChoice, gpu: &Gpu, n: usize, pixels: usize) -> Rasterizer {
    let fits = expected_pairs(n, pixels) <= most_pairs(gpu) as f64;
    match Rasterizer::of(choice, gpu) {
        Rasterizer::Thread if choice == RasterizerChoice::Auto && !fits => Rasterizer::Workgroup,
        own => own,
    }
}

/// The room of a workspace, in numbers of what it holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capacity {
    /// The rasterizer that the room is for.
    pub rasterizer: Rasterizer,
    /// Gaussians, and so entries a plane of their buffers.
    pub stride: usize,
    /// (tile, Gaussian) pairs of one view.
    pub pairs: usize,
    /// Tiles of one view.
    pub tiles: usize,
    /// Rows of tiles.
    pub tile_rows: usize,
    /// Height of a tile, pixels.
    pub tile_height: usize,
    /// Slices of [`LIST_SLICE`] entries that the longest list of a tile may need; at most one where
    /// lists are not sliced.
    pub slices: usize,
    /// Entries of the tiles' order.
    pub tile_slots: usize,
    /// `vec4f`s of one padded plane.
    pub plane: usize,
}

impl Capacity {
    /// Returns the room for images of every view in `views`, one at a time.
    pub fn new(
        rasterizer: Rasterizer,
        stride: usize,
        pairs: usize,
        views: &[ViewUniform],
    ) -> Capacity {
        let largest = |of: &dyn Fn(&ViewUniform) -> usize| views.iter().map(of).max().unwrap_or(1);
        Capacity {
            rasterizer,
            stride,
            pairs,
            tiles: largest(&|view| rasterizer.n_tiles(view.size)),
            tile_rows: largest(&|view| rasterizer.tiles(view.size)[1] as usize),
            tile_height: rasterizer.tile()[1] as usize,
            slices: 1,
            tile_slots: largest(&|view| rasterizer.n_slots(view.size)),
            plane: largest(&ViewUniform::plane_len),
        }
    }

    /// Returns the larger of both in every respect.
    pub fn union(&self, other: &Capacity) -> Capacity {
        Capacity {
            rasterizer: self.rasterizer,
            stride: self.stride.max(other.stride),
            pairs: self.pairs.max(other.pairs),
            tiles: self.tiles.max(other.tiles),
            tile_rows: self.tile_rows.max(other.tile_rows),
            tile_height: self.tile_height.max(other.tile_height),
            slices: self.slices.max(other.slices),
            tile_slots: self.tile_slots.max(other.tile_slots),
            plane: self.plane.max(other.plane),
        }
    }

    /// Returns whether `other` fits.
    pub fn holds(&self, other: &Capacity) -> bool {
        self.union(other) == *self
    }

    /// Returns the entries of the longest list that the slices cover.
    pub(super) fn longest_list(&self) -> usize {
        self.slices.max(1) * LIST_SLICE as usize
    }
}

/// Refuses images that the kernels' loops do not get through on a driver that ends them after
/// [`LOOP_TURNS`] turns.
pub(super) fn check_loops(capacity: &Capacity) -> Result<()> {
    if capacity.tile_rows > MOST_TILE_ROWS as usize {
        let most = MOST_TILE_ROWS as usize * capacity.tile_height;
        let height = capacity.tile_rows.saturating_mul(capacity.tile_height);
        return Err(Error::new(format!(
            "an image of {height} rows of pixels, padded to whole tiles: kernels take at most {most}"
        ))
        .way_out("use smaller images (`--max-size`)"));
    }
    // sum_gaussians adds up a Gaussian's pairs, one a tile at most.
    let most = (LOOP_TURNS - 4 * PAIR_BLOCK) as usize * (PAIR_BLOCK * PAIR_BLOCK) as usize;
    if capacity.tiles > most {
        return Err(Error::new(format!(
            "an image of {} tiles: kernels take at most {most}",
            capacity.tiles
        ))
        .way_out("use smaller images (`--max-size`)"));
    }
    Ok(())
}
