//! Time and memory against the size of what is worked on, each as a fitted exponent.
//!
//! `cargo bench --bench growth -- [--out DIR] [--most-gaussians N] [--sh-degree D] [--widest PX] [--most-views N]
//! [--most-points N] [--rounds N]`, or `cargo bench --bench growth -- --million` for one iteration of a million Gaussians
//! instead.
//!
//! First the fit is checked.
//! Each time is the least of several rounds: on a software adapter and on the host CPU time, which
//! what else a shared machine does hardly changes, otherwise by timestamps.

#[path = "../tradeoff/clock.rs"]
mod clock;
mod cloud;
mod fit;
mod host;
mod million;
mod output;
mod stages;
mod step;

use std::path::PathBuf;

use clap::Parser;
use gspotential::doctor::Context;
use gspotential::error::Result;
use gspotential::gpu::Gpu;

/// One figure of one size.
pub(crate) struct Figure {
    /// What grows.
    pub(crate) sweep: &'static str,
    pub(crate) size: f64,
    pub(crate) what: String,
    /// `s`, `B`, or what is counted.
    pub(crate) unit: &'static str,
    pub(crate) value: f64,
}

pub(crate) const GAUSSIANS: &str = "Gaussians";
pub(crate) const PIXELS: &str = "pixels";
pub(crate) const VIEWS: &str = "virtual views";
pub(crate) const POINTS: &str = "cloud points";

#[derive(Parser)]
pub(crate) struct Args {
    /// Folder for growth.csv, growth.md and the plots
    #[arg(long, default_value = "target/growth")]
    out: PathBuf,
    /// 2000000 of degree 3 takes an adapter that binds 160 MB and more, of degree 2 128 MB
    #[arg(long, default_value_t = 200_000)]
    most_gaussians: usize,
    /// SH degree of the Gaussians
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=3))]
    sh_degree: u32,
    #[arg(long, default_value_t = 1600)]
    widest: u32,
    #[arg(long, default_value_t = 256)]
    most_views: usize,
    #[arg(long, default_value_t = 1_000_000)]
    most_points: usize,
    /// Rounds of which the fastest counts
    #[arg(long, default_value_t = 5)]
    rounds: u32,
    /// Train a million Gaussians at the widest size for one iteration, and nothing else
    #[arg(long)]
    million: bool,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// 1, 2 and 5 times powers of ten from `first` to `last`.
pub(crate) fn sizes(first: usize, last: usize) -> Vec<usize> {
    let decades = (0..12).map(|k| 10_usize.pow(k));
    let all = decades.flat_map(|ten| [ten, 2 * ten, 5 * ten]);
    all.filter(|n| (first..=last).contains(n)).collect()
}

fn main() -> Result<()> {
    let args = Args::parse();
    if args.million {
        return million::train_once(&args);
    }
    fit::check();
    let ctx = Context::new(Gpu::open()?)?;
    let mut figures = Vec::new();
    eprintln!("Gaussians");
    step::gaussians(&ctx, &args, &mut figures)?;
    eprintln!("pixels");
    step::pixels(&ctx, &args, &mut figures)?;
    eprintln!("virtual views");
    host::views(&args, &mut figures)?;
    eprintln!("cloud points");
    host::points(&args, &mut figures)?;
    output::write(&args.out, &ctx.gpu.describe(), &figures)
}
