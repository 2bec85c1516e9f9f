//! GPU time of one training step by kernel, what it costs the host (processor time of the thread that
//! records and submits it, compute passes, dispatches and writes), and what the first step takes.
//!
//! `cargo bench --bench step -- [--scene DIR|builtin:WIDTH] [--max-size PX] [--max-points N]
//! [--preset NAME] [--warmup N] [--steps N] [--prepare] [--set KEY=VALUE]...`
//!
//! A cold start is one without the driver's cache of machine code: Mesa has none with `MESA_SHADER_CACHE_DISABLE=true`.
//! The host's time does not depend on the Gaussians or, where target images stay on the GPU, on the pixels; those of a driver that
//! runs on a CPU stay with `--set render.targets_mib=64`.

mod kit;

use std::collections::BTreeMap;
use std::fmt;
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
    /// Compile and try the first step's kernels beforehand, as training does beside the virtual views
    #[arg(long)]
    prepare: bool,
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
    let beforehand = Lap::of(|| {
        if args.prepare {
            kernels.prepare(&gpu);
        }
        gpu.wait()
    })?;
    let mut trainer = Trainer::new(&gpu, &kernels, &prepared.start, supervision, &config)?;
    let pipelines = Lap::of(|| {
        trainer.compile();
        Ok(())
    })?;
    let first = Lap::of(|| {
        trainer.step(0, None);
        gpu.wait()
    })?;
    println!("kernels beforehand: {beforehand}; pipelines: {pipelines}; first step: {first}");
    let mut warm = trainer.make_room()?.unwrap_or(1);
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

/// Seconds of the clock and of the processor.
struct Lap {
    wall: f64,
    processor: Option<f64>,
}

impl Lap {
    fn of(work: impl FnOnce() -> Result<()>) -> Result<Lap> {
        let (clock, before) = (Instant::now(), kit::cpu_s());
        work()?;
        Ok(Lap {
            wall: clock.elapsed().as_secs_f64(),
            processor: before
                .zip(kit::cpu_s())
                .map(|(before, after)| after - before),
        })
    }
}

impl fmt::Display for Lap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.2} s", self.wall)?;
        match self.processor {
            Some(seconds) => write!(f, ", {seconds:.2} s of the processor"),
            None => Ok(()),
        }
    }
}

/// What `n` steps from `first` on cost the host, a step.
fn host(trainer: &mut Trainer<'_>, gpu: &Gpu, first: u32, n: u32) -> Result<String> {
    let before = gpu.requests();
    let mut least = f64::INFINITY;
    for i in first..first + n {
        let start = kit::thread_s();
        trainer.step(i, None);
        // What a thread has run for is counted when it rests.
        gpu.wait()?;
        if let (Some(start), Some(end)) = (start, kit::thread_s()) {
            least = least.min(end - start);
        }
    }
    let after = gpu.requests();
    let a_step = |before: u64, after: u64| (after - before) as f64 / f64::from(n);
    Ok(format!(
        "host, a step: {:.3} ms of its thread at least, with the wait, {:.1} compute passes, {:.1} dispatches, {:.1} writes",
        1e3 * least,
        a_step(before.passes, after.passes),
        a_step(before.dispatches, after.dispatches),
        a_step(before.writes, after.writes),
    ))
}
