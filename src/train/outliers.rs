//! This module removes Gaussians that lie apart from all others, as GaussianObject (Yang et al. 2024) does.
//!
//! What counts are the squared distances of every Gaussian to its `sqrt(N)` nearest, its own of 0 among them. One whose mean lies `lambda`
//! standard deviations, of all those distances, above their mean goes. `lambda` rises from 1, where densification begins, to
//! 2.33, where it ends: beyond that lies a hundredth of a normal distribution. Gaussians of the far shell neither go nor count.

use glam::Vec3;

use super::policy::Plan;
use super::record::PlanCounts;
use super::trainer::Trainer;
use crate::config::Config;
use crate::error::Result;
use crate::gaussians::mean_over_nearest;
use crate::gpu::shader_count;

/// `lambda` where densification begins.
const FIRST_LAMBDA: f64 = 1.0;
/// `lambda` where it ends: the normal distribution's quantile of 0.99.
const LAST_LAMBDA: f64 = 2.326_347_874_040_841;

/// Returns the `lambda` after `done` iterations.
pub fn lambda(config: &Config, done: u32) -> f64 {
    let densify = &config.densify;
    let [first, last, at] = [densify.start, densify.end, done].map(f64::from);
    let progress = (at - first) / (last - first).max(1.0);
    FIRST_LAMBDA + (LAST_LAMBDA - FIRST_LAMBDA) * progress
}

/// Returns which of these centres lie apart from the others.
pub fn outliers(means: &[Vec3], lambda: f64) -> Vec<bool> {
    let n = means.len();
    // The own distance is the first, and 0.
    let n_near = (n as f64).sqrt() as usize;
    let others = n_near.saturating_sub(1);
    if others == 0 {
        return vec![false; n];
    }
    let of_all = |of: fn(f64) -> f64| -> Vec<f64> {
        let means = mean_over_nearest(means, others, of).into_iter();
        let share = others as f64 / n_near as f64;
        means.map(|mean| share * mean.unwrap_or(0.0)).collect()
    };
    let distances = of_all(|squared| squared);
    let squares = of_all(|squared| squared * squared);
    let mean = distances.iter().sum::<f64>() / n as f64;
    let mean_square = squares.iter().sum::<f64>() / n as f64;
    let count = (n * n_near) as f64;
    let variance = (mean_square - mean * mean).max(0.0) * count / (count - 1.0);
    let most = mean + lambda * variance.sqrt();
    // None lies apart if all distances are alike.
    let is_apart = |d: &f64| *d >= most && *d > mean;
    distances.iter().map(is_apart).collect()
}

impl Trainer<'_> {
    /// Removes the outliers after `done` iterations.
    ///
    /// # Errors
    /// A GPU fault.
    pub(super) fn remove_outliers(&mut self, done: u32) -> Result<()> {
        let means = self.optimizer.model.means(self.gpu)?;
        let frozen_beyond = self.supervision.frozen_beyond();
        let scene = |i: &usize| means[*i].length() <= frozen_beyond;
        let scene: Vec<usize> = (0..means.len()).filter(scene).collect();
        let centers: Vec<Vec3> = scene.iter().map(|i| means[*i]).collect();
        let mut goes = vec![false; means.len()];
        for (i, apart) in scene
            .iter()
            .zip(outliers(&centers, lambda(self.config, done)))
        {
            goes[*i] = apart;
        }
        let kept = (0..means.len()).filter(|i| !goes[*i]);
        let sources: Vec<u32> = kept.map(shader_count).collect();
        let n_gone = means.len() - sources.len();
        if n_gone == 0 {
            return Ok(());
        }
        let plan = Plan {
            changes: vec![[0.0; 4]; sources.len()],
            sources,
            counts: PlanCounts {
                pruned_outliers: n_gone,
                ..PlanCounts::default()
            },
        };
        self.rearrange(&plan, false, done)
    }
}
