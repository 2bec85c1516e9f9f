//! A training step against Gaussians and pixels.

use gspotential::config::Config;
use gspotential::doctor::Context;
use gspotential::error::{Error, Result};
use gspotential::gpu::Profile;
use gspotential::pipeline::{Prepared, prepare};
use gspotential::render::ViewUniform;
use gspotential::run::{Checkpoints, Seconds};
use gspotential::scene::Scene;
use gspotential::train::{Trainer, TrainingBytes};

use super::clock::of_cpu;
use super::{Args, Figure, GAUSSIANS, PIXELS, cloud, host, sizes, stages};

/// Width of the images while Gaussians grow, and Gaussians while pixels do.
const WIDTH: u32 = 320;
const N_GAUSSIANS: usize = 30_000;
/// Steps that warm up buffers and kernels.
const N_WARM: u32 = 3;

/// The paper's settings for `n` Gaussians, with a few virtual views.
///
/// # Errors
/// None: the preset is the program's own.
pub(crate) fn config(n: usize, sh_degree: u32) -> Result<Config> {
    let mut config = Config::preset("paper")?;
    config.views.count = 4;
    config.scene.max_points = Some(n);
    config.model.sh_degree = sh_degree;
    // All degrees of SH take part.
    config.model.sh_interval = 1;
    Ok(config)
}

/// Against the number of Gaussians, with a checkpoint of each.
///
/// # Errors
/// A size that the adapter cannot hold.
pub(crate) fn gaussians(ctx: &Context, args: &Args, figures: &mut Vec<Figure>) -> Result<()> {
    for n in sizes(10_000, args.most_gaussians) {
        let config = config(n, args.sh_degree)?;
        let scene = cloud::scene(&config, WIDTH, n)?;
        measure(ctx, (&scene, &config), args.rounds, |what, unit, value| {
            figures.push(Figure {
                sweep: GAUSSIANS,
                size: n as f64,
                what,
                unit,
                value,
            });
        })?;
    }
    Ok(())
}

/// Against the pixels of an image.
///
/// # Errors
/// A size that the adapter cannot hold.
pub(crate) fn pixels(ctx: &Context, args: &Args, figures: &mut Vec<Figure>) -> Result<()> {
    for width in [200, 400, 800, 1600]
        .into_iter()
        .filter(|w| *w <= args.widest)
    {
        let mut config = config(N_GAUSSIANS, args.sh_degree)?;
        config.scene.max_size_px = Some(width);
        let scene = cloud::scene(&config, width, N_GAUSSIANS)?;
        let image = &scene.train[0].image;
        let size = f64::from(image.width) * f64::from(image.height);
        measure(ctx, (&scene, &config), args.rounds, |what, unit, value| {
            figures.push(Figure {
                sweep: PIXELS,
                size,
                what,
                unit,
                value,
            });
        })?;
    }
    Ok(())
}

fn measure(
    ctx: &Context,
    (scene, config): (&Scene, &Config),
    rounds: u32,
    mut figure: impl FnMut(String, &'static str, f64),
) -> Result<()> {
    host::forget_peak();
    let gpu = &ctx.gpu;
    let prepared = prepare(scene, config, &mut Seconds::default())?;
    let Prepared {
        supervision, start, ..
    } = &prepared;
    let mut trainer = Trainer::new(gpu, &ctx.kernels, start, supervision, config)?;
    let seconds = steps(ctx, &mut trainer, rounds)?;
    eprintln!(
        "  {} Gaussians: {:.1} ms a step",
        start.len(),
        1e3 * seconds
    );
    figure("a step of two views".to_owned(), "s", seconds);
    figure("GPU buffers".to_owned(), "B", gpu.live_bytes() as f64);
    let said = TrainingBytes::at_start(gpu, start.len(), supervision, config);
    if trainer.pair_capacity() == said.n_pairs && said.held() != gpu.live_bytes() {
        return Err(Error::new("the buffers are not what was predicted"));
    }
    let folder = tempfile::tempdir().map_err(|e| Error::new(e.to_string()))?;
    let checkpoints = Checkpoints::new(folder.path().to_owned());
    let mut saved = f64::INFINITY;
    for done in 0..rounds.max(1) {
        let seconds = host::often(|| checkpoints.save(done, &trainer.state(), trainer.buffers()))?;
        saved = saved.min(seconds);
    }
    figure("a checkpoint, written".to_owned(), "s", saved);
    if let Some(bytes) = gspotential::run::peak_host_bytes() {
        figure("host peak".to_owned(), "B", bytes as f64);
    }
    drop(trainer);
    let model = &config.model;
    let camera = &supervision.real[0].camera;
    let view = ViewUniform::new(camera, model.near, model.background);
    let timed = stages::measure(ctx, start, view, rounds)?;
    figure("pairs of a view".to_owned(), "pairs", timed.pairs);
    for (stage, seconds) in timed.stages {
        figure(stage.to_owned(), "s", seconds);
    }
    Ok(())
}

/// Seconds of a step: the least of all rounds.
fn steps(ctx: &Context, trainer: &mut Trainer<'_>, rounds: u32) -> Result<f64> {
    let gpu = &ctx.gpu;
    let mut done = 0;
    while done < N_WARM {
        trainer.step(done, None);
        done = trainer.make_room()?.unwrap_or(done + 1);
    }
    let on_cpu = gpu.info.device_type == wgpu::DeviceType::Cpu;
    let mut profile = if on_cpu { None } else { Profile::new(gpu) };
    let mut least = f64::INFINITY;
    let last = done + rounds.max(1);
    while done < last {
        let mut seconds = of_cpu(|| {
            trainer.step(done, profile.as_mut());
            gpu.wait()
        })?;
        if let Some(profile) = &mut profile {
            seconds = profile.take(gpu)?.values().map(|k| k.seconds).sum();
        }
        if let Some(skipped) = trainer.make_room()? {
            done = skipped;
            continue;
        }
        least = least.min(seconds);
        done += 1;
    }
    Ok(least)
}
