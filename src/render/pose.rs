//! The gradient of a view's loss with respect to its camera's pose.
//!
//! A motion `(w, v)` of a camera takes what lies at `p` in its axes to `exp([w]x) p + v`: a turn
//! `w` about the optical centre, in radians, then a shift `v`, in units of length
//! ([`crate::camera::Camera::moved`]). The gradient is with respect to `(w, v)` at 0. With `p` a
//! Gaussian's mean in these axes, `M = R S` its rotation and scales there, and `c` its colour,
//!
//! ```text
//! dL/dv = sum dL/dp,    dL/dw = sum p x (dL/dp less its part through c) + sum_j M_j x dL/dM_j
//! ```
//!
//! for a turn about the optical centre leaves the direction in which a Gaussian is seen, and so
//! `c`.

use super::model::Model;
use super::workspace::Workspace;
use crate::error::Result;
use crate::gpu::constants::WORKGROUP;
use crate::gpu::shader::{self, Sources};
use crate::gpu::{Buffer, BufferKind, Commands, Gpu, Kernel, by_degree};

/// The kernels of this stage, which only moving cameras need.
pub struct PoseKernels {
    /// By active SH degree.
    backward: [Kernel; 4],
    total: Kernel,
}

impl Default for PoseKernels {
    /// Takes the program's own shaders.
    fn default() -> PoseKernels {
        Self::from_sources(&shader::compose)
    }
}

impl PoseKernels {
    /// Takes other sources than the program's.
    pub fn from_sources(sources: Sources<'_>) -> PoseKernels {
        let kernel = |entry: &'static str, degree: u32| {
            let stage = "pose_backward";
            Kernel::from_source(stage, entry, sources(stage, degree))
        };
        PoseKernels {
            backward: by_degree(|degree| kernel("pose_backward", degree)),
            total: kernel("pose_total", 0),
        }
    }
}

/// A `Motion` in WGSL: turn and shift, each padded to four numbers.
type Motion = [[f32; 4]; 2];

const SUMS: BufferKind = BufferKind::storage::<Motion>("pose_sums");
const D_POSE: BufferKind = BufferKind::storage::<Motion>("d_pose");

/// The gradient's buffers and bind groups for a workspace and a model.
pub struct PoseGradient {
    sums: Buffer,
    d_pose: Buffer,
    /// By active SH degree, up to the model's.
    backward: Vec<wgpu::BindGroup>,
    total: wgpu::BindGroup,
}

impl PoseGradient {
    /// Allocates the buffers and binds them, for the first view of a step.
    ///
    /// # Errors
    /// A buffer is larger than the adapter can bind.
    pub fn new(
        gpu: &Gpu,
        kernels: &PoseKernels,
        workspace: &Workspace,
        model: &Model,
    ) -> Result<PoseGradient> {
        let sums = SUMS.allocate(gpu, n_sums(model.stride))?;
        let d_pose = D_POSE.allocate(gpu, 1)?;
        let mut names = workspace.names(model, 0);
        names.extend([(SUMS.name(), &sums), (D_POSE.name(), &d_pose)]);
        let used = &kernels.backward[..=model.sh_degree as usize];
        let backward = used.iter().map(|k| k.bind(gpu, &names)).collect();
        let total = kernels.total.bind(gpu, &names);
        Ok(PoseGradient {
            sums,
            d_pose,
            backward,
            total,
        })
    }

    /// Returns the bytes of its buffers for this many Gaussians.
    pub fn bytes(stride: usize) -> u64 {
        SUMS.bytes(n_sums(stride)) + D_POSE.bytes(1)
    }

    /// Records the kernels of an SH degree over `n` Gaussians.
    pub(super) fn record(
        &self,
        commands: &mut Commands<'_>,
        kernels: &PoseKernels,
        sh_degree: usize,
        n: u64,
    ) {
        commands.dispatch(&kernels.backward[sh_degree], &self.backward[sh_degree], n);
        commands.dispatch(&kernels.total, &self.total, 1);
    }

    /// Waits for the GPU and returns the gradient with respect to turn and shift, `(w, v)`.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read(&self, gpu: &Gpu) -> Result<[f64; 6]> {
        let parts: Vec<[f32; 4]> = self.d_pose.read(gpu, 2)?;
        let at = |part: usize, axis: usize| f64::from(parts[part][axis]);
        Ok([at(0, 0), at(0, 1), at(0, 2), at(1, 0), at(1, 1), at(1, 2)])
    }

    /// Returns the buffers that the kernels write, for the doctor to spoil first.
    pub fn outputs(&self) -> [&Buffer; 2] {
        [&self.sums, &self.d_pose]
    }
}

/// Returns the number of partial sums over the blocks of so many Gaussians.
fn n_sums(stride: usize) -> usize {
    stride.div_ceil(WORKGROUP as usize)
}
