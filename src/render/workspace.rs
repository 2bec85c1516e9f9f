//! The buffers of one view in flight and the dispatches over them.

use super::model::Model;
use super::uniforms::{LossUniform, RadixUniform, ScanUniform, ViewUniform};
use crate::error::Result;
use crate::gpu::constants::{
    DEPTH_BITS, N_TOTALS, RADIX_BITS, RADIX_CHUNK, SCAN_CHUNK, SSIM_ROWS, TOTAL_DIGITS, TOTAL_MAX,
    TOTAL_OVERFLOW, TOTAL_PAIRS, WORKGROUP,
};
use crate::gpu::{Buffer, Commands, Gpu, Kernel};

/// Every kernel that renders, compares and differentiates a view.
pub struct Kernels {
    /// By active SH degree.
    project: [Kernel; 4],
    depth_keys: Kernel,
    radix_count: Kernel,
    radix_move: Kernel,
    bin: Kernel,
    scan_reduce: Kernel,
    scan_blocks: Kernel,
    scan_spread: Kernel,
    find_tile_ranges: Kernel,
    rasterize: Kernel,
    ssim: [Kernel; 4],
    loss_blocks: Kernel,
    loss_total: Kernel,
    rasterize_backward: Kernel,
    project_backward: [Kernel; 4],
}

impl Kernels {
    pub fn new(gpu: &Gpu) -> Kernels {
        let by_degree = |stage| [0, 1, 2, 3].map(|d| Kernel::for_degree(gpu, stage, stage, d));
        Kernels {
            project: by_degree("project"),
            depth_keys: Kernel::new(gpu, "depth_keys", "depth_keys"),
            radix_count: Kernel::new(gpu, "radix", "radix_count"),
            radix_move: Kernel::new(gpu, "radix", "radix_move"),
            bin: Kernel::new(gpu, "bin", "bin"),
            scan_reduce: Kernel::new(gpu, "scan", "scan_reduce"),
            scan_blocks: Kernel::new(gpu, "scan", "scan_blocks"),
            scan_spread: Kernel::new(gpu, "scan", "scan_spread"),
            find_tile_ranges: Kernel::new(gpu, "tile_ranges", "find_tile_ranges"),
            rasterize: Kernel::new(gpu, "rasterize", "rasterize"),
            ssim: [
                Kernel::new(gpu, "ssim", "ssim_horizontal"),
                Kernel::new(gpu, "ssim", "ssim_vertical"),
                Kernel::new(gpu, "ssim", "ssim_horizontal_backward"),
                Kernel::new(gpu, "ssim", "ssim_vertical_backward"),
            ],
            loss_blocks: Kernel::new(gpu, "loss_sum", "loss_blocks"),
            loss_total: Kernel::new(gpu, "loss_sum", "loss_total"),
            rasterize_backward: Kernel::new(gpu, "rasterize_backward", "rasterize_backward"),
            project_backward: by_degree("project_backward"),
        }
    }
}

/// What a workspace has room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    /// Gaussians.
    pub stride: usize,
    /// (tile, Gaussian) pairs of one view.
    pub pairs: usize,
    pub tiles: usize,
    /// Pixels of one image, unpadded, and `vec4f`s of one padded plane.
    pub pixels: usize,
    pub plane: usize,
}

impl Capacity {
    /// Room for images of every view in `views`.
    pub fn new(stride: usize, pairs: usize, views: &[ViewUniform]) -> Capacity {
        let largest = |size: fn(&ViewUniform) -> usize| views.iter().map(size).max().unwrap_or(1);
        Capacity {
            stride,
            pairs,
            tiles: largest(ViewUniform::n_tiles),
            pixels: largest(ViewUniform::n_pixels),
            plane: largest(ViewUniform::plane_len),
        }
    }

    /// The larger of both in every respect.
    pub fn union(&self, other: &Capacity) -> Capacity {
        Capacity {
            stride: self.stride.max(other.stride),
            pairs: self.pairs.max(other.pairs),
            tiles: self.tiles.max(other.tiles),
            pixels: self.pixels.max(other.pixels),
            plane: self.plane.max(other.plane),
        }
    }

    /// Whether `other` fits.
    pub fn holds(&self, other: &Capacity) -> bool {
        self.union(other) == *self
    }
}

