//! The buffers of one view in flight.

use super::capacity::{Capacity, check_loops};
use super::model::Model;
use super::uniforms::{
    BinUniform, LossUniform, RadixUniform, ScanUniform, SliceUniform, Splat, ViewUniform,
};
use crate::error::Result;
use crate::gpu::constants::{
    DEPTH_BITS, LIST_SLICE, N_TOTALS, RADIX_BITS, RADIX_CHUNK, RADIX_DIGITS, SCAN_CHUNK, SSIM_ROWS,
    WORKGROUP,
};
use crate::gpu::{Buffer, Gpu, shader_count};

/// The buffers of one view in flight, shared by a step's views, one after the other.
pub struct Workspace {
    pub capacity: Capacity,
    pub(super) slots: [Slot; 2],
    /// Where each slice of the lists begins, where they are sliced.
    pub(super) slices: Vec<Buffer>,
    pub(super) count: Buffer,
    pub(super) emit: Buffer,
    pub totals: Buffer,
    /// Three `vec4f`s a Gaussian, side by side: a tile's splats lie anywhere, and each then takes one
    /// cache line or two.
    pub splats: Buffer,
    pub splat_pairs: Buffer,
    pub gaussian_pairs: Buffer,
    pub(super) block_sums: Buffer,
    /// `Radix` of the depth sort's passes, per slot, and of the pair sort's.
    pub(super) pair_passes: Vec<Buffer>,
    /// (key, Gaussian); the sort ends in the first.
    pub depth_order: [Buffer; 2],
    /// (tile, pair); the sort ends in [`Workspace::tile_pairs`].
    pub(super) pairs: [Buffer; 2],
    pub(super) digit_counts: Buffer,
    pub tile_ranges: Buffer,
    pub tile_order: Buffer,
    pub pair_gaussian: Buffer,
    /// The image until the backward, which in slices keeps its own state here.
    pub rendered: Buffer,
    pub(super) last_blended: Buffer,
    pub backward: Option<Backward>,
}

/// Uniforms of one of the step's views.
pub(super) struct Slot {
    pub(super) view: Buffer,
    pub(super) loss: Buffer,
    pub(super) scan_pairs: Buffer,
    pub(super) scan_splat_digits: Buffer,
    pub(super) scan_pair_digits: Buffer,
    pub(super) depth_passes: Vec<Buffer>,
}

/// What only training needs.
pub struct Backward {
    pub(super) goal: [Buffer; 2],
    pub(super) moments: Buffer,
    pub(super) derivatives: Buffer,
    pub d_rendered: Buffer,
    pub(super) partials: Buffer,
    pub(super) block_partials: Buffer,
    /// Per view of the step: mean L1, mean SSIM.
    pub losses: Buffer,
    pub(super) d_pair_a: Buffer,
    pub(super) d_pair_b: Buffer,
    pub(super) d_pair_c: Buffer,
    pub d_geometry: Buffer,
    pub d_color: Buffer,
    pub screen: Buffer,
}

