//! Gaussians on the GPU and their differentiable rasterization.
//!
//! One view runs project, sort by depth, bin (count), prefix sum, bin (emit), sort by tile, tile
//! ranges and order, rasterize; backward it runs `rasterize_backward`, `sum_pairs` and
//! `project_backward`, and `pose_backward` too if its camera moves. Each is the WGSL stage of that
//! name. Depths and normals are a second pass over the same lists, where a loss asks for them
//! ([`DepthPass`]). The gradient path holds no atomic float and every sum has a fixed order, so equal inputs
//! give equal bits.
//!
//! `buffers` describes every buffer once; a [`Workspace`] allocates them, and [`WorkspaceBytes`]
//! says what they will take.

mod buffers;
mod capacity;
mod depth;
mod depth_stages;
mod kernels;
mod lists;
mod median;
mod model;
mod pass;
mod pose;
mod renderer;
mod room;
mod targets;
mod uniforms;
mod workspace;

pub use buffers::WorkspaceBytes;
pub use capacity::{Capacity, first_pairs, most_pairs, rasterizer_for};
pub use depth::{
    DepthKernels, DepthLossKind, DepthLossUniform, DepthPass, DepthPlane, DepthSize, MOST_PATCH,
};
pub use kernels::{Bound, Device, Kernels};
pub use lists::{Listed, Lists};
pub use median::NO_MEDIAN;
pub use model::{BLOCK_PLANES, Model, block_bytes, model_bytes, most_gaussians, n_blocks};
pub use pass::{Pass, PassStep};
pub use pose::{PoseGradient, PoseKernels};
pub use renderer::{Rendered, Renderer, read_rendered};
pub use room::{Totals, read_totals, until_it_fits};
pub use targets::Targets;
pub(crate) use uniforms::parts;
pub use uniforms::{
    BinUniform, DropShare, LossUniform, RadixUniform, ScanUniform, SliceUniform, Splat, ViewUniform,
};
pub use workspace::Workspace;
