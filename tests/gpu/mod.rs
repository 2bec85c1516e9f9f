//! The GPU's stages held against the f64 reference, its shaders against the host's structs, and
//! its runs against one another.

mod adam;
mod determinism;
mod dispatch;
mod doctor;
mod dropout;
mod exp2;
mod extremes;
mod fixtures;
mod limits;
mod loops;
mod loss;
mod plants;
mod rasterizers;
mod rearrange;
mod reflection;
mod requests;
pub(crate) mod rig;
mod sorts;
pub(crate) mod views;
