//! Depths and normals of a view, rendered with gradients, and what they are compared with.
//!
//! A second pass over the lists that the colours were composited from. With the weights `w` of the
//! compositing, a pixel has the sums of `w z` over the depths `z` of the means along the camera's axis and
//! of `w n` over the normals `n`, the depth of the Gaussian that takes the transmittance to a half (the
//! median), and that of the Gaussian with the largest weight (the mode). A normal is a Gaussian's flattest
//! axis, on the camera's side, in the camera's axes. Sums pass their gradient on to weights, depths
//! and normals; median and mode to their one Gaussian's depth.
//!
//! All buffers are its own: a run without them has none.

use bytemuck::{Pod, Zeroable};

use super::kernels::RasterGroups;
use super::model::Model;
use super::uniforms::ViewUniform;
use super::workspace::Workspace;
use crate::error::Result;
use crate::gpu::shader::{self, Sources};
use crate::gpu::{Buffer, BufferKind, Gpu, Kernel, Rasterizer, Stage};

/// The kernels of depths and normals, which only a loss of them needs.
pub struct DepthKernels {
    pub(super) project: Kernel,
    /// Whole lists, and slices of them.
    pub(super) rasterize: [Kernel; 2],
    /// In the order in which they run; the two before the last are those of errors.
    pub(super) loss: [Kernel; 6],
    /// Whole lists, and slices of them.
    pub(super) rasterize_backward: [Kernel; 2],
    /// Pairs, then blocks of them.
    pub(super) sum_pairs: [Kernel; 2],
    pub(super) project_backward: Kernel,
}

impl DepthKernels {
    /// Takes the program's own shaders.
    pub fn new(rasterizer: Rasterizer) -> DepthKernels {
        Self::from_sources(rasterizer, &shader::compose)
    }

    /// Takes other sources than the program's.
    pub fn from_sources(rasterizer: Rasterizer, sources: Sources<'_>) -> DepthKernels {
        let stage = |name: &str| Stage::new(name, sources(name, 0));
        let stages = rasterizer.stages();
        let raster = stage(stages.rasterize_depth);
        let raster_backward = stage(stages.rasterize_depth_backward);
        let (loss, back) = (stage("depth_loss"), stage("project_depth_backward"));
        DepthKernels {
            project: stage("project_depth").kernel("project_depth"),
            rasterize: ["rasterize_depth", "rasterize_depth_slice"]
                .map(|entry| raster.kernel(entry)),
            loss: [
                "depth_rows",
                "depth_patches",
                "depth_total",
                "depth_errors",
                "depth_errors_total",
                "depth_gradient",
            ]
            .map(|entry| loss.kernel(entry)),
            rasterize_backward: ["rasterize_depth_backward", "rasterize_depth_backward_slice"]
                .map(|entry| raster_backward.kernel(entry)),
            sum_pairs: ["sum_depth_pairs", "sum_depth_pair_blocks"].map(|entry| back.kernel(entry)),
            project_backward: back.kernel("project_depth_backward"),
        }
    }
}

/// The loss of depths over a whole image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DepthLossKind {
    /// 1 less Pearson's correlation.
    Pearson = 0,
    /// Mean L1 to the target after its best scale and shift, by least squares.
    ScaleShift = 1,
    /// Mean L1.
    L1 = 2,
}

/// The depth of a pixel that is compared, as its plane of `depths`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DepthPlane {
    /// The mean by weight.
    Expected = 0,
    /// That of the Gaussian that takes the transmittance to a half or less.
    Median = 4,
    /// That of the Gaussian of the largest weight.
    Mode = 5,
}

/// One loss of depths and normals; `DepthLoss` in WGSL. Its gradient is that of the weighted sum.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct DepthLossUniform {
    /// Weight of the loss over the image.
    pub weight: f32,
    /// Weight of 1 less Pearson's correlation, over square patches, in the mean of those that vary.
    pub patch_weight: f32,
    /// Weight of `1 - N n`, the mean over pixels, `N` the rendered normal and `n` the target's.
    pub normal_weight: f32,
    /// A [`DepthLossKind`].
    pub kind: u32,
    /// A [`DepthPlane`].
    pub plane: u32,
    /// 1 if inverse depths are compared, to a target of these; else 0.
    pub inverse: u32,
    /// Side of a patch, in vectors of four pixels, at most [`MOST_PATCH`] / 4.
    pub patch_vectors: u32,
    /// 1 if the target has normals, else 0.
    pub normals: u32,
}

