//! One iteration at a size that no sweep reaches.

use gspotential::error::{Error, Result};
use gspotential::gpu::Gpu;
use gspotential::pipeline::{Prepared, prepare};
use gspotential::render::{Kernels, rasterizer_for};
use gspotential::run::{Seconds, peak_host_bytes};
use gspotential::train::{TrainingBytes, train};

use super::clock::{of_cpu, unit};
use super::{Args, cloud, step};

/// Gaussians of the start.
const N_GAUSSIANS: usize = 1_000_000;

/// Bytes of a MiB.
const MIB: f64 = (1 << 20) as f64;

/// Trains the built-in scene with a million Gaussians for one iteration, of a photograph and a virtual view, with the
/// rasterizer that the rule takes, and prints what it took beside what was predicted.
///
/// # Errors
/// The adapter cannot hold it, or the iteration leaves a number that is none, or everything as it was.
pub(crate) fn train_once(args: &Args) -> Result<()> {
    let gpu = Gpu::open()?;
    let mut config = step::config(N_GAUSSIANS, args.sh_degree)?;
    config.scene.max_size_px = Some(args.widest);
    config.iterations = 1;
    let scene = cloud::scene(&config, args.widest, N_GAUSSIANS)?;
    let image = &scene.train[0].image;
    let pixels = image.width as usize * image.height as usize;
    let rasterizer = rasterizer_for(config.render.rasterizer, &gpu, N_GAUSSIANS, pixels);
    config.render.rasterizer = rasterizer.choice();
    let kernels = Kernels::of(&config.render, &gpu)?;
    let prepared = prepare(&scene, &config, &mut Seconds::default())?;
    let Prepared {
        supervision, start, ..
    } = &prepared;
    let said = TrainingBytes::at_start(&gpu, start.len(), supervision, &config);
    let mut trained = None;
    let seconds = of_cpu(|| {
        trained = Some(train(&gpu, &kernels, start, supervision, &config, &mut ())?);
        Ok(())
    })?;
    let trained = trained.ok_or_else(|| Error::new("nothing was trained"))?;
    let means = &trained.gaussians.means;
    if !means.iter().all(|mean| mean.is_finite()) {
        return Err(Error::new("a position is no number"));
    }
    let moved = means.iter().zip(&start.means).filter(|(a, b)| a != b);
    let n_moved = moved.count();
    if n_moved == 0 {
        return Err(Error::new("the iteration has moved nothing"));
    }
    println!(
        "{}: {} Gaussians of degree {} at {}x{}, rasterizer {rasterizer}: an iteration took {seconds:.1} s ({}), {n_moved} of \
         them moved, loss {:.4}",
        gpu.describe(),
        start.len(),
        args.sh_degree,
        image.width,
        image.height,
        unit(),
        trained
            .samples
            .last()
            .map_or(f64::NAN, |sample| sample.loss),
    );
    println!(
        "GPU buffers: {:.0} MiB predicted at the start, {:.0} MiB at most; process: {:.0} MiB at most",
        said.held() as f64 / MIB,
        gpu.peak_bytes() as f64 / MIB,
        peak_host_bytes().map_or(f64::NAN, |bytes| bytes as f64 / MIB),
    );
    Ok(())
}
