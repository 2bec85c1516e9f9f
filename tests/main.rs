//! The one test binary.

mod architecture;
mod cli;
mod config;
mod metrics;
mod report;
mod run;
