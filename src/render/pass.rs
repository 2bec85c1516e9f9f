//! The dispatches of one view: forward, loss, backward.

use super::buffers::{LAST_BLENDED, n_depth_passes};
use super::kernels::{Bound, DigitScan, Groups, Kernels, RadixGroups, RasterGroups, ScanGroups};
use super::model::Model;
use super::pose::{PoseGradient, PoseKernels};
use super::uniforms::{LossUniform, RadixUniform, ScanUniform, ViewUniform};
use super::workspace::Workspace;
use crate::gpu::constants::{
    EMIT_CHUNK, LOSS_GROUP, LOSS_ROWS, LOSS_STRIP, PAIR_BLOCK, RANGE_CHUNK, SCAN_CHUNK,
    SSIM_ACROSS, SSIM_ROWS, TOTAL_DIGITS, TOTAL_PAIRS, WORKGROUP,
};
use crate::gpu::{Commands, Gpu, Rasterizer, shader_count};

/// One view being recorded: the kernels, buffers and bind groups that its stages need.
pub struct Pass<'a> {
    /// Adapter that holds the buffers.
    pub gpu: &'a Gpu,
    /// Kernels of all stages of a view.
    pub kernels: &'a Kernels,
    /// Buffers that the stages read and write.
    pub workspace: &'a Workspace,
    /// Bind groups of `workspace` and the model.
    pub bound: &'a Bound,
    /// The view's number among those of its step.
    pub slot: usize,
    /// The view's uniform, with counts and slot set by [`Pass::new`].
    pub(super) view: ViewUniform,
    sh_degree: usize,
}

/// A view's place in its step.
#[derive(Clone, Copy, Debug, Default)]
pub struct PassStep {
    /// Number of the view among those of the step.
    pub slot: usize,
    /// The active degree.
    pub sh_degree: u32,
    /// Number of the step for reports of overflow, from 1.
    pub number: u32,
}

impl<'a> Pass<'a> {
    /// Writes the view's uniforms, and returns its stages, to be recorded.
    pub fn new(
        gpu: &'a Gpu,
        kernels: &'a Kernels,
        workspace: &'a Workspace,
        bound: &'a Bound,
        model: &Model,
        mut view: ViewUniform,
        step: PassStep,
    ) -> Pass<'a> {
        let PassStep {
            slot,
            sh_degree,
            number,
        } = step;
        let capacity = workspace.capacity;
        let (n, pairs) = (shader_count(model.n), shader_count(capacity.pairs));
        view.n_gaussians = n;
        view.stride = shader_count(model.stride);
        view.slot = slot as u32;
        view.tiles = kernels.rasterizer.tiles(view.size);
        view.longest_list = shader_count(capacity.longest_list());
        view.blended_plane = if workspace.trains { LAST_BLENDED } else { 0 };
        let mut uniforms = workspace.view_block(slot);
        uniforms.put("view", &[view]);
        let scan = |n, total, capacity| ScanUniform {
            n,
            total,
            capacity,
            step: number,
        };
        uniforms.put("scan_pairs", &[scan(n, TOTAL_PAIRS, pairs)]);
        let radix = kernels.rasterizer.radix();
        let n_digits = shader_count(radix.counts(model.n));
        let digits = |n| scan(n, TOTAL_DIGITS, 0);
        uniforms.put("scan_splat_digits", &[digits(n_digits)]);
        uniforms.put("scan_pair_digits", &[digits(0)]);
        let n_passes = n_depth_passes(&capacity) as u32;
        let pass = |i: u32| RadixUniform {
            n,
            pairs: 0,
            shift: i * radix.bits,
            counts_next: u32::from(radix.counts_moved && i + 1 < n_passes),
        };
        let passes: Vec<RadixUniform> = (0..n_passes).map(pass).collect();
        uniforms.put("depth_passes", &passes);
        uniforms.write(gpu);
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

    /// Renders into the buffer `rendered`: the stages from [`Pass::project`] on in a row.
    pub fn forward(&self, commands: &mut Commands<'_>) {
        self.project(commands);
        self.sort_by_depth(commands);
        self.count_pairs(commands);
        self.scan_pairs(commands);
        self.emit_pairs(commands);
        self.sort_by_tile(commands);
        self.find_tile_ranges(commands);
        self.order_tiles(commands);
        self.rasterize(commands);
    }

    /// Fills `splats` and, unsorted, `depth_order`.
    pub fn project(&self, commands: &mut Commands<'_>) {
        let (kernels, degree) = (&self.kernels.project, self.sh_degree);
        commands.dispatch(&kernels[degree], &self.groups().project[degree], self.n());
    }

    /// Sorts `depth_order`.
    pub fn sort_by_depth(&self, commands: &mut Commands<'_>) {
        self.sort(commands, &self.groups().depth_passes, self.n());
    }