/// The buffers of one view in flight, shared by a step's views, one after the other.
pub struct Workspace {
    pub capacity: Capacity,
    slots: [Slot; 2],
    count: Buffer,
    emit: Buffer,
    pub totals: Buffer,
    pub splats: Buffer,
    pub splat_pairs: Buffer,
    block_sums: Buffer,
    /// `Radix` of the depth sort's passes, per slot, and of the pair sort's.
    pair_passes: Vec<Buffer>,
    /// (key, Gaussian); the sort ends in the first.
    pub depth_order: [Buffer; 2],
    /// (tile, pair); the sort ends in [`Workspace::tile_pairs`].
    pairs: [Buffer; 2],
    digit_counts: Buffer,
    pub tile_ranges: Buffer,
    pub pair_gaussian: Buffer,
    pub rendered: Buffer,
    last_blended: Buffer,
    pub backward: Option<Backward>,
}

/// Uniforms of one of the step's views.
struct Slot {
    view: Buffer,
    loss: Buffer,
    scan_pairs: Buffer,
    scan_splat_digits: Buffer,
    scan_pair_digits: Buffer,
    depth_passes: Vec<Buffer>,
}

/// What only training needs.
pub struct Backward {
    goal: [Buffer; 2],
    moments: Buffer,
    derivatives: Buffer,
    pub d_rendered: Buffer,
    partials: Buffer,
    block_partials: Buffer,
    /// Per view of the step: mean L1, mean SSIM.
    pub losses: Buffer,
    d_pair_a: Buffer,
    d_pair_b: Buffer,
    d_pair_c: Buffer,
    pub d_geometry: Buffer,
    pub d_color: Buffer,
    pub screen: Buffer,
}

