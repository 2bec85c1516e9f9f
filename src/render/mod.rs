//! Gaussians on the GPU and their differentiable rasterization.
//!
//! One view forward: project, sort by depth, bin (count), prefix sum, bin
//! (emit), sort by tile, rasterize; backward:
//! rasterize_backward, sum_pairs, project_backward, and pose_backward where a camera moves, too. Each is the WGSL stage of that name; the gradient path
//! holds no atomic float and every sum has a fixed order, so equal inputs give equal bits.

mod capacity;
mod kernels;
mod memory;
mod model;
mod pass;
mod pose;
mod renderer;
mod room;
mod uniforms;
mod workspace;

pub use capacity::Capacity;
pub use kernels::{Bound, Kernels};
pub use memory::{WorkspaceBytes, block_bytes, first_pairs, model_bytes, most_pairs};
pub use model::{BLOCK_PLANES, Model, most_gaussians, n_blocks};
pub use pass::Pass;
pub use pose::{PoseGradient, PoseKernels};
pub use renderer::{Rendered, Renderer, read_rendered};
pub use room::{Totals, read_totals};
pub(crate) use uniforms::parts;
pub use uniforms::{
    BinUniform, DropShare, LossUniform, RadixUniform, ScanUniform, SliceUniform, Splat, ViewUniform,
};
pub use workspace::Workspace;