/// Greatest side of a patch, pixels: a loop's bound.
pub const MOST_PATCH: u32 = 1024;

/// Planes of `depths`.
const PLANES: usize = 11;
/// Floats of a record of `depth_sums`.
type Record = [f32; 16];
type F4 = [f32; 4];

const SPLAT_DEPTHS: BufferKind = BufferKind::storage::<F4>("splat_depths");
const DEPTHS: BufferKind = BufferKind::storage::<[u32; 4]>("depths");
const D_PAIR_DEPTH: BufferKind = BufferKind::storage::<F4>("d_pair_depth");
const TARGET: BufferKind = BufferKind::storage::<F4>("depth_target");
const SUMS: BufferKind = BufferKind::storage::<Record>("depth_sums");
const LOSSES: BufferKind = BufferKind::storage::<F4>("depth_losses");
const LOSS: BufferKind = BufferKind::uniform::<DepthLossUniform>("depth_loss");

/// Sizes that the buffers follow from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthSize {
    /// Whether targets have normals.
    pub normals: bool,
    /// Side of a patch, pixels, rounded up to a multiple of 4.
    pub patch_px: u32,
}

impl DepthSize {
    /// Returns the vectors of four pixels across a patch.
    pub fn patch_vectors(self) -> u32 {
        self.patch_px.clamp(1, MOST_PATCH).div_ceil(4)
    }

    /// Returns the planes of a target: depth, weight and, with normals, these times their weight.
    pub fn n_planes(self) -> usize {
        if self.normals { 5 } else { 2 }
    }

    /// Returns the records of sums for an image of `view`.
    fn records(self, view: &ViewUniform) -> Records {
        let side = self.patch_vectors() as usize;
        let (columns, rows) = (
            (view.row_vectors as usize).div_ceil(side),
            view.size[1] as usize,
        );
        Records {
            rows: columns * rows,
            patches: columns * rows.div_ceil(4 * side),
        }
    }
}

/// Records of sums, beside that of the image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Records {
    /// Those of the rows of patches.
    pub(super) rows: usize,
    /// Those of patches.
    pub(super) patches: usize,
}

impl Records {
    fn total(self) -> usize {
        self.rows + self.patches + 1
    }
}

/// The buffers of depths and normals, and their bind groups for a workspace and a model.
pub struct DepthPass {
    splat_depths: Buffer,
    depths: Buffer,
    d_pair_depth: Buffer,
    target: Buffer,
    sums: Buffer,
    losses: Buffer,
    uniform: Buffer,
    size: DepthSize,
    pub(super) groups: DepthGroups,
}

pub(super) struct DepthGroups {
    pub(super) project: wgpu::BindGroup,
    pub(super) rasterize: RasterGroups,
    pub(super) loss: [wgpu::BindGroup; 6],
    pub(super) rasterize_backward: RasterGroups,
    pub(super) sum_pairs: [wgpu::BindGroup; 2],
    pub(super) project_backward: wgpu::BindGroup,
}

impl DepthPass {
    /// Bytes of a pair's gradient to depth and normal.
    pub const BYTES_A_PAIR: u64 = size_of::<F4>() as u64;