impl Workspace {
    /// Allocates; with `training`, for the backward too.
    ///
    /// # Errors
    /// A buffer that the adapter cannot bind.
    pub fn new(gpu: &Gpu, capacity: Capacity, training: bool) -> Result<Workspace> {
        let Capacity {
            stride,
            pairs,
            tiles,
            plane,
            ..
        } = capacity;
        let n_digits = n_chunks(stride.max(pairs)) << RADIX_BITS;
        let n_blocks = stride
            .max(n_digits)
            .div_ceil((SCAN_CHUNK * WORKGROUP) as usize);
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
            count: Buffer::uniform_from(gpu, "count", &[0_u32; 4]),
            emit: Buffer::uniform_from(gpu, "emit", &[1_u32, 0, 0, 0]),
            totals: Buffer::storage::<u32>(gpu, "totals", N_TOTALS as usize)?,
            splats: Buffer::storage::<[f32; 4]>(gpu, "splats", 3 * stride)?,
            splat_pairs: Buffer::storage::<u32>(gpu, "splat_pairs", stride)?,
            block_sums: Buffer::storage::<u32>(gpu, "block_sums", n_blocks)?,
            pair_passes: (0..n_pair_passes(tiles))
                .map(|i| {
                    let shift = i * RADIX_BITS;
                    let pass = RadixUniform {
                        n: pairs as u32,
                        pairs: 1,
                        shift,
                        pad: 0,
                    };
                    Buffer::uniform_from(gpu, "pair pass", &pass)
                })
                .collect(),
            depth_order: [
                Buffer::storage::<[u32; 2]>(gpu, "depth_order", stride)?,
                Buffer::storage::<[u32; 2]>(gpu, "depth_order", stride)?,
            ],
            digit_counts: Buffer::storage::<u32>(gpu, "digit_counts", n_digits)?,
            pairs: [
                Buffer::storage::<[u32; 2]>(gpu, "pairs", pairs)?,
                Buffer::storage::<[u32; 2]>(gpu, "pairs", pairs)?,
            ],
            tile_ranges: Buffer::storage::<[u32; 2]>(gpu, "tile_ranges", tiles)?,
            pair_gaussian: Buffer::storage::<u32>(gpu, "pair_gaussian", pairs)?,
            rendered: Buffer::storage::<[f32; 4]>(gpu, "rendered", 4 * plane)?,
            last_blended: Buffer::storage::<[u32; 4]>(gpu, "last_blended", plane)?,
            backward,
        })
    }

    /// Sets what a slot's render is compared with, RGBA8.
    pub fn set_goal(&self, gpu: &Gpu, slot: usize, goal: &[u32]) {
        if let Some(backward) = &self.backward {
            backward.goal[slot].write(gpu, goal);
        }
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

    /// Every buffer under its name in the shaders, with those of `model`.
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
            ("tile_ranges", &self.tile_ranges),
            ("pairs", &self.pairs[0]),
            ("block_sums", &self.block_sums),
            ("depth_order", &self.depth_order[0]),
            ("digit_counts", &self.digit_counts),
            ("tile_pairs", self.tile_pairs()),
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
            pixels,
            plane,
            ..
        } = capacity;
        let n_partials = n_partials(plane);
        Ok(Backward {
            goal: [
                Buffer::storage::<u32>(gpu, "goal 0", pixels)?,
                Buffer::storage::<u32>(gpu, "goal 1", pixels)?,
            ],
            moments: Buffer::storage::<[f32; 4]>(gpu, "moments", 16 * plane)?,
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

/// Passes of the depth sort.
const N_DEPTH_PASSES: u32 = DEPTH_BITS.div_ceil(RADIX_BITS);
const _: () = assert!(
    N_DEPTH_PASSES.is_multiple_of(2),
    "the sorted splats end in the first buffer"
);

/// Passes of the sort by tile.
fn n_pair_passes(n_tiles: usize) -> u32 {
    let bits = n_tiles.max(2).next_power_of_two().ilog2();
    bits.div_ceil(RADIX_BITS)
}

/// Chunks of a radix sort.
fn n_chunks(n: usize) -> usize {
    n.div_ceil(RADIX_CHUNK as usize)
}

/// Threads of SSIM's vertical passes over a padded image of `plane` vectors.
fn n_partials(plane: usize) -> usize {
    3 * plane / SSIM_ROWS as usize
}

/// Bind groups of a workspace and a model, for both slots.
pub struct Bound {
    slots: [Groups; 2],
}

struct Groups {
    /// By active SH degree.
    project: [wgpu::BindGroup; 4],
    depth_keys: wgpu::BindGroup,
    depth_passes: Vec<RadixGroups>,
    pair_passes: Vec<RadixGroups>,
    bin_count: wgpu::BindGroup,
    bin_emit: wgpu::BindGroup,
    scan_pairs: [wgpu::BindGroup; 3],
    find_tile_ranges: wgpu::BindGroup,
    rasterize: wgpu::BindGroup,
    backward: Option<BackwardGroups>,
}

struct RadixGroups {
    count: wgpu::BindGroup,
    scan: [wgpu::BindGroup; 3],
    shift: wgpu::BindGroup,
}

struct BackwardGroups {
    ssim: [wgpu::BindGroup; 4],
    loss_sum: [wgpu::BindGroup; 2],
    rasterize: wgpu::BindGroup,
    project: [wgpu::BindGroup; 4],
}

impl Bound {
    pub fn new(gpu: &Gpu, kernels: &Kernels, workspace: &Workspace, model: &Model) -> Bound {
        Bound {
            slots: [0, 1].map(|slot| Groups::new(gpu, kernels, workspace, model, slot)),
        }
    }
}

impl Groups {
    fn new(gpu: &Gpu, kernels: &Kernels, space: &Workspace, model: &Model, slot: usize) -> Groups {
        let names = space.names(model, slot);
        let with = |extra: &[(&'static str, &'_ Buffer)], kernel: &Kernel| {
            let mut all: Vec<(&str, &Buffer)> = extra.to_vec();
            all.extend(names.iter().copied());
            kernel.bind(gpu, &all)
        };
        let scan = |uniform: &Buffer, counts: &Buffer| {
            [
                &kernels.scan_reduce,
                &kernels.scan_blocks,
                &kernels.scan_spread,
            ]
            .map(|kernel| with(&[("scan", uniform), ("counts", counts)], kernel))
        };
        let radix = |passes: &[Buffer], entries: &[Buffer; 2], uniform: &Buffer| {
            let pass = |(i, pass): (usize, &Buffer)| {
                let from_to = [
                    ("radix", pass),
                    ("entries_in", &entries[i % 2]),
                    ("entries_out", &entries[1 - i % 2]),
                ];
                RadixGroups {
                    count: with(&from_to, &kernels.radix_count),
                    scan: scan(uniform, &space.digit_counts),
                    shift: with(&from_to, &kernels.radix_move),
                }
            };
            passes.iter().enumerate().map(pass).collect()
        };
        let uniforms = &space.slots[slot];
        Groups {
            project: kernels.project.each_ref().map(|k| with(&[], k)),
            depth_keys: with(&[], &kernels.depth_keys),
            depth_passes: radix(&uniforms.depth_passes, &space.depth_order, {
                &uniforms.scan_splat_digits
            }),
            pair_passes: radix(&space.pair_passes, &space.pairs, &uniforms.scan_pair_digits),
            bin_count: with(&[("mode", &space.count)], &kernels.bin),
            bin_emit: with(&[("mode", &space.emit)], &kernels.bin),
            scan_pairs: scan(&space.slots[slot].scan_pairs, &space.splat_pairs),
            find_tile_ranges: with(&[], &kernels.find_tile_ranges),
            rasterize: with(&[], &kernels.rasterize),
            backward: space.backward.as_ref().map(|_| BackwardGroups {
                ssim: [0, 1, 2, 3].map(|i| with(&[], &kernels.ssim[i])),
                loss_sum: [&kernels.loss_blocks, &kernels.loss_total].map(|k| with(&[], k)),
                rasterize: with(&[], &kernels.rasterize_backward),
                project: kernels.project_backward.each_ref().map(|k| with(&[], k)),
            }),
        }
    }
}

/// One view being recorded: the kernels, buffers and bind groups that its stages need.
pub struct Pass<'a> {
    pub gpu: &'a Gpu,
    pub kernels: &'a Kernels,
    pub workspace: &'a Workspace,
    pub bound: &'a Bound,
    pub slot: usize,
    /// With counts and slot set by [`Pass::new`].
    view: ViewUniform,
    sh_degree: usize,
}

impl<'a> Pass<'a> {
    /// Writes the view's uniforms. `step` numbers the step for overflow reports, from 1.
    pub fn new(
        gpu: &'a Gpu,
        kernels: &'a Kernels,
        workspace: &'a Workspace,
        bound: &'a Bound,
        model: &Model,
        (slot, mut view): (usize, ViewUniform),
        (sh_degree, step): (u32, u32),
    ) -> Pass<'a> {
        let capacity = workspace.capacity;
        let (n, pairs) = (model.n as u32, capacity.pairs as u32);
        view.counts = [n, model.stride as u32, 0, pairs];
        view.planes[2] = slot as u32;
        let uniforms = &workspace.slots[slot];
        uniforms.view.write(gpu, &[view]);
        let scan = |n, total, capacity| ScanUniform {
            n,
            total,
            capacity,
            step,
        };
        uniforms
            .scan_pairs
            .write(gpu, &[scan(n, TOTAL_PAIRS, pairs)]);
        let n_digits = (n_chunks(model.n) << RADIX_BITS) as u32;
        let digits = |n| scan(n, TOTAL_DIGITS, 0);
        uniforms.scan_splat_digits.write(gpu, &[digits(n_digits)]);
        uniforms.scan_pair_digits.write(gpu, &[digits(0)]);
        for (i, pass) in uniforms.depth_passes.iter().enumerate() {
            let shift = i as u32 * RADIX_BITS;
            pass.write(
                gpu,
                &[RadixUniform {
                    n,
                    pairs: 0,
                    shift,
                    pad: 0,
                }],
            );
        }
        Pass {
            gpu,
            kernels,
            workspace,
            bound,
            slot,
            view,
            sh_degree: sh_degree as usize,
        }
    }

    /// Renders into `workspace.rendered`.
    pub fn forward(&self, commands: &mut Commands<'_>) {
        let Pass {
            kernels,
            workspace,
            view,
            ..
        } = self;
        let groups = &self.bound.slots[self.slot];
        let n = u64::from(view.counts[0]);
        let n_tiles = view.n_tiles() as u64;
        let degree = self.sh_degree;
        let room = workspace.capacity.pairs as u64;
        commands.dispatch(&kernels.project[degree], &groups.project[degree], n);
        commands.dispatch(&kernels.depth_keys, &groups.depth_keys, n);
        self.sort(commands, &groups.depth_passes, n);
        commands.dispatch(&kernels.bin, &groups.bin_count, n);
        self.scan(commands, &groups.scan_pairs, n);
        commands.dispatch(&kernels.bin, &groups.bin_emit, n);
        self.sort(commands, &groups.pair_passes, room);
        commands.clear(&workspace.tile_ranges);
        commands.dispatch(&kernels.find_tile_ranges, &groups.find_tile_ranges, room);
        commands.dispatch(&kernels.rasterize, &groups.rasterize, n_tiles);
    }

    /// Radix sort of at most `n` entries.
    fn sort(&self, commands: &mut Commands<'_>, passes: &[RadixGroups], n: u64) {
        let n_chunks = n_chunks(n as usize) as u64;
        for groups in passes {
            commands.dispatch(&self.kernels.radix_count, &groups.count, n_chunks);
            self.scan(commands, &groups.scan, n_chunks << RADIX_BITS);
            commands.dispatch(&self.kernels.radix_move, &groups.shift, n_chunks);
        }
    }

    /// Exclusive prefix sum of `n` counts.
    fn scan(&self, commands: &mut Commands<'_>, groups: &[wgpu::BindGroup; 3], n: u64) {
        let threads = n.div_ceil(u64::from(SCAN_CHUNK));
        commands.dispatch(&self.kernels.scan_reduce, &groups[0], threads);
        commands.dispatch(&self.kernels.scan_blocks, &groups[1], 1);
        commands.dispatch(&self.kernels.scan_spread, &groups[2], threads);
    }

    /// The image loss of `workspace.rendered` against `goal`, and its gradient in `d_rendered`.
    pub fn loss(&self, commands: &mut Commands<'_>, mut loss: LossUniform) {
        let Some(groups) = &self.bound.slots[self.slot].backward else {
            return;
        };
        let kernels = self.kernels;
        let (width_4, _) = self.view.padded_size();
        let rows = u64::from(self.view.size[1]) * width_4 as u64;
        let strips = n_partials(self.view.plane_len());
        loss.n_partials = strips as u32;
        loss.slot = self.slot as u32;
        self.workspace.slots[self.slot]
            .loss
            .write(self.gpu, &[loss]);
        for (i, n) in [rows, strips as u64, rows, strips as u64]
            .into_iter()
            .enumerate()
        {
            commands.dispatch(&kernels.ssim[i], &groups.ssim[i], n);
        }
        let threads = (strips as u64).div_ceil(u64::from(SCAN_CHUNK));
        commands.dispatch(&kernels.loss_blocks, &groups.loss_sum[0], threads);
        commands.dispatch(&kernels.loss_total, &groups.loss_sum[1], 1);
    }

    /// Carries `d_rendered` back to `d_geometry` and `d_color`.
    pub fn backward(&self, commands: &mut Commands<'_>) {
        let Some(groups) = &self.bound.slots[self.slot].backward else {
            return;
        };
        let n_tiles = self.view.n_tiles() as u64;
        let n = u64::from(self.view.counts[0]);
        commands.dispatch(&self.kernels.rasterize_backward, &groups.rasterize, n_tiles);
        let degree = self.sh_degree;
        commands.dispatch(
            &self.kernels.project_backward[degree],
            &groups.project[degree],
            n,
        );
    }
}

/// Reads the counts that the GPU keeps.
pub fn read_totals(gpu: &Gpu, workspace: &Workspace) -> Result<Totals> {
    let totals: Vec<u32> = workspace.totals.read(gpu, N_TOTALS as usize)?;
    Ok(Totals {
        pairs: totals[TOTAL_PAIRS as usize] as usize,
        max: totals[TOTAL_MAX as usize] as usize,
        overflow_step: totals[TOTAL_OVERFLOW as usize],
    })
}

/// Counts of (tile, Gaussian) pairs.
#[derive(Clone, Copy, Debug)]
pub struct Totals {
    /// Pairs of the last view.
    pub pairs: usize,
    /// Most pairs of any view since the workspace was made.
    pub max: usize,
    /// Number of the first step whose pairs did not fit; 0: none.
    pub overflow_step: u32,
}
