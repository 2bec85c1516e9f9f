//! The one test binary.

mod architecture;
mod builtin;
mod cameras_json;
mod carve;
mod cli;
mod commands;
mod comparison;
mod config;
mod faults;
mod field;
mod gaussians;
mod gaussians_ply;
mod geometry;
mod gpu;
mod hard;
mod metrics;
mod plot;
mod policy;
mod reference;
mod report;
mod run;
mod scene;
mod splat;
mod study;
mod views;
mod visibility;
