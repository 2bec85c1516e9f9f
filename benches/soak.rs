//! Memory of the host and of the GPU's buffers over a long training, with everything that a run
//! does: densification, pruning, opacity resets, checkpoints, measuring on the way, reports.
//!
//! `cargo bench --bench soak -- [--scene DIR|builtin:WIDTH] [--iterations N] [--set KEY=VALUE]...`
//!
//! The scene is small, so that many iterations fit into little time. Densification goes on to the
//! end under a cap. After the first tenth, in which buffers and caches fill, neither may grow by
//! more than a twentieth: otherwise the exit code is 1.

mod kit;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Parser;
use gspotential::config::Config;
use gspotential::error::{Error, Result};
use gspotential::eval::EvalOptions;
use gspotential::gpu::Gpu;
use gspotential::pipeline::{SoFar, TrainJob, train};
use gspotential::report::{Cell, Column, Table};
use gspotential::run::{RunDir, Stop};
use gspotential::scene::SceneSource;

use kit::Settings;

/// Between two looks at the memory.
const PERIOD: Duration = Duration::from_millis(250);

/// Rows of the table: parts of the training of equal length.
const N_PARTS: usize = 10;

/// Most growth from the second part to the last.
const TOLERANCE: f64 = 0.05;

#[derive(Parser)]
struct Args {
    #[arg(long, default_value = "builtin:48")]
    scene: SceneSource,
    #[arg(long, default_value_t = 20_000)]
    iterations: u32,
    #[command(flatten)]
    settings: Settings,
}

/// Bytes at one moment.
struct Sample {
    at_s: f64,
    host: f64,
    gpu: f64,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let job = job(&args)?;
    let gpu = Gpu::open()?;
    let scene = job.load()?;
    let folder = tempfile::tempdir().map_err(|e| Error::new(format!("no folder: {e}")))?;
    let run = RunDir::create(&folder.path().join("run"), &job.config, false)?;
    let done = AtomicBool::new(false);
    let begin = Instant::now();
    let (trained, samples) = std::thread::scope(|scope| {
        let watch = scope.spawn(|| watch(&gpu, begin, &done));
        let options = EvalOptions::default();
        let trained = train(
            &gpu,
            &scene,
            &job,
            SoFar::default(),
            &options,
            &run,
            &Stop::unheard(),
        );
        done.store(true, Ordering::Relaxed);
        (trained, watch.join())
    });
    trained?;
    let samples = samples.map_err(|_| Error::new("the watch over the memory failed"))?;
    let metrics = run.metrics()?;
    let n_changes = metrics.model_size.len() - 1;
    println!(
        "{}: {} iterations in {:.0} s, {n_changes} changes of the set of Gaussians, {} points of a \
         curve\n",
        gpu.describe(),
        args.iterations,
        begin.elapsed().as_secs_f64(),
        metrics.curve.len()
    );
    report(&samples)
}

fn job(args: &Args) -> Result<TrainJob> {
    let mut config = Config::preset("paper")?;
    config.iterations = args.iterations;
    config.scene.max_points = Some(400);
    config.scene.n_test = 2;
    config.views.count = 32;
    config.densify.end = args.iterations;
    config.densify.opacity_reset_end = args.iterations;
    config.densify.max_gaussians = 800;
    let config = args.settings.applied_to(config)?;
    Ok(TrainJob {
        eval_every: Some((args.iterations / 100).max(1)),
        checkpoint_every: Some((args.iterations / 200).max(1)),
        ..TrainJob::new(args.scene.clone().resolved()?, config)?
    })
}

fn watch(gpu: &Gpu, begin: Instant, done: &AtomicBool) -> Vec<Sample> {
    let mut samples = Vec::new();
    while !done.load(Ordering::Relaxed) {
        if let Some(host) = resident_bytes() {
            samples.push(Sample {
                at_s: begin.elapsed().as_secs_f64(),
                host,
                gpu: gpu.live_bytes() as f64,
            });
        }
        std::thread::sleep(PERIOD);
    }
    samples
}

/// Resident set of this process, where the system tells (Linux).
fn resident_bytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024.0 * kib)
}

/// Prints the means by part of the time.
///
/// # Errors
/// Memory that grows, or none that could be read.
fn report(samples: &[Sample]) -> Result<()> {
    let Some(end) = samples.last().map(|sample| sample.at_s) else {
        return Err(Error::new("this system does not tell a process's memory"));
    };
    let columns = [
        Column::number("until_s", "until s", 0),
        Column::number("host_mib", "host MiB", 1),
        Column::number("gpu_mib", "GPU buffers MiB", 1),
    ];
    let mut table = Table::new("soak", &columns);
    let mut means = Vec::new();
    for part in 0..N_PARTS {
        let (from, to) = [part, part + 1]
            .map(|i| end * i as f64 / N_PARTS as f64)
            .into();
        let of_part: Vec<&Sample> = samples
            .iter()
            .filter(|sample| sample.at_s > from && sample.at_s <= to)
            .collect();
        let mean = |of: fn(&Sample) -> f64| {
            of_part.iter().map(|sample| of(sample)).sum::<f64>() / of_part.len() as f64
        };
        let (host, gpu) = (mean(|sample| sample.host), mean(|sample| sample.gpu));
        table.row([to, host / 1048576.0, gpu / 1048576.0].map(Cell::from));
        means.push((host, gpu));
    }
    print!("{table}");
    let ((host_0, gpu_0), (host, gpu)) = (means[1], means[N_PARTS - 1]);
    let (host, gpu) = (host / host_0 - 1.0, gpu / gpu_0 - 1.0);
    println!(
        "\nfrom the second part to the last: host {:+.1} %, GPU buffers {:+.1} %",
        100.0 * host,
        100.0 * gpu
    );
    // Written so that NaN, a part without a sample, fails.
    if host <= TOLERANCE && gpu <= TOLERANCE {
        return Ok(());
    }
    Err(Error::new("memory grows with the iterations"))
}
