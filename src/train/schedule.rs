//! The schedule says what an iteration does, as a function of its number and the seed alone: a step
//! can be repeated.

use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::config::{Config, OptimizerConfig};
use crate::gpu::constants::LEVEL_MAX;

/// Random streams of the view orders, apart from those of other consumers of the seed.
const REAL_STREAM: u64 = 0x7265_616c;
const VIRTUAL_STREAM: u64 = 0x7669_7274;

/// Random stream of the dropout's keys.
const DROPOUT_STREAM: u64 = 0x6472_6f70;

/// Random stream of the background's colours.
const BACKGROUND_STREAM: u64 = 0x6267_7264;

/// Makes the dropout's key of a second set of Gaussians.
const OTHER_KEY: u32 = 0x9e37_79b9;

/// Draws views without replacement, epoch by epoch, as 3DGS does.
pub struct ViewOrder {
    seed: u64,
    stream: u64,
    epoch: Option<u32>,
    order: Vec<usize>,
}

impl ViewOrder {
    /// Makes the order in which `n` real views are trained on.
    pub fn real(seed: u64, n: usize) -> ViewOrder {
        ViewOrder {
            seed,
            stream: REAL_STREAM,
            epoch: None,
            order: (0..n).collect(),
        }
    }

    /// Makes the order in which `n` virtual views are trained on.
    pub fn virtual_views(seed: u64, n: usize) -> ViewOrder {
        ViewOrder {
            stream: VIRTUAL_STREAM,
            ..Self::real(seed, n)
        }
    }

    /// Returns the view of iteration `iteration` (from 0); `None` where there are no views.
    pub fn view(&mut self, iteration: u32) -> Option<usize> {
        let n = u32::try_from(self.order.len()).ok().filter(|&n| n > 0)?;
        let epoch = iteration / n;
        if self.epoch != Some(epoch) {
            let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
            rng.set_stream(self.stream << 32 | u64::from(epoch));
            self.order.sort_unstable();
            self.order.shuffle(&mut rng);
            self.epoch = Some(epoch);
        }
        self.order.get((iteration % n) as usize).copied()
    }
}

/// Returns the position learning rate at `iteration` (from 0) of `iterations`: log-linear from
/// start to end, times `extent` (3DGS).
pub fn mean_rate(config: &OptimizerConfig, iteration: u32, iterations: u32, extent: f64) -> f64 {
    let t = f64::from(iteration) / f64::from(iterations.max(1));
    let log = config.mean_lr_start.ln() * (1.0 - t) + config.mean_lr_end.ln() * t;
    log.exp() * extent
}

/// Returns the active SH degree at `iteration` (from 0).
pub fn sh_degree(config: &Config, iteration: u32) -> u32 {
    (iteration / config.model.sh_interval.max(1)).min(config.model.sh_degree)
}

/// An iteration's dropout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dropout {
    /// Probability with which a Gaussian is left out.
    pub rate: f64,
    /// Decides which ones.
    pub key: u32,
}

impl Dropout {
    /// Returns the same dropout for a second set of Gaussians, which others are left out of.
    pub fn of_other(self) -> Dropout {
        Dropout {
            key: self.key ^ OTHER_KEY,
            ..self
        }
    }
}

/// Returns the colour behind the Gaussians at `iteration` (from 0), RGB in multiples of 1/255, where it is a random one.
pub fn background(config: &Config, iteration: u32) -> Option<[f64; 3]> {
    config.loss.random_background.then(|| {
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        rng.set_stream(BACKGROUND_STREAM << 32 | u64::from(iteration));
        [(); 3].map(|()| f64::from(rng.next_u32() >> 24) / LEVEL_MAX)
    })
}

/// Returns the dropout at `iteration` (from 0): `p` goes from `rate_start` to `rate_end` as
/// `iteration / iterations` does from 0 to 1 (DropGaussian from 0; D2GS).
pub fn dropout(config: &Config, iteration: u32) -> Dropout {
    let progress = f64::from(iteration) / f64::from(config.iterations.max(1));
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    rng.set_stream(DROPOUT_STREAM << 32 | u64::from(iteration));
    let (start, end) = (config.dropout.rate_start, config.dropout.rate_end);
    Dropout {
        rate: start + (end - start) * progress,
        key: rng.next_u32(),
    }
}

/// Returns whether densification follows after `done` iterations (3DGS).
pub fn densifies(config: &Config, done: u32) -> bool {
    let densify = &config.densify;
    densify.enabled
        && done > densify.start
        && done < densify.end
        && due(config, done, densify.interval)
}

/// Returns whether the set or its opacities change after `done` iterations.
pub fn changes(config: &Config, done: u32) -> bool {
    densifies(config, done)
        || prunes_by_coverage(config, done)
        || resets_opacity(config, done)
        || removes_outliers(config, done)
        || prunes_floaters(config, done)
}

/// Returns whether coverage-aware pruning follows after `done` iterations.
pub fn prunes_by_coverage(config: &Config, done: u32) -> bool {
    let coverage = &config.coverage;
    coverage.prune && done >= coverage.start && due(config, done, coverage.interval)
}

/// Returns whether the opacities are reset after `done` iterations (3DGS).
pub fn resets_opacity(config: &Config, done: u32) -> bool {
    let densify = &config.densify;
    densify.enabled
        && done < densify.end
        && done <= densify.opacity_reset_end
        && due(config, done, densify.opacity_reset_interval)
}

/// Returns whether Gaussians that lie apart are removed after `done` iterations (GaussianObject).
pub fn removes_outliers(config: &Config, done: u32) -> bool {
    let densify = &config.densify;
    let is_due = |interval| due(config, done, interval);
    densify.enabled && done < densify.end && densify.outlier_interval.is_some_and(is_due)
}

/// Returns whether the densification after `done` iterations unpools (FSGS).
pub fn unpools(config: &Config, done: u32) -> bool {
    densifies(config, done) && config.unpool.until.is_some_and(|until| done < until)
}

/// Returns whether floaters are pruned after `done` iterations (SparseGS).
pub fn prunes_floaters(config: &Config, done: u32) -> bool {
    ever_prunes_floaters(config) && config.floaters.after == Some(done)
}

/// Returns whether floaters are pruned at all; nothing changes after the last iteration.
pub fn ever_prunes_floaters(config: &Config) -> bool {
    let after = config.floaters.after;
    after.is_some_and(|after| after < config.iterations)
}

/// Returns whether a change of the set that comes every `interval` iterations follows after `done`.
/// None follows the last iteration: no step would train what it leaves, and 3DGS saves before it.
pub(super) fn due(config: &Config, done: u32, interval: u32) -> bool {
    interval > 0 && done > 0 && done < config.iterations && done.is_multiple_of(interval)
}
