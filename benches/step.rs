//! GPU time of one training step by kernel, and what it costs the host: processor time of the thread that
//! records and submits it, compute passes, dispatches and writes.
//!
//! `cargo bench --bench step -- [--scene DIR|builtin:WIDTH] [--max-size PX] [--max-points N]
//! [--preset NAME] [--warmup N] [--steps N] [--set KEY=VALUE]...`

mod kit;

use std::collections::BTreeMap;
use std::time::Instant;

use clap::Parser;
use gspotential::error::{Error, Result};
use gspotential::gpu::{Gpu, KernelTime, Profile};
use gspotential::pipeline::{kernel_table, prepare};
use gspotential::render::Kernels;
use gspotential::run::{Sample, Seconds, StepProfile};
use gspotential::scene::LoadOptions;
use gspotential::train::Trainer;

use kit::SceneArgs;

#[derive(Parser)]
struct Args {
    #[command(flatten)]
    on: SceneArgs,
    #[arg(long, default_value_t = 320)]
    max_size: u32,
    #[arg(long)]
    max_points: Option<usize>,
    #[arg(long, default_value = "paper")]
    preset: String,
    /// Steps before the measured ones
    #[arg(long, default_value_t = 5)]
    warmup: u32,
    /// Steps measured
    #[arg(long, default_value_t = 20)]
    steps: u32,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let mut config = args.on.config(&args.preset)?;
    config.scene.max_size_px = Some(args.max_size);
    config.scene.max_points = args.max_points;
    let options = LoadOptions {
        n_test: 1,
        ..LoadOptions::new(&config)
    };
    let scene = args.on.load(args.max_size, options)?;
    let mut seconds = Seconds::default();
    let prepared = prepare(&scene, &config, &mut seconds)?;
    let gpu = Gpu::open()?;
    let kernels = Kernels::of(&config.render, &gpu)?;
    let supervision = &prepared.supervision;
    let mut trainer = Trainer::new(&gpu, &kernels, &prepared.start, supervision, &config)?;
    let mut warm = 0;
    while warm < args.warmup {
        trainer.step(warm, None);
        warm = trainer.make_room()?.unwrap_or(warm + 1);
    }
    let mut profile =
        Profile::new(&gpu).ok_or_else(|| Error::new("the adapter has no timestamps"))?;
    let mut kernels: BTreeMap<&str, KernelTime> = BTreeMap::new();
    let mut wall = 0.0;
    let mut pairs = 0;
    for i in args.warmup..args.warmup + args.steps {
        let start = Instant::now();
        trainer.step(i, Some(&mut profile));
        gpu.wait()?;
        wall += start.elapsed().as_secs_f64();
        if trainer.make_room()?.is_some() {
            return Err(Error::new("the pairs of a measured step did not fit")
                .way_out("give more --warmup steps"));
        }
        pairs += trainer.n_pairs()?;
        for (name, time) in profile.take(&gpu)? {
            let sum = kernels.entry(name).or_default();
            sum.seconds += time.seconds;
            sum.dispatches += time.dispatches;
        }
    }
    let host = host(&mut trainer, &gpu, args.warmup + args.steps, args.steps)?;
    let n = f64::from(args.steps);
    println!("{host}");
    println!("{:.0} pairs in the step's last view", pairs as f64 / n);
    println!(
        "{}: {} Gaussians, {}",
        gpu.describe(),
        prepared.start.len(),
        scene.name
    );
    let sample = Sample {
        timed: args.steps,
        iterations: args.steps,
        wall_s: wall / n,
    };
    let step = StepProfile::new(&kernels, sample);
    println!("\n{}", kernel_table(&step));
    Ok(())
}

/// What `n` steps from `first` on cost the host, a step.
fn host(trainer: &mut Trainer<'_>, gpu: &Gpu, first: u32, n: u32) -> Result<String> {
    let before = gpu.requests();
    let mut least = f64::INFINITY;
    for i in first..first + n {
        let start = kit::thread_s();
        trainer.step(i, None);
        if let (Some(start), Some(end)) = (start, kit::thread_s()) {
            least = least.min(end - start);
        }
        gpu.wait()?;
    }
    let after = gpu.requests();
    let a_step = |before: u64, after: u64| (after - before) as f64 / f64::from(n);
    Ok(format!(
        "host, a step: {:.3} ms of its thread at least, {:.1} compute passes, {:.1} dispatches, {:.1} writes",
        1e3 * least,
        a_step(before.passes, after.passes),
        a_step(before.dispatches, after.dispatches),
        a_step(before.writes, after.writes),
    ))
}
