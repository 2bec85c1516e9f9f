//! Sparse-view 3D Gaussian Splatting guided by a camera potential field.
//!
//! Data flows one way: [`scene`] -> [`field`] -> [`views`] -> [`splat`] -> [`render`] ->
//! [`train`] -> [`eval`] -> [`report`]; [`gpu`], [`config`], [`camera`], [`gaussians`] and
//! [`error`] lie beneath.
//!
//! Frames and units: the scene's own frame is that of its camera poses (world-to-camera, +z
//! forward, y down). Everything on the GPU lives in the canonical frame ([`camera::Frame`]):
//! focus at the origin, sphere of radius 1. Colours are as stored (sRGB), in `[0, 1]`.

pub mod camera;
pub mod cameras_json;
pub mod config;
pub mod error;

pub mod field;
pub mod gaussians;
pub mod gpu;
pub mod render;
pub mod scene;
pub mod splat;
pub mod train;
pub mod views;
