//! The one test binary.

mod architecture;
mod builtin;
mod cli;
mod commands;
mod config;
mod field;
mod gaussians;
mod geometry;
mod gpu;
mod hard;
mod metrics;
mod policy;
mod report;
mod run;
mod scene;
mod splat;
mod twins;
mod views;