    /// Fills `splat_pairs` with numbers of pairs.
    pub fn count_pairs(&self, commands: &mut Commands<'_>) {
        commands.dispatch(&self.kernels.bin, &self.groups().bin_count, self.n());
    }

    /// Turns `splat_pairs` into first pairs; sets the totals.
    pub fn scan_pairs(&self, commands: &mut Commands<'_>) {
        self.scan(commands, &self.groups().scan_pairs, self.n());
    }

    /// Fills `pairs`, `pair_gaussian` and `gaussian_pairs`; workgroups leave what [`Pass::sort_by_tile`]
    /// counts first in `digit_counts`.
    pub fn emit_pairs(&self, commands: &mut Commands<'_>) {
        let chunks = self.room().div_ceil(u64::from(EMIT_CHUNK));
        let (kernel, n) = (&self.kernels.bin, self.n());
        match self.groups().bin_emit.as_slice() {
            [first, rest] => {
                commands.dispatch(kernel, first, n);
                commands.dispatch(kernel, rest, chunks);
            }
            groups => groups
                .iter()
                .for_each(|group| commands.dispatch(kernel, group, chunks.max(n))),
        }
    }

    /// Sorts `pairs` into `tile_pairs`, once after [`Pass::emit_pairs`].
    pub fn sort_by_tile(&self, commands: &mut Commands<'_>) {
        self.sort(commands, &self.groups().pair_passes, self.room());
    }

    /// Fills `tile_ranges` of the tiles that have pairs, and `tile_splats`.
    pub fn find_tile_ranges(&self, commands: &mut Commands<'_>) {
        let (kernel, group) = (
            &self.kernels.find_tile_ranges,
            &self.groups().find_tile_ranges,
        );
        let threads = self.room().div_ceil(u64::from(RANGE_CHUNK));
        commands.dispatch(kernel, group, threads);
    }

    /// Fills `tile_order`, and `tile_ranges` of the tiles without pairs; a list too long for the slices there are is an overflow.
    pub fn order_tiles(&self, commands: &mut Commands<'_>) {
        let (kernel, group) = (&self.kernels.order_tiles, &self.groups().order_tiles);
        let n_slots = self.kernels.rasterizer.n_slots(self.view.size);
        commands.dispatch(kernel, group, n_slots as u64);
    }

    /// Fills `rendered`.
    pub fn rasterize(&self, commands: &mut Commands<'_>) {
        let threads = self.kernels.rasterizer.n_threads(self.view.size);
        let [whole, slice] = &self.kernels.rasterize;
        match &self.groups().rasterize {
            RasterGroups::Whole(group) => commands.dispatch(whole, group, threads),
            RasterGroups::Slices(groups) => groups
                .iter()
                .for_each(|group| commands.dispatch(slice, group, threads)),
        }
    }

    fn groups(&self) -> &Groups {
        &self.bound.slots[self.slot]
    }

    /// Returns the number of Gaussians.
    pub(super) fn n(&self) -> u64 {
        u64::from(self.view.n_gaussians)
    }

    /// Returns the number of pairs that there is room for.
    pub(super) fn room(&self) -> u64 {
        self.workspace.capacity.pairs as u64
    }

    /// Sorts at most `n` entries by radix.
    fn sort(&self, commands: &mut Commands<'_>, passes: &[RadixGroups], n: u64) {
        let radix = self.kernels.rasterizer.radix();
        let threads = radix.chunks(n as usize) as u64 * u64::from(radix.threads);
        for groups in passes {
            if let Some(count) = &groups.count {
                commands.dispatch(&self.kernels.radix_count, count, threads);
            }
            match &groups.scan {
                DigitScan::Counts(groups) => {
                    self.scan(commands, groups, radix.counts(n as usize) as u64);
                }
                DigitScan::Digits(kernel, group) => {
                    let threads = u64::from(radix.digits() * WORKGROUP);
                    commands.dispatch(kernel, group, threads);
                }
            }
            commands.dispatch(&self.kernels.radix_move, &groups.shift, threads);
        }
    }

    /// Turns at most `n` counts into their exclusive prefix sums.
    fn scan(&self, commands: &mut Commands<'_>, groups: &ScanGroups, n: u64) {
        match groups {
            ScanGroups::Few(group) => commands.dispatch(&self.kernels.scan_few, group, 1),
            ScanGroups::Many([reduce, spread]) => {
                let threads = n.div_ceil(u64::from(SCAN_CHUNK));
                commands.dispatch(&self.kernels.scan_reduce, reduce, threads);
                commands.dispatch(&self.kernels.scan_spread, spread, threads);
            }
        }
    }