impl Workspace {
    /// Allocates; with `training`, for the backward too.
    ///
    /// # Errors
    /// A buffer that the adapter cannot bind, or an image too large for the kernels' loops.
    pub fn new(gpu: &Gpu, capacity: Capacity, training: bool) -> Result<Workspace> {
        check_loops(&capacity)?;
        let Capacity {
            stride,
            pairs,
            tiles,
            tile_rows: _,
            slices: _,
            tile_slots,
            plane,
        } = capacity;
        let slot = || Slot {
            view: Buffer::uniform::<ViewUniform>(gpu, "view"),
            loss: Buffer::uniform::<LossUniform>(gpu, "loss"),
            scan_pairs: Buffer::uniform::<ScanUniform>(gpu, "scan of pairs"),
            scan_splat_digits: Buffer::uniform::<ScanUniform>(gpu, "scan of splat digits"),
            scan_pair_digits: Buffer::uniform::<ScanUniform>(gpu, "scan of pair digits"),
            depth_passes: (0..N_DEPTH_PASSES)
                .map(|_| Buffer::uniform::<RadixUniform>(gpu, "depth pass"))
                .collect(),
        };
        let backward = if training {
            Some(Backward::new(gpu, capacity)?)
        } else {
            None
        };
        Ok(Workspace {
            capacity,
            slots: [slot(), slot()],
            slices: (0..n_slices(capacity))
                .map(|i| {
                    let first = shader_count(i) * LIST_SLICE;
                    let slice = SliceUniform { first, pad: [0; 3] };
                    Buffer::uniform_from(gpu, "slice", &slice)
                })
                .collect(),
            count: Buffer::uniform_from(
                gpu,
                "count",
                &BinUniform {
                    emits: 0,
                    pad: [0; 3],
                },
            ),
            emit: Buffer::uniform_from(
                gpu,
                "emit",
                &BinUniform {
                    emits: 1,
                    pad: [0; 3],
                },
            ),
            totals: Buffer::storage::<u32>(gpu, "totals", N_TOTALS as usize)?,
            splats: Buffer::storage::<Splat>(gpu, "splats", stride)?,
            gaussian_pairs: Buffer::storage::<[u32; 2]>(gpu, "gaussian_pairs", stride)?,
            splat_pairs: Buffer::storage::<u32>(gpu, "splat_pairs", stride.next_multiple_of(4))?,
            block_sums: Buffer::storage::<u32>(gpu, "block_sums", n_scan_blocks(capacity))?,
            pair_passes: (0..n_pair_passes(tiles))
                .map(|i| {
                    let shift = i * RADIX_BITS;
                    let pass = RadixUniform {
                        n: shader_count(pairs),
                        pairs: 1,
                        shift,
                        pad: 0,
                    };
                    Buffer::uniform_from(gpu, "pair pass", &pass)
                })
                .collect(),
            depth_order: [
                entries(gpu, "depth_order", stride)?,
                entries(gpu, "depth_order", stride)?,
            ],
            digit_counts: Buffer::storage::<u32>(gpu, "digit_counts", n_digits(capacity))?,
            pairs: [entries(gpu, "pairs", pairs)?, entries(gpu, "pairs", pairs)?],
            tile_ranges: Buffer::storage::<[u32; 2]>(gpu, "tile_ranges", tiles)?,
            tile_order: Buffer::storage::<u32>(gpu, "tile_order", tile_slots)?,
            pair_gaussian: Buffer::storage::<u32>(gpu, "pair_gaussian", pairs)?,
            rendered: Buffer::storage::<[f32; 4]>(gpu, "rendered", 4 * plane)?,
            last_blended: Buffer::storage::<[u32; 4]>(gpu, "last_blended", plane)?,
            backward,
        })
    }

    /// Sets what a slot's render of `view` is compared with, RGBA8.
    pub fn set_goal(&self, gpu: &Gpu, slot: usize, view: &ViewUniform, goal: &[u32]) {
        let Some(backward) = &self.backward else {
            return;
        };
        let width = view.size[0] as usize;
        let padded_width = 4 * view.padded_size().0;
        if width == padded_width {
            backward.goal[slot].write(gpu, goal);
            return;
        }
        let mut padded = vec![0; goal.len() / width * padded_width];
        for (to, from) in padded
            .chunks_exact_mut(padded_width)
            .zip(goal.chunks_exact(width))
        {
            to[..width].copy_from_slice(from);
        }
        backward.goal[slot].write(gpu, &padded);
    }

    /// Per view of the last step: mean L1, mean SSIM.
    pub fn read_losses(&self, gpu: &Gpu) -> Result<Vec<[f64; 2]>> {
        let Some(backward) = &self.backward else {
            return Ok(Vec::new());
        };
        let losses: Vec<[f32; 2]> = backward.losses.read(gpu, 2)?;
        Ok(losses.into_iter().map(|pair| pair.map(f64::from)).collect())
    }

    /// (tile, pair), sorted by tile, front to back within one.
    pub fn tile_pairs(&self) -> &Buffer {
        &self.pairs[self.pair_passes.len() % 2]
    }

    /// Every buffer under its name in the shaders, with those of `model`; the other halves of the
    /// sorts' buffers under names of their own.
    pub fn names<'a>(&'a self, model: &'a Model, slot: usize) -> Vec<(&'static str, &'a Buffer)> {
        let mut names = vec![
            ("view", &self.slots[slot].view),
            ("loss", &self.slots[slot].loss),
            ("geometry", &model.blocks[0]),
            ("sh_0", &model.blocks[1]),
            ("sh_2", &model.blocks[2]),
            ("sh_3", &model.blocks[3]),
            ("totals", &self.totals),
            ("splats", &self.splats),
            ("splat_pairs", &self.splat_pairs),
            ("gaussian_pairs", &self.gaussian_pairs),
            ("tile_ranges", &self.tile_ranges),
            ("tile_order", &self.tile_order),
            ("pairs", &self.pairs[0]),
            ("block_sums", &self.block_sums),
            ("depth_order", &self.depth_order[0]),
            ("digit_counts", &self.digit_counts),
            ("tile_pairs", self.tile_pairs()),
            ("depth_order_swap", &self.depth_order[1]),
            ("pairs_swap", &self.pairs[1]),
            ("pair_gaussian", &self.pair_gaussian),
            ("rendered", &self.rendered),
            ("last_blended", &self.last_blended),
        ];
        if let Some(b) = &self.backward {
            names.extend([
                ("goal", &b.goal[slot]),
                ("moments", &b.moments),
                ("derivatives", &b.derivatives),
                ("d_rendered", &b.d_rendered),
                ("partials", &b.partials),
                ("block_partials", &b.block_partials),
                ("losses", &b.losses),
                ("d_pair_a", &b.d_pair_a),
                ("d_pair_b", &b.d_pair_b),
                ("d_pair_c", &b.d_pair_c),
                ("d_geometry", &b.d_geometry),
                ("d_color", &b.d_color),
                ("screen", &b.screen),
            ]);
        }
        names
    }
}

