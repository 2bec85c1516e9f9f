//! The dispatches of one view: forward, loss, backward.

use super::kernels::{Bound, Kernels, RadixGroups};
use super::model::Model;
use super::uniforms::{LossUniform, RadixUniform, ScanUniform, ViewUniform};
use super::workspace::{Workspace, n_chunks, n_partials};
use crate::gpu::constants::{RADIX_BITS, SCAN_CHUNK, TOTAL_DIGITS, TOTAL_PAIRS};
use crate::gpu::{Commands, Gpu};

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
        view.counts[0] = n;
        view.counts[1] = model.stride as u32;
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
