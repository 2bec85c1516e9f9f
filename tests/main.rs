//! The one test binary.

mod architecture;
mod builtin;
mod cli;
mod commands;
mod config;
mod field;
mod gaussians;
mod geometry;
mod metrics;
mod report;
mod run;
mod scene;
mod splat;
mod twins;
mod views;
