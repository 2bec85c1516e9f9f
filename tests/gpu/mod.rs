//! The GPU's stages held against their f64 twins, its shaders against the host's structs, and
//! its runs against one another.

mod adam;
mod bin;
mod determinism;
mod dispatch;
mod dropout;
mod fixtures;
mod loss;
mod project;
mod rearrange;
mod reflection;
pub mod render;
pub mod rig;
