//! The one test binary.

mod architecture;
mod builtin;
mod cameras_json;
mod cli;
mod commands;
mod comparison;
mod config;
mod field;
mod fill;
mod gaussians;
mod gaussians_ply;
mod geometry;
mod gpu;
mod hard;
mod metrics;
mod plot;
mod policy;
mod report;
mod run;
mod scene;
mod shell;
mod splat;
mod twins;
mod views;