    /// Compares the buffer `rendered` with the target image of the slot: writes its mean L1 and
    /// SSIM to `losses`, and the gradient of the image loss to `d_rendered`. Nothing is recorded
    /// with a workspace that does not train.
    pub fn loss(&self, commands: &mut Commands<'_>, loss: LossUniform) {
        self.loss_gradient(commands, loss);
        self.sum_losses(commands);
    }

    /// Does the same but for the means, of which the parts are left in `partials`.
    pub fn loss_gradient(&self, commands: &mut Commands<'_>, mut loss: LossUniform) {
        let Some(groups) = &self.groups().backward else {
            return;
        };
        let kernels = self.kernels;
        let (threads, n_partials) = self.loss_threads();
        loss.n_partials = shader_count(n_partials);
        loss.slot = self.slot as u32;
        let uniform = self.workspace.of_slot("loss", self.slot);
        uniform.write(self.gpu, &[loss]);
        let kind = usize::from(loss.masked != 0);
        let bound = kernels.ssim[kind].iter().zip(&groups.ssim[kind]);
        for ((kernel, group), threads) in bound.zip(threads) {
            commands.dispatch(kernel, group, threads);
        }
    }

    /// Writes the means that [`Pass::loss_gradient`] has left parts of to `losses`.
    pub fn sum_losses(&self, commands: &mut Commands<'_>) {
        let Some(groups) = &self.groups().backward else {
            return;
        };
        let kernels = self.kernels;
        let (_, n_partials) = self.loss_threads();
        let threads = (n_partials as u64).div_ceil(u64::from(SCAN_CHUNK));
        commands.dispatch(&kernels.loss_blocks, &groups.loss_sum[0], threads);
        commands.dispatch(&kernels.loss_total, &groups.loss_sum[1], 1);
    }

    /// Returns the threads of each kernel of the loss, and the partial sums that they leave.
    fn loss_threads(&self) -> (Vec<u64>, usize) {
        let (width_4, rows) = self.view.padded_size();
        match self.kernels.rasterizer {
            Rasterizer::Thread => {
                let across = 3 * rows * width_4.div_ceil(SSIM_ACROSS as usize);
                let down = 3 * width_4 * rows.div_ceil(SSIM_ROWS as usize);
                ([across, down, across, down].map(|n| n as u64).into(), down)
            }
            Rasterizer::Workgroup => {
                let strips = (4 * width_4).div_ceil(LOSS_STRIP as usize);
                let groups = 3 * strips * rows.div_ceil(LOSS_ROWS as usize);
                (vec![u64::from(LOSS_GROUP) * groups as u64], groups)
            }
        }
    }

    /// Carries `d_rendered` back to `d_geometry` and `d_color`.
    pub fn backward(&self, commands: &mut Commands<'_>) {
        self.rasterize_backward(commands);
        self.sum_pairs(commands);
        self.project_backward(commands);
    }

    /// Carries `d_rendered` back to the pairs.
    pub fn rasterize_backward(&self, commands: &mut Commands<'_>) {
        let Some(groups) = &self.groups().backward else {
            return;
        };
        let threads = self.kernels.rasterizer.n_threads(self.view.size);
        let [whole, slice] = &self.kernels.rasterize_backward;
        match &groups.rasterize {
            RasterGroups::Whole(group) => commands.dispatch(whole, group, threads),
            // The slice farthest behind comes first.
            RasterGroups::Slices(groups) => groups
                .iter()
                .rev()
                .for_each(|group| commands.dispatch(slice, group, threads)),
        }
    }

    /// Sums the pairs' gradients where whole blocks are one Gaussian's, and then each Gaussian's, which
    /// replace `splats`.
    pub fn sum_pairs(&self, commands: &mut Commands<'_>) {
        let Some(groups) = &self.groups().backward else {
            return;
        };
        let n = self.room() / u64::from(PAIR_BLOCK);
        commands.dispatch(&self.kernels.sum_pairs, &groups.sum_pairs, n);
        let (kernel, group) = (&self.kernels.sum_gaussians, &groups.sum_gaussians);
        commands.dispatch(kernel, group, self.n());
    }

    /// Carries the splats' gradients back to `d_geometry` and `d_color`.
    pub fn project_backward(&self, commands: &mut Commands<'_>) {
        let Some(groups) = &self.groups().backward else {
            return;
        };
        let (kernels, degree) = (&self.kernels.project_backward, self.sh_degree);
        commands.dispatch(&kernels[degree], &groups.project[degree], self.n());
    }

    /// Records the gradient with respect to the camera's pose, after [`Pass::backward`] of the
    /// step's first view and before that of its second.
    pub fn pose_backward(
        &self,
        commands: &mut Commands<'_>,
        kernels: &PoseKernels,
        pose: &PoseGradient,
    ) {
        pose.record(commands, kernels, self.sh_degree, self.n());
    }
}
