//! The one test binary.

mod architecture;
mod builtin;
mod cameras_json;
mod cli;
mod commands;
mod comparison;
mod compass;
mod config;
mod field;
mod gaps;
mod gaussians;
mod gaussians_ply;
mod geometry;
mod gpu;
mod habits;
mod hard;
mod metrics;
mod page;
mod plot;
mod policy;
mod report;
mod run;
mod scene;
mod splat;
mod twins;
mod views;
