//! The one test binary.

mod field;
mod gaussians;
mod geometry;
mod splat;
mod views;
