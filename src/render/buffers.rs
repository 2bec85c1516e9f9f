//! The buffers of a workspace, each described once: from here they are allocated, found by name for
//! binding, and counted before there are any.

use super::capacity::Capacity;
use super::uniforms::{
    BinUniform, LossUniform, RadixUniform, ScanUniform, SliceUniform, Splat, ViewUniform,
};
use crate::gpu::constants::{DEPTH_BITS, N_TOTALS, SCAN_CHUNK, TILE_H, WORKGROUP};
use crate::gpu::{BufferKind, Rasterizer, UNIFORM_ALIGNMENT};

/// The purpose under which a buffer's bytes are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Splats,
    Pairs,
    Sorts,
    Image,
    Goals,
    Loss,
    PairGradients,
    Gradients,
    Uniforms,
}

/// The buffers of one name.
pub(super) struct Described {
    pub(super) kind: BufferKind,
    part: Part,
    /// Entries of each buffer.
    len: fn(&Capacity) -> usize,
    /// Entries that training has beyond them.
    more_to_train: fn(&Capacity) -> usize,
    /// Number of buffers.
    copies: fn(&Capacity) -> usize,
    /// Whether only training needs them.
    trains: bool,
    /// Whether each of a step's views has as many of its own, which are written together.
    by_view: bool,
}

/// The plane of `d_rendered`, in training, that holds what each pixel has blended last; without, it is
/// the only one.
pub(super) const LAST_BLENDED: u32 = 4;

/// Most views of a step.
pub(super) const N_SLOTS: usize = 2;

type F4 = [f32; 4];
type F2 = [f32; 2];
type U2 = [u32; 2];
/// Two entries of a radix sort, which reads two at once.
type Entries = [u32; 4];

/// Every buffer of a workspace.
pub(super) const BUFFERS: &[Described] = &[
    of_view::<ViewUniform>("view", |_| N_SLOTS),
    of_view::<ScanUniform>("scan_pairs", |_| N_SLOTS),
    of_view::<ScanUniform>("scan_splat_digits", |_| N_SLOTS),
    of_view::<ScanUniform>("scan_pair_digits", |_| N_SLOTS),
    of_view::<RadixUniform>("depth_passes", |c| N_SLOTS * n_depth_passes(c)),
    uniform::<LossUniform>("loss", |_| N_SLOTS),
    // The slots share the passes of the pair sort.
    uniform::<RadixUniform>("pair_passes", n_pair_passes),
    // Begin of each slice of the lists; none while lists are whole.
    uniform::<SliceUniform>("slice", n_slices),
    // To count, and to emit in one dispatch or two.
    uniform::<BinUniform>("mode", |_| 3),
    storage::<u32>("totals", Part::Uniforms, |_| N_TOTALS as usize),
    // A Gaussian's numbers lie side by side: a tile's splats lie anywhere, and each then takes one
    // cache line or two.
    storage::<Splat>("splats", Part::Splats, |c| c.stride),
    storage::<U2>("gaussian_pairs", Part::Splats, |c| c.stride),
    storage::<u32>("splat_pairs", Part::Splats, |c| {
        c.stride.next_multiple_of(4)
    }),
    storage::<u32>("block_sums", Part::Sorts, n_scan_blocks),
    // Both sorts end in the first of their two halves, or that of pairs in `Workspace::tile_pairs`.
    storage::<Entries>("depth_order", Part::Sorts, |c| c.stride.div_ceil(2)),
    storage::<Entries>("depth_order_swap", Part::Sorts, |c| c.stride.div_ceil(2)),
    storage::<u32>("digit_counts", Part::Sorts, n_digits),
    // Those of every other pass of the sort by depth, where each pass counts for the next.
    storage::<u32>("digit_counts_swap", Part::Sorts, |c| {
        let radix = c.rasterizer.radix();
        match radix.counts_moved {
            true => radix.counts(c.stride) + radix.digits() as usize,
            false => 0,
        }
    }),
    storage::<Entries>("pairs", Part::Pairs, |c| c.pairs.div_ceil(2)),
    storage::<Entries>("pairs_swap", Part::Sorts, |c| c.pairs.div_ceil(2)),
    storage::<u32>("pair_gaussian", Part::Pairs, |c| c.pairs),
    storage::<U2>("tile_ranges", Part::Image, |c| c.tiles),
    storage::<[u32; 4]>("tile_order", Part::Image, |c| c.tile_slots),
    // The image until the backward, which in slices keeps its own state here.
    storage::<F4>("rendered", Part::Image, |c| 4 * c.plane),
    // The rasterizer's last plane, for the backward, stands behind the four of the gradient, which only
    // training has.
    Described {
        more_to_train: |c| LAST_BLENDED as usize * c.plane,
        ..storage::<[u32; 4]>("d_rendered", Part::Loss, |c| c.plane)
    },
    Described {
        copies: |_| N_SLOTS,
        ..training::<[u32; 4]>("goal", Part::Goals, |c| c.plane)
    },
    training::<F4>("moments", Part::Loss, |c| planes_of_threads(c, 13)),
    training::<F4>("derivatives", Part::Loss, |c| planes_of_threads(c, 9)),
    training::<F2>("partials", Part::Loss, |c| most_partials(c.plane)),
    training::<F2>("block_partials", Part::Loss, |c| most_partials(c.plane)),
    // Per view of the step: mean L1, mean SSIM.
    training::<F2>("losses", Part::Loss, |_| N_SLOTS),
    training::<F4>("d_pair_a", Part::PairGradients, |c| c.pairs),
    training::<F4>("d_pair_b", Part::PairGradients, |c| c.pairs),
    training::<f32>("d_pair_c", Part::PairGradients, |c| c.pairs),
    training::<F4>("d_geometry", Part::Gradients, |c| 3 * c.stride),
    training::<F4>("d_color", Part::Gradients, |c| N_SLOTS * c.stride),
    training::<F2>("screen", Part::Gradients, |c| c.stride),
];

