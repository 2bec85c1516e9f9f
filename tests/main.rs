//! The one test binary.

mod architecture;
mod builtin;
mod cli;
mod config;
mod metrics;
mod report;
mod run;
