//! f64 twins of the GPU's stages, written from the equations and by brute force, with the cases,
//! comparisons and tolerances that the GPU is held to by them.
//!
//! For [`crate::doctor`] and the tests alone. It uses nothing of the rest of this crate, and
//! nothing else may use it, so that no slip is made on both sides at once. The evidence that it is
//! right lies in the tests: central differences, values worked out by hand, and reference cases
//! made elsewhere.

pub mod adam;
pub mod bin;
pub mod cases;
pub mod compare;
pub mod depth;
pub mod depth_loss;
pub mod dropout;
pub mod field;
pub mod linalg;
pub mod loss;
pub mod model;
pub mod pose;
pub mod project;
pub mod random;
pub mod raster;
pub mod sh;
pub mod splat;
pub mod tolerance;
