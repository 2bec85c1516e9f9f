//! This module times the first iterations, for what a run will take.

use std::time::Instant;

use super::Prepared;
use crate::config::Config;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::render::Kernels;
use crate::train::Trainer;

/// Iterations that warm up kernels and buffers, and iterations that are timed.
const N_WARM: u32 = 4;
const N_TIMED: u32 = 8;

/// Fewest iterations that make a scene of a start.
const FEW: u32 = 200;

/// Seconds of an iteration at the start of training, which is left as it is.
///
/// # Errors
/// What training refuses.
pub(super) fn iteration_s(gpu: &Gpu, prepared: &Prepared, config: &Config) -> Result<f64> {
    let kernels = Kernels::of(&config.render, gpu)?;
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let mut trainer = Trainer::new(gpu, &kernels, start, supervision, config)?;
    let mut run = |from: u32, n: u32| -> Result<f64> {
        let begin = Instant::now();
        for iteration in from..from + n {
            trainer.step(iteration, None);
        }
        // Steps that overflowed are taken again, with room, as training does.
        while trainer.make_room()?.is_some() {
            trainer.step(from, None);
        }
        gpu.wait()?;
        Ok(begin.elapsed().as_secs_f64())
    };
    run(0, N_WARM)?;
    Ok(run(N_WARM, N_TIMED)? / f64::from(N_TIMED))
}

/// Returns the config with the time of an iteration where it asks for a time of training and does not have it, measured now.
///
/// # Errors
/// What training refuses.
pub(super) fn calibrated(gpu: &Gpu, prepared: &Prepared, config: &Config) -> Result<Config> {
    let mut config = config.clone();
    if let (Some(max_s), None) = (config.need.max_s, config.need.iteration_s) {
        let seconds = iteration_s(gpu, prepared, &config)?;
        // A timer that saw nothing pass would leave no bound.
        config.need.iteration_s = Some(seconds.max(1e-6));
        log::info!(
            "an iteration takes {seconds:.4} s (need.iteration_s), so that {max_s} s have time for at most {}",
            config.need.most_iterations().unwrap_or(config.iterations)
        );
    }
    if let Some(most) = config.need.most_iterations().filter(|most| *most < FEW) {
        log::warn!(
            "the budget has time for {most} iterations, and the scene needs more: start from fewer Gaussians \
             (--gaussians) or scale images down (--max-size)"
        );
    }
    Ok(config)
}

/// Returns the config with the most iterations that so many photographs may take, and no more than there is time for.
pub(super) fn with_most_iterations(mut config: Config, n_photographs: usize) -> Config {
    if config.need.ends {
        let n = u32::try_from(n_photographs).unwrap_or(u32::MAX);
        let all = config.need.iterations_a_photograph.saturating_mul(n);
        config.iterations = config.iterations.max(all);
    }
    if let Some(most) = config.need.most_iterations() {
        config.iterations = config.iterations.min(most);
    }
    config
}