    /// Allocates the buffers and binds them, for the first view of a step, which is one of `views`. The
    /// workspace must be one that trains.
    ///
    /// # Errors
    /// A buffer is larger than the adapter can bind.
    pub fn new(
        gpu: &Gpu,
        kernels: &DepthKernels,
        workspace: &Workspace,
        model: &Model,
        views: &[ViewUniform],
        size: DepthSize,
    ) -> Result<DepthPass> {
        let (stride, pairs) = (model.stride, workspace.capacity.pairs);
        let lens = lens(stride, pairs, views, size);
        let allocate = |(kind, len): (BufferKind, usize)| kind.allocate(gpu, len);
        let [
            splat_depths,
            depths,
            d_pair_depth,
            target,
            sums,
            losses,
            uniform,
        ] = lens.map(allocate);
        let (splat_depths, depths, d_pair_depth) = (splat_depths?, depths?, d_pair_depth?);
        let (target, sums, losses, uniform) = (target?, sums?, losses?, uniform?);
        let mut names = workspace.names(model, 0);
        names.extend([
            (SPLAT_DEPTHS.name(), &splat_depths),
            (DEPTHS.name(), &depths),
            (D_PAIR_DEPTH.name(), &d_pair_depth),
            (TARGET.name(), &target),
            (SUMS.name(), &sums),
            (LOSSES.name(), &losses),
            (LOSS.name(), &uniform),
        ]);
        let bind = |kernel: &Kernel| kernel.bind(gpu, &names);
        let raster = |kernels: &[Kernel; 2]| RasterGroups::of(gpu, kernels, workspace, &names);
        let groups = DepthGroups {
            project: bind(&kernels.project),
            rasterize: raster(&kernels.rasterize),
            loss: kernels.loss.each_ref().map(bind),
            rasterize_backward: raster(&kernels.rasterize_backward),
            sum_pairs: kernels.sum_pairs.each_ref().map(bind),
            project_backward: bind(&kernels.project_backward),
        };
        Ok(DepthPass {
            splat_depths,
            depths,
            d_pair_depth,
            target,
            sums,
            losses,
            uniform,
            size,
            groups,
        })
    }

    /// Returns the bytes of its buffers.
    pub fn bytes(stride: usize, pairs: usize, views: &[ViewUniform], size: DepthSize) -> u64 {
        let lens = lens(stride, pairs, views, size);
        lens.iter().map(|(kind, len)| kind.bytes(*len)).sum()
    }

    /// Sets what the view is compared with: planes of `view`'s padded image, depth and weight and, with
    /// normals, these times their weight. Padding has weight 0.
    pub fn set_target(&self, gpu: &Gpu, planes: &[f32]) {
        self.target.write(gpu, planes);
    }

    /// Sets the loss.
    pub fn set_loss(&self, gpu: &Gpu, loss: DepthLossUniform) {
        self.uniform.write(gpu, &[loss]);
    }

    /// Returns the records of sums for an image of `view`.
    pub(super) fn records(&self, view: &ViewUniform) -> Records {
        self.size.records(view)
    }

    /// Waits for the GPU and returns the losses of the image, of patches and of normals, without their
    /// weights, and the share of pixels that count, by weight.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read_losses(&self, gpu: &Gpu) -> Result<[f64; 4]> {
        let losses: Vec<F4> = self.losses.read(gpu, 1)?;
        Ok(losses[0].map(f64::from))
    }

    /// Returns the buffer of this name in the shaders, of those that are its own.
    ///
    /// # Panics
    /// If there is none: a fault in this program.
    pub fn buffer(&self, name: &str) -> &Buffer {
        match name {
            "splat_depths" => &self.splat_depths,
            "depths" => &self.depths,
            "d_pair_depth" => &self.d_pair_depth,
            "depth_sums" => &self.sums,
            "depth_losses" => &self.losses,
            _ => panic!("no buffer `{name}`"),
        }
    }
}

/// Returns each buffer's kind and entries.
fn lens(
    stride: usize,
    pairs: usize,
    views: &[ViewUniform],
    size: DepthSize,
) -> [(BufferKind, usize); 7] {
    let largest = |of: &dyn Fn(&ViewUniform) -> usize| views.iter().map(of).max().unwrap_or(1);
    let plane = largest(&ViewUniform::plane_len);
    [
        (SPLAT_DEPTHS, stride),
        (DEPTHS, PLANES * plane),
        (D_PAIR_DEPTH, pairs),
        (TARGET, size.n_planes() * plane),
        (SUMS, largest(&|view| size.records(view).total())),
        (LOSSES, 1),
        (LOSS, 1),
    ]
}
