//! Time of LPIPS on one pair of images.
//!
//! `cargo bench --bench lpips -- --lpips-weights FILE.safetensors [--size WIDTHxHEIGHT] [--pairs N]`

mod kit;

use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use gspotential::error::Result;
use gspotential::metrics::Lpips;
use gspotential::metrics::lpips::InputRange;
use gspotential::run::peak_host_bytes;
use gspotential::scene::Image;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use kit::{Size, cpu_s};

#[derive(Parser)]
struct Args {
    #[arg(long)]
    lpips_weights: PathBuf,
    /// Width and height of the images
    #[arg(long, default_value = "320x213")]
    size: Size,
    /// Pairs measured, after one that is not
    #[arg(long, default_value_t = 5)]
    pairs: u32,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let (width, height) = args.size.pixels;
    let lpips = Lpips::read(&args.lpips_weights, InputRange::Unit)?;
    let (a, b) = (noise(width, height, 1), noise(width, height, 2));
    let distance = lpips.distance(&a, &b)?;
    let (start, cpu) = (Instant::now(), cpu_s());
    for _ in 0..args.pairs {
        // The same bits every time, or the time is of something else.
        assert_eq!(lpips.distance(&a, &b)?, distance);
    }
    let n = f64::from(args.pairs);
    let wall = start.elapsed().as_secs_f64() / n;
    let cpu = cpu_s().zip(cpu).map(|(after, before)| (after - before) / n);
    println!(
        "{} {width}x{height}: {wall:.3} s wall, {} CPU s a pair, {} threads, peak {} MB",
        lpips.net(),
        cpu.map_or("?".to_owned(), |s| format!("{s:.3}")),
        rayon::current_num_threads(),
        peak_host_bytes().map_or(0, |bytes| bytes / 1_000_000),
    );
    Ok(())
}

fn noise(width: u32, height: u32, seed: u64) -> Image {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let rgb = (0..width * height * 3).map(|_| rng.random()).collect();
    Image { width, height, rgb }
}