impl Backward {
    fn new(gpu: &Gpu, capacity: Capacity) -> Result<Backward> {
        let Capacity {
            stride,
            pairs,
            plane,
            ..
        } = capacity;
        let n_partials = n_partials(plane);
        Ok(Backward {
            goal: [
                Buffer::storage::<[u32; 4]>(gpu, "goal 0", plane)?,
                Buffer::storage::<[u32; 4]>(gpu, "goal 1", plane)?,
            ],
            moments: Buffer::storage::<[f32; 4]>(gpu, "moments", 13 * plane)?,
            derivatives: Buffer::storage::<[f32; 4]>(gpu, "derivatives", 9 * plane)?,
            d_rendered: Buffer::storage::<[f32; 4]>(gpu, "d_rendered", 4 * plane)?,
            partials: Buffer::storage::<[f32; 2]>(gpu, "partials", n_partials)?,
            block_partials: Buffer::storage::<[f32; 2]>(gpu, "block_partials", n_partials)?,
            losses: Buffer::storage::<[f32; 2]>(gpu, "losses", 2)?,
            d_pair_a: Buffer::storage::<[f32; 4]>(gpu, "d_pair_a", pairs)?,
            d_pair_b: Buffer::storage::<[f32; 4]>(gpu, "d_pair_b", pairs)?,
            d_pair_c: Buffer::storage::<f32>(gpu, "d_pair_c", pairs)?,
            d_geometry: Buffer::storage::<[f32; 4]>(gpu, "d_geometry", 3 * stride)?,
            d_color: Buffer::storage::<[f32; 4]>(gpu, "d_color", 2 * stride)?,
            screen: Buffer::storage::<[f32; 2]>(gpu, "screen", stride)?,
        })
    }
}

/// `n` entries of a radix sort, which reads two at once.
fn entries(gpu: &Gpu, label: &str, n: usize) -> Result<Buffer> {
    Buffer::storage::<[u32; 4]>(gpu, label, n.div_ceil(2))
}

/// Counts of the larger radix sort.
pub(super) fn n_digits(capacity: Capacity) -> usize {
    n_chunks(capacity.stride.max(capacity.pairs)) * RADIX_DIGITS as usize
}

/// Blocks of the largest scan.
pub(super) fn n_scan_blocks(capacity: Capacity) -> usize {
    let most = capacity.stride.max(n_digits(capacity));
    most.div_ceil((SCAN_CHUNK * WORKGROUP) as usize)
}

/// Slices of the lists, none where they are not sliced.
pub(super) fn n_slices(capacity: Capacity) -> usize {
    if capacity.slices > 1 {
        capacity.slices
    } else {
        0
    }
}

/// Passes of the depth sort.
pub(super) const N_DEPTH_PASSES: u32 = DEPTH_BITS.div_ceil(RADIX_BITS);
const _: () = assert!(
    N_DEPTH_PASSES.is_multiple_of(2),
    "the sorted splats end in the first buffer"
);

/// Passes of the sort by tile.
pub(super) fn n_pair_passes(n_tiles: usize) -> u32 {
    let bits = n_tiles.max(2).next_power_of_two().ilog2();
    bits.div_ceil(RADIX_BITS)
}

/// Chunks of a radix sort.
pub(super) fn n_chunks(n: usize) -> usize {
    n.div_ceil(RADIX_CHUNK as usize)
}

/// Threads of SSIM's vertical passes over a padded image of `plane` vectors.
pub(super) fn n_partials(plane: usize) -> usize {
    3 * plane / SSIM_ROWS as usize
}
