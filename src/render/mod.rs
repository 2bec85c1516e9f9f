//! Gaussians on the GPU and their differentiable rasterization.
//!
//! One view forward: project, bin (count), two prefix sums, bin (emit), sort, rasterize; backward:
//! rasterize_backward, project_backward. Each is the WGSL stage of that name; the gradient path
//! holds no atomic float and every sum has a fixed order, so equal inputs give equal bits.

mod model;
mod renderer;
mod uniforms;
mod workspace;

pub use model::{BLOCK_PLANES, Model, n_blocks};
pub use renderer::{Rendered, Renderer};
pub use uniforms::{LossUniform, RadixUniform, ScanUniform, ViewUniform};
pub use workspace::{Bound, Capacity, Kernels, Pass, Workspace, read_totals};
