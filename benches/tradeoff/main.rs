//! Speed against error of the choices that trade one for the other.
//!
//! `cargo bench --bench tradeoff -- [--scene DIR|builtin:WIDTH] [--out DIR] [--max-size PX]
//! [--max-points N] [--rounds N] [--set KEY=VALUE]...`
//!
//! Settings take turns, so that a machine that is shared slows all of them alike, and each one's
//! fastest round counts.

mod clock;
mod grid;
#[path = "../kit/mod.rs"]
mod kit;
mod output;
mod splat;

use std::path::PathBuf;

use clap::Parser;
use gspotential::error::Result;
use gspotential::scene::LoadOptions;

use kit::SceneArgs;

/// What is measured of one setting of one choice.
pub(crate) struct Measured {
    pub(crate) choice: &'static str,
    pub(crate) setting: String,
    /// Whether the program uses it.
    pub(crate) kept: bool,
    pub(crate) seconds: f64,
    /// In the unit of its choice.
    pub(crate) error: f64,
    /// What else there is to know.
    pub(crate) note: String,
}

#[derive(Parser)]
struct Args {
    #[command(flatten)]
    on: SceneArgs,
    /// Folder for tradeoff.csv, tradeoff.md and the plots
    #[arg(long, default_value = "target/tradeoff")]
    out: PathBuf,
    #[arg(long, default_value_t = 320)]
    max_size: u32,
    #[arg(long, default_value_t = 30_000)]
    max_points: usize,
    /// Rounds of which the fastest counts
    #[arg(long, default_value_t = 7)]
    rounds: usize,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let mut config = args.on.config("paper")?;
    config.scene.max_size_px = Some(args.max_size);
    config.scene.max_points = Some(args.max_points);
    let scene = args.on.load(args.max_size, LoadOptions::new(&config))?;
    eprintln!("candidate grid");
    let grid = grid::measure(&scene, &config, args.rounds)?;
    eprintln!("point splat");
    let splat = splat::measure(&scene, &config, args.rounds)?;
    let headline = format!(
        "{} at {} px, {} points. Times: {}, the least of {} rounds",
        scene.name,
        args.max_size,
        args.max_points,
        clock::unit(),
        args.rounds
    );
    output::write(&args.out, &headline, &grid, &splat)
}
