//! This module says how the rasterizers share an image out among threads: one rule, and what follows
//! from it for tiles and stages. Sorts, scans and image losses have two kinds with them; every other
//! stage is the same for all.

use std::fmt;

use serde::Serialize;

use super::Gpu;
use super::constants::{
    BLOCK_H, BLOCK_W, GROUP_RADIX_BITS, GROUP_RADIX_CHUNK, GROUP_TILE, RADIX_BITS, RADIX_CHUNK,
    TILE_H, TILE_W, WORKGROUP,
};
use crate::config::RasterizerChoice;

/// Which threads own a tile of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Rasterizer {
    #[default]
    /// One thread a tile of 4x8 pixels: for drivers that run on a CPU, whose threads are few and wide.
    Thread,
    /// One workgroup a tile of 16x16 pixels: for GPUs. Few registers a thread, so that many are in
    /// flight; its images are those of `Thread` to the bit where the driver's arithmetic is the same.
    Workgroup,
}

/// The stages that differ between rasterizers, by name.
#[derive(Clone, Copy, Debug)]
pub struct RasterizerStages {
    /// Sorts by radix.
    pub radix: &'static str,
    /// Turns counts into prefix sums.
    pub scan: &'static str,
    /// Emits the pairs.
    pub bin: &'static str,
    /// Blends the splats of each tile.
    pub rasterize: &'static str,
    /// Compares images.
    pub ssim: &'static str,
    /// Finds the gradients of the pairs.
    pub rasterize_backward: &'static str,
    /// Blends the depths and normals of each tile.
    pub rasterize_depth: &'static str,
    /// Adds the gradients of depths and normals to the pairs'.
    pub rasterize_depth_backward: &'static str,
}

/// How a radix sort shares its entries out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RadixShape {
    /// Bits of a digit.
    pub bits: u32,
    /// Entries whose digits are counted together.
    pub chunk: u32,
    /// Threads a chunk.
    pub threads: u32,
    /// Whether the sort by depth counts each pass's digits as the pass before moves the entries.
    pub counts_moved: bool,
}

impl RadixShape {
    /// Returns the values of a digit.
    pub fn digits(self) -> u32 {
        1 << self.bits
    }

    /// Returns the passes of a sort by keys of so many bits.
    pub fn passes(self, key_bits: u32) -> u32 {
        key_bits.div_ceil(self.bits)
    }

    /// Returns the chunks of `n` entries.
    pub fn chunks(self, n: usize) -> usize {
        n.div_ceil(self.chunk as usize)
    }

    /// Returns the counts of digits of `n` entries.
    pub fn counts(self, n: usize) -> usize {
        self.chunks(n) * self.digits() as usize
    }
}

impl Rasterizer {
    /// Both, in the order in which `doctor` shows them.
    pub const ALL: [Rasterizer; 2] = [Rasterizer::Thread, Rasterizer::Workgroup];

    /// Resolves what a config asks for on an adapter. A choice by measurement could be another one in the next
    /// run, with other bits; so what stands here is a rule, of the adapter's kind: GPUs
    /// take the workgroup's, whose registers fit them and whose lists have three to five times fewer
    /// pairs to make, sort and sum. No GPU has been measured; `gspotential doctor` times both. `render::rasterizer_for` goes by
    /// the scene's size as well.
    pub fn of(choice: RasterizerChoice, gpu: &Gpu) -> Rasterizer {
        match (choice, gpu.info.device_type) {
            (RasterizerChoice::Thread, _) => Rasterizer::Thread,
            (RasterizerChoice::Workgroup, _) => Rasterizer::Workgroup,
            (RasterizerChoice::Auto, wgpu::DeviceType::Cpu) => Rasterizer::Thread,
            (RasterizerChoice::Auto, _) => Rasterizer::Workgroup,
        }
    }

    /// Returns the choice that asks for this one, whatever the adapter.
    pub fn choice(self) -> RasterizerChoice {
        match self {
            Rasterizer::Thread => RasterizerChoice::Thread,
            Rasterizer::Workgroup => RasterizerChoice::Workgroup,
        }
    }

    /// Returns the names of its own stages, those of their shaders.
    pub fn stages(self) -> RasterizerStages {
        match self {
            Rasterizer::Thread => RasterizerStages {
                radix: "radix",
                scan: "scan",
                ssim: "ssim",
                bin: "bin",
                rasterize: "rasterize",
                rasterize_backward: "rasterize_backward",
                rasterize_depth: "rasterize_depth",
                rasterize_depth_backward: "rasterize_depth_backward",
            },
            Rasterizer::Workgroup => RasterizerStages {
                radix: "radix_workgroup",
                scan: "scan_workgroup",
                ssim: "ssim_workgroup",
                bin: "bin_workgroup",
                rasterize: "rasterize_workgroup",
                rasterize_backward: "rasterize_backward_workgroup",
                rasterize_depth: "rasterize_depth_workgroup",
                rasterize_depth_backward: "rasterize_depth_backward_workgroup",
            },
        }
    }

    /// Returns how its radix sorts share their entries out.
    pub fn radix(self) -> RadixShape {
        match self {
            Rasterizer::Thread => RadixShape {
                bits: RADIX_BITS,
                chunk: RADIX_CHUNK,
                threads: 1,
                counts_moved: false,
            },
            Rasterizer::Workgroup => RadixShape {
                bits: GROUP_RADIX_BITS,
                chunk: GROUP_RADIX_CHUNK,
                threads: WORKGROUP,
                counts_moved: true,
            },
        }
    }

    /// Returns the width and height of a tile, pixels.
    pub fn tile(self) -> [u32; 2] {
        match self {
            Rasterizer::Thread => [TILE_W, TILE_H],
            Rasterizer::Workgroup => [GROUP_TILE; 2],
        }
    }

    /// Tiles across and down an image of this width and height.
    pub fn tiles(self, size: [u32; 2]) -> [u32; 2] {
        let tile = self.tile();
        [0, 1].map(|axis| size[axis].div_ceil(tile[axis]))
    }

    /// Returns the number of tiles of an image of this width and height.
    pub fn n_tiles(self, size: [u32; 2]) -> usize {
        let [across, down] = self.tiles(size);
        (across as usize).saturating_mul(down as usize)
    }

    /// Entries of the tiles' order: whole blocks of tiles.
    pub fn n_slots(self, size: [u32; 2]) -> usize {
        let [across, down] = self.tiles(size);
        let blocks =
            (across.div_ceil(BLOCK_W) as usize).saturating_mul(down.div_ceil(BLOCK_H) as usize);
        blocks.saturating_mul(WORKGROUP as usize)
    }

    /// Threads of a rasterizer's dispatch.
    pub fn n_threads(self, size: [u32; 2]) -> u64 {
        let a_tile = match self {
            Rasterizer::Thread => 1,
            Rasterizer::Workgroup => u64::from(WORKGROUP),
        };
        (self.n_slots(size) as u64).saturating_mul(a_tile)
    }
}

impl fmt::Display for Rasterizer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Rasterizer::Thread => "thread",
            Rasterizer::Workgroup => "workgroup",
        })
    }
}
