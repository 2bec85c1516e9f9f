//! The GPU: adapter and limits, buffers with readback, shader composition, kernels.

pub mod buffer;
pub mod commands;
pub mod constants;
pub mod device;
pub mod exp2;
pub mod kernel;
pub mod rasterizer;
pub mod shader;
pub mod timestamps;

pub use buffer::{Buffer, BufferKind, PORTION, UNIFORM_ALIGNMENT};
pub use commands::{Commands, Requests, try_out};
pub use device::{Gpu, adapters, binding_limit, prefer_adapter, shader_count};
pub use exp2::Exp2;
pub use kernel::{Kernel, Stage, by_degree};
pub use rasterizer::Rasterizer;
pub use timestamps::{KernelTime, Profile};
