//! Sparse-view 3D Gaussian Splatting guided by a camera potential field.
//!
//! Data flows one way: [`scene`] -> [`field`] -> [`views`] -> [`splat`] -> [`render`] ->
//! [`train`] -> [`eval`] -> [`report`]; [`gpu`], [`config`], [`camera`], [`gaussians`],
//! [`progress`], [`digest`], [`run`] and [`error`] lie beneath. [`metrics`] measures images for [`eval`],
//! [`pipeline`] calls the stages in a row, and [`cli`] is the commands on top.
//!
//! Frames and units: the scene's own frame is that of its camera poses (world-to-camera, +z
//! forward, y down). Everything on the GPU lives in the canonical frame ([`camera::Frame`]):
//! focus at the origin, sphere of radius 1. Colours are as stored (sRGB), in `[0, 1]`.

pub mod camera;
pub mod cameras_json;
pub mod cli;
pub mod config;
pub mod digest;
pub mod error;
pub mod eval;
pub mod field;
pub mod gaussians;
pub mod gpu;
pub mod metrics;
pub mod pipeline;
pub mod progress;
pub mod render;
pub mod report;
pub mod run;
pub mod scene;
pub mod splat;
pub mod train;
pub mod views;
