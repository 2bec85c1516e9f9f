//! The dispatches of depths and normals: forward behind the colours', backward between those of the
//! colours.

use super::depth::{DepthKernels, DepthLossKind, DepthPass};
use super::kernels::RasterGroups;
use super::pass::Pass;
use crate::gpu::constants::PAIR_BLOCK;
use crate::gpu::{Commands, Kernel};

impl Pass<'_> {
    /// Fills `splat_depths`.
    pub fn project_depth(
        &self,
        commands: &mut Commands<'_>,
        kernels: &DepthKernels,
        depth: &DepthPass,
    ) {
        commands.dispatch(&kernels.project, &depth.groups.project, self.n());
    }

    /// Fills `depths`, after [`Pass::forward`].
    pub fn rasterize_depth(
        &self,
        commands: &mut Commands<'_>,
        kernels: &DepthKernels,
        depth: &DepthPass,
    ) {
        let groups = &depth.groups.rasterize;
        self.by_lists(commands, &kernels.rasterize, groups, false);
    }

    /// Puts the gradient of a loss of this kind in place of the depths and normals, and its parts into
    /// `depth_losses`.
    pub fn depth_loss(
        &self,
        commands: &mut Commands<'_>,
        kernels: &DepthKernels,
        depth: &DepthPass,
        kind: DepthLossKind,
    ) {
        let records = depth.records(&self.view);
        let threads = [
            records.rows,
            records.patches,
            1,
            records.rows,
            1,
            self.view.plane_len(),
        ];
        let errors = 3..5;
        for (i, threads) in threads.into_iter().enumerate() {
            if kind != DepthLossKind::Pearson || !errors.contains(&i) {
                let (kernel, group) = (&kernels.loss[i], &depth.groups.loss[i]);
                commands.dispatch(kernel, group, threads as u64);
            }
        }
    }

    /// Carries the gradient back to the pairs, after [`Pass::rasterize_backward`] and before
    /// [`Pass::sum_pairs`].
    pub fn rasterize_depth_backward(
        &self,
        commands: &mut Commands<'_>,
        kernels: &DepthKernels,
        depth: &DepthPass,
    ) {
        let groups = &depth.groups.rasterize_backward;
        self.by_lists(commands, &kernels.rasterize_backward, groups, true);
    }

    /// Carries the gradient of depths and normals back to `d_geometry`, after
    /// [`Pass::project_backward`].
    pub fn project_depth_backward(
        &self,
        commands: &mut Commands<'_>,
        kernels: &DepthKernels,
        depth: &DepthPass,
    ) {
        let groups = &depth.groups;
        let mut n = self.room();
        for (kernel, group) in kernels.sum_pairs.iter().zip(&groups.sum_pairs) {
            n /= u64::from(PAIR_BLOCK);
            commands.dispatch(kernel, group, n);
        }
        commands.dispatch(
            &kernels.project_backward,
            &groups.project_backward,
            self.n(),
        );
    }

    /// Dispatches a rasterizer over whole lists, or over slices of them, in reverse if it goes `back`.
    fn by_lists(
        &self,
        commands: &mut Commands<'_>,
        [whole, slice]: &[Kernel; 2],
        groups: &RasterGroups,
        back: bool,
    ) {
        let threads = self.kernels.rasterizer.n_threads(self.view.size);
        match groups {
            RasterGroups::Whole(group) => commands.dispatch(whole, group, threads),
            RasterGroups::Slices(groups) => {
                for i in 0..groups.len() {
                    let i = if back { groups.len() - 1 - i } else { i };
                    commands.dispatch(slice, &groups[i], threads);
                }
            }
        }
    }
}
