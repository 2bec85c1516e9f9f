//! f64 twins of the compute stages, written from the equations and brute force, and the evidence
//! that they are right: central differences of the forward against the backward, and reference
//! cases from disk. GPU code is held against these.

pub mod adam;
pub mod bin;
pub mod cases;
pub mod compare;
pub mod dropout;
pub mod fixture;
pub mod linalg;
pub mod loss;
pub mod model;
pub mod npy;
pub mod project;
pub mod raster;
pub mod sh;
pub mod tolerance;

mod comparison_tests;
mod loss_tests;
mod project_tests;
mod raster_tests;
mod reference_tests;