const fn uniform<T>(name: &'static str, copies: fn(&Capacity) -> usize) -> Described {
    Described {
        kind: BufferKind::uniform::<T>(name),
        part: Part::Uniforms,
        len: |_| 1,
        more_to_train: |_| 0,
        copies,
        trains: false,
        by_view: false,
    }
}

const fn of_view<T>(name: &'static str, copies: fn(&Capacity) -> usize) -> Described {
    Described {
        by_view: true,
        ..uniform::<T>(name, copies)
    }
}

const fn storage<T>(name: &'static str, part: Part, len: fn(&Capacity) -> usize) -> Described {
    Described {
        kind: BufferKind::storage::<T>(name),
        part,
        len,
        more_to_train: |_| 0,
        copies: |_| 1,
        trains: false,
        by_view: false,
    }
}

const fn training<T>(name: &'static str, part: Part, len: fn(&Capacity) -> usize) -> Described {
    Described {
        trains: true,
        ..storage::<T>(name, part, len)
    }
}

/// Bytes of a [`super::Workspace`] for training, by what its buffers are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorkspaceBytes {
    /// Projected Gaussians.
    pub splats: u64,
    /// (tile, pair) entries of one view, and the Gaussian of each pair.
    pub pairs: u64,
    /// Second halves of the sorts' buffers, and counts of digits.
    pub sorts: u64,
    /// The render, where each tile's pairs are, and the tiles' order.
    pub image: u64,
    /// Target images of the views of a step, RGBA8.
    pub goals: u64,
    /// L1 and SSIM, forward and backward.
    pub loss: u64,
    /// Every pair's gradient to its splat.
    pub pair_gradients: u64,
    /// Every Gaussian's gradient, and what densification gathers of it on screen.
    pub gradients: u64,
    /// Uniforms of all stages, and the counts in `totals`.
    pub uniforms: u64,
}

impl WorkspaceBytes {
    /// Returns the bytes that a workspace of this capacity will take for training.
    pub fn of(capacity: Capacity) -> WorkspaceBytes {
        let bytes = |part: Part| {
            let own = BUFFERS.iter().filter(|buffer| buffer.part == part);
            own.map(|buffer| buffer.bytes(&capacity)).sum()
        };
        WorkspaceBytes {
            splats: bytes(Part::Splats),
            pairs: bytes(Part::Pairs),
            sorts: bytes(Part::Sorts),
            image: bytes(Part::Image),
            goals: bytes(Part::Goals),
            loss: bytes(Part::Loss),
            pair_gradients: bytes(Part::PairGradients),
            gradients: bytes(Part::Gradients),
            uniforms: bytes(Part::Uniforms),
        }
    }

