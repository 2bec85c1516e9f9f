//! This module reads back what a forward pass leaves: projected Gaussians, and each tile's list in its order.
//!
//! What looks at single Gaussians of a pixel now and then walks the list on the CPU. That is a small part of a render, and it
//! needs no kernel of its own.

use super::capacity::Capacity;
use super::kernels::Kernels;
use super::model::Model;
use super::uniforms::{Splat, ViewUniform};
use super::workspace::Workspace;
use crate::error::Result;
use crate::gpu::Gpu;

/// The lists of a view's tiles.
pub struct Lists {
    splats: Vec<Splat>,
    /// The part of `entries` that each tile blends.
    ranges: Vec<[u32; 2]>,
    /// Gaussian and pair.
    entries: Vec<[u32; 2]>,
    size: [u32; 2],
    tile: [u32; 2],
    /// Tiles across.
    across: u32,
}

/// A Gaussian in the list of a pixel's tile, as the pixel has it.
#[derive(Clone, Copy, Debug)]
pub struct Listed {
    /// Its index in the model.
    pub gaussian: u32,
    /// Binary logarithm of its falloff, 0 at its mean and below 0 elsewhere.
    pub log2_falloff: f32,
    /// Opacity times falloff, below [`ALPHA_MIN`] too, of which nothing is drawn.
    ///
    /// [`ALPHA_MIN`]: crate::gpu::constants::ALPHA_MIN
    pub alpha: f32,
}

impl Lists {
    /// Returns the bytes of the largest buffer that is read, at most.
    pub fn bytes(capacity: &Capacity) -> u64 {
        let splats = size_of::<Splat>() * capacity.stride;
        let entries = size_of::<[u32; 2]>() * capacity.pairs;
        splats.max(entries) as u64
    }

    /// Reads those of the view that was rendered last.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read(
        gpu: &Gpu,
        kernels: &Kernels,
        workspace: &Workspace,
        model: &Model,
        view: &ViewUniform,
    ) -> Result<Lists> {
        let rasterizer = kernels.rasterizer;
        let n_tiles = rasterizer.n_tiles(view.size);
        let ranges: Vec<[u32; 2]> = workspace.buffer("tile_ranges").read(gpu, n_tiles)?;
        let n_entries = ranges.iter().map(|range| range[1]).max().unwrap_or(0);
        Ok(Lists {
            splats: workspace.buffer("splats").read(gpu, model.n)?,
            entries: workspace.tile_splats().read(gpu, n_entries as usize)?,
            ranges,
            size: view.size,
            tile: rasterizer.tile(),
            across: rasterizer.tiles(view.size)[0],
        })
    }

    /// Returns width and height of the view, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Iterates over the list of the tile of pixel `x`, `y`, from the front.
    pub fn at(&self, x: u32, y: u32) -> impl Iterator<Item = Listed> {
        let tile = (y / self.tile[1]) * self.across + x / self.tile[0];
        let [first, end] = self.ranges[tile as usize].map(|at| at as usize);
        let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
        self.entries[first.min(end)..end]
            .iter()
            .map(move |[gaussian, _]| {
                let splat = &self.splats[*gaussian as usize];
                let (dx, dy) = (px - splat.anchor[0], py - splat.anchor[1]);
                let t_x = splat.t_0[0] + splat.l_xx * dx + splat.l_xy * dy;
                let t_y = splat.t_0[1] + splat.l_yy * dy;
                let log2_falloff = -(t_x * t_x + t_y * t_y);
                Listed {
                    gaussian: *gaussian,
                    log2_falloff,
                    alpha: splat.opacity * log2_falloff.exp2(),
                }
            })
    }
}
