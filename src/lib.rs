//! Sparse-view 3D Gaussian Splatting guided by a camera potential field.
//!
//! Data flows one way: [`scene`] -> [`field`] -> [`views`] -> [`cloud`] (the point splat) ->
//! [`train`] -> [`eval`] -> [`report`]. Beneath lie [`version`], [`error`], [`files`], [`terminal`], [`camera`],
//! [`config`], [`gaussians`], [`gpu`], [`metrics`], [`render`] and [`mesh`]. [`run`] stores what others
//! define, [`live`] serves a page that shows a training as it runs, [`pipeline`] calls the stages in a row, [`study`] trains what a table or figure of the
//! paper needs, [`doctor`] holds the GPU to the f64 twin beside it ([`doctor::twin`]), and [`cli`]
//! is the commands on top. If only photographs are there, [`prior`] finds depth and cameras and
//! [`dense`] makes one cloud of them, before the flow begins. A module imports only from those before it in `tests/architecture.rs`,
//! and no folder holds a circle.
//!
//! The program is the interface. The modules are public for the tests and the benches beside it;
//! they change without notice.
//!
//! # Conventions
//!
//! - **Cameras** look along +z with x to the right and y down. A pose is world-to-camera,
//!   `p_camera = R p_world + t`, with column vectors. Pixel centres lie at +0.5.
//! - **Frames**: the scene's own frame is that of its camera poses. Everything on the GPU lives in
//!   the canonical frame ([`camera::Frame`]): the focus at the origin, the sphere's radius 1.
//! - **Quaternions** are (w, x, y, z) in files and on the GPU, as 3DGS stores them.
//! - **Colours** are as stored (sRGB), in `[0, 1]`. Spherical harmonics have 3DGS's order and signs.
//! - **Units** stand in the names of keys and fields: `_px`, `_deg`, `_s`, `_bytes`; lengths in a
//!   config are in `R`, the sphere's radius.
//! - **Names**: `n_*` counts, `*_id` indexes, `d_*` is a gradient, `*_log` and `*_logit` say how a
//!   value is stored.

#![forbid(unsafe_code)]

// Products of two image sides or of a number of Gaussians and its bytes fit a `usize` then.
const _: () = assert!(usize::BITS >= 64, "needs a 64-bit system");

pub mod camera;
pub mod cli;
pub mod cloud;
pub mod config;
pub mod dense;
pub mod doctor;
pub mod error;
pub mod eval;
pub mod field;
pub mod files;
pub mod gaussians;
pub mod gpu;
pub mod live;
pub mod mesh;
pub mod metrics;
pub mod pipeline;
pub mod prior;
pub mod render;
pub mod report;
pub mod run;
pub mod scene;
pub mod study;
pub mod terminal;
pub mod train;
pub mod version;
pub mod views;