    /// Returns the bytes of all parts.
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

impl Described {
    /// Returns the entries of each buffer, and the number of buffers.
    pub(super) fn size(&self, capacity: &Capacity, training: bool) -> (usize, usize) {
        let len = (self.len)(capacity);
        match (training, self.trains) {
            (true, _) => (
                len.saturating_add((self.more_to_train)(capacity)),
                (self.copies)(capacity),
            ),
            (false, false) => (len, (self.copies)(capacity)),
            (false, true) => (len, 0),
        }
    }

    /// Returns the bytes of all copies in training.
    fn bytes(&self, capacity: &Capacity) -> u64 {
        let (len, copies) = self.size(capacity, true);
        copies as u64 * self.copy_bytes(len)
    }

    /// Returns the bytes of one copy, with those up to the next.
    fn copy_bytes(&self, len: usize) -> u64 {
        match self.kind.is_uniform() {
            true => self.kind.bytes(len).next_multiple_of(UNIFORM_ALIGNMENT),
            false => self.kind.bytes(len),
        }
    }
}

/// The places of all uniforms in one buffer: first those of each view of a step, view by view, then the
/// rest.
pub(super) struct Places {
    /// First byte of each copy of each of [`BUFFERS`]; none for storage buffers.
    pub(super) firsts: Vec<Vec<u64>>,
    /// Bytes of one view's.
    pub(super) of_view: u64,
    /// Bytes of all.
    pub(super) total: u64,
}

impl Places {
    pub(super) fn of(capacity: &Capacity) -> Places {
        let mut places = Places {
            firsts: vec![Vec::new(); BUFFERS.len()],
            of_view: 0,
            total: 0,
        };
        for slot in 0..N_SLOTS {
            places.append(capacity, true);
            places.of_view = places.total / (slot as u64 + 1);
        }
        places.append(capacity, false);
        places
    }

    /// Appends one view's uniforms, or those that belong to none.
    fn append(&mut self, capacity: &Capacity, by_view: bool) {
        let own = |d: &Described| d.kind.is_uniform() && d.by_view == by_view;
        for (described, firsts) in BUFFERS.iter().zip(&mut self.firsts) {
            let (len, copies) = described.size(capacity, true);
            let copies = if by_view { copies / N_SLOTS } else { copies };
            for _ in 0..if own(described) { copies } else { 0 } {
                firsts.push(self.total);
                self.total += described.copy_bytes(len);
            }
        }
    }
}

/// Returns the number of counts of the larger radix sort, with the sums of each digit's where they are scanned
/// digit by digit.
fn n_digits(capacity: &Capacity) -> usize {
    let most = capacity.stride.max(capacity.pairs);
    let radix = capacity.rasterizer.radix();
    match capacity.rasterizer {
        Rasterizer::Thread => radix.counts(most),
        Rasterizer::Workgroup => radix.counts(most) + radix.digits() as usize,
    }
}

/// Returns the number of blocks of the largest scan.
fn n_scan_blocks(capacity: &Capacity) -> usize {
    let most = match capacity.rasterizer {
        Rasterizer::Thread => capacity.stride.max(n_digits(capacity)),
        Rasterizer::Workgroup => capacity.stride,
    };
    most.div_ceil((SCAN_CHUNK * WORKGROUP) as usize)
}

/// Returns the number of slices of the lists; 0 if they are not sliced.
fn n_slices(capacity: &Capacity) -> usize {
    if capacity.slices > 1 {
        capacity.slices
    } else {
        0
    }
}

/// Returns the passes of the depth sort: an even number, so that the sorted splats end in the first
/// buffer.
pub(super) fn n_depth_passes(capacity: &Capacity) -> usize {
    let passes = capacity.rasterizer.radix().passes(DEPTH_BITS);
    passes.next_multiple_of(2) as usize
}

/// Returns the number of passes of the sort by tile.
fn n_pair_passes(capacity: &Capacity) -> usize {
    let bits = capacity.tiles.max(2).next_power_of_two().ilog2();
    capacity.rasterizer.radix().passes(bits) as usize
}

/// Returns the vectors of so many planes that hand the losses' moments on; workgroups have them in their own memory.
fn planes_of_threads(capacity: &Capacity, planes: usize) -> usize {
    match capacity.rasterizer {
        Rasterizer::Thread => planes * capacity.plane,
        Rasterizer::Workgroup => 0,
    }
}

/// Returns the most sums that the losses of a padded image of `plane` vectors, of whole tiles, leave: one a vector and `SSIM_ROWS`
/// rows or part of them, with workgroups fewer.
fn most_partials(plane: usize) -> usize {
    3 * plane / TILE_H as usize
}
