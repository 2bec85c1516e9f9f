//! Sparse-view 3D Gaussian Splatting guided by a camera potential field.
//!
//! Data flows one way: [`scene`] -> [`field`] -> [`views`] -> [`splat`] -> [`render`] ->
//! [`train`] -> [`eval`] -> [`report`]; [`gpu`], [`config`], [`camera`], [`compass`],
//! [`gaussians`], [`logging`], [`progress`], [`digest`], [`run`], `ply` and [`error`] lie beneath.
//! Where the config asks for it, [`carve`] clears the cloud by the photographs and [`visibility`]
//! weighs where views may stand, both by splats. [`gaps`] looks for what the photographs leave
//! uncovered, [`metrics`] measures images for [`eval`], [`pipeline`] calls the stages in a row,
//! [`study`] trains what a table or figure of the paper needs, and [`cli`] is the commands on top.
//! [`mod@reference`] stands apart: the same computed in f64 by other means, which [`doctor`] holds
//! the GPU to.
//!
//! Frames and units: the scene's own frame is that of its camera poses (world-to-camera, +z
//! forward, y down). Everything on the GPU lives in the canonical frame ([`camera::Frame`]):
//! focus at the origin, sphere of radius 1. Colours are as stored (sRGB), in `[0, 1]`.

#![forbid(unsafe_code)]

// Products of two image sides or of a number of Gaussians and its bytes fit a `usize` then.
const _: () = assert!(usize::BITS >= 64, "needs a 64-bit system");

pub mod camera;
pub mod cameras_json;
pub mod carve;
pub mod cli;
pub mod compass;
pub mod config;
pub mod digest;
pub mod doctor;
pub mod error;
pub mod eval;
pub mod field;
pub mod gaps;
pub mod gaussians;
pub mod gpu;
pub mod logging;
pub mod metrics;
pub mod pipeline;
mod ply;
pub mod progress;
pub mod reference;
pub mod render;
pub mod report;
pub mod run;
pub mod scene;
pub mod splat;
pub mod stats;
pub mod study;
pub mod train;
pub mod views;
pub mod visibility;
