//! This module prunes by contribution: Gaussians that put next to nothing into the views are removed, the least first, as
//! many as the tolerance allows.
//!
//! The cost of removing some is how far the PSNR of the held-out views or of the photographs falls, whichever falls
//! further, measured at once, with the opacity of those that would go set to nothing. The number is found by
//! halving an interval. It happens when training begins to settle and once more half-way ([`Settling::prunings`]): what is
//! left of training has fewer Gaussians to render and makes good for the cost, which over both is at most the tolerance.
//!
//! [`Settling::prunings`]: super::length::Settling::prunings

use std::time::Instant;

use super::policy::Plan;
use super::record::{PlanCounts, SignalPoint, Trim};
use super::trainer::Trainer;
use crate::error::Result;
use crate::gaussians::ply::most_in;
use crate::gpu::shader_count;

/// Greatest share of the Gaussians that one pruning removes.
const MOST_SHARE: f64 = 0.9;

/// A pruning that would remove a smaller share does not pay and is left out.
const LEAST_SHARE: f64 = 0.05;

/// Halvings of the interval: the share is found to 3 %.
const N_PROBES: u32 = 5;

/// Most held-out views at which a cost is measured, evenly over all: before and after are measured at the same ones.
const MOST_HELD_OUT: usize = 12;

/// An opacity logit with which a Gaussian is not drawn.
const HIDDEN: f32 = -100.0;

impl Trainer<'_> {
    /// Says whether a pruning follows after `done` iterations.
    pub(super) fn trims(&self, done: u32) -> bool {
        let is_new = self.trims.last().is_none_or(|trim| trim.iteration < done);
        let is_due = self.settling.prunings().contains(&done);
        self.config.need.prunes() && !self.held_out.is_empty() && is_new && is_due
    }

    /// Prunes after `done` iterations, at which the held-out views have been measured.
    ///
    /// # Errors
    /// A view that the adapter cannot hold, or a GPU fault.
    pub(super) fn trim(&mut self, done: u32) -> Result<()> {
        let clock = Instant::now();
        let allowed = self.allowance(done);
        let contributions = self.contributions(done)?;
        let geometry: Vec<[f32; 4]> =
            self.optimizer.model.blocks[0].read(self.gpu, contributions.len())?;
        let order = self.least_first(&contributions, &geometry);
        let before = self.point(done, MOST_HELD_OUT)?;
        let mut after = before;
        // Only a size that is asked for prunes without the tolerance.
        let n_candidates = if self.config.need.prune {
            order.len()
        } else {
            0
        };
        let n = most(n_candidates, allowed, |n| {
            let point = self.without(&order[..n], &geometry, done)?;
            let cost = cost(&before, &point);
            if cost <= allowed {
                after = point;
            }
            Ok(cost)
        })?;
        let pays = n as f64 >= LEAST_SHARE * contributions.len() as f64;
        let n = if pays { n } else { 0 };
        let over_budget = self.surplus(done).saturating_sub(n).min(order.len() - n);
        let removed = &order[..n + over_budget];
        let after = match (over_budget, n) {
            (0, 0) => before,
            (0, _) => after,
            _ => self.without(removed, &geometry, done)?,
        };
        let total: f64 = contributions.iter().sum();
        let gone: f64 = removed.iter().map(|&i| contributions[i]).sum();
        self.trims.push(Trim {
            iteration: done,
            n_before: contributions.len(),
            n_after: contributions.len() - removed.len(),
            allowed_db: allowed,
            over_budget,
            cost_db: cost(&before, &after),
            contribution: if total > 0.0 { gone / total } else { 0.0 },
        });
        if !removed.is_empty() {
            self.remove(removed, done)?;
        }
        self.seconds.signal += clock.elapsed().as_secs_f64();
        Ok(())
    }

    /// Returns what the pruning after `done` iterations may cost, dB: half of the tolerance, the last one all that is left of it.
    fn allowance(&self, done: u32) -> f64 {
        let tolerance = self.config.need.tolerance_db;
        let spent: f64 = self.trims.iter().map(|trim| trim.cost_db.max(0.0)).sum();
        let [first, last] = self.settling.prunings();
        match done == first && first != last {
            true => 0.5 * tolerance,
            false => (tolerance - spent).max(0.0),
        }
    }

    /// Returns how many Gaussians there are more than the file may have, with the SH degree that training has reached.
    fn surplus(&self, done: u32) -> usize {
        let degree = self.sh_degree(done.saturating_sub(1));
        let bytes = self.config.need.most_bytes();
        let most = bytes.map(|bytes| most_in(bytes, degree));
        most.map_or(0, |most| self.optimizer.model.n.saturating_sub(most))
    }

    /// Gaussians in the order of their contribution, the least first; those of the far shell stay and are not among them.
    fn least_first(&self, contributions: &[f64], geometry: &[[f32; 4]]) -> Vec<usize> {
        let frozen_beyond = self.supervision.frozen_beyond();
        let is_scene = |i: &usize| {
            let [x, y, z, _] = geometry[*i];
            glam::Vec3::new(x, y, z).length() <= frozen_beyond
        };
        let mut order: Vec<usize> = (0..contributions.len()).filter(is_scene).collect();
        order.sort_by(|&a, &b| {
            contributions[a]
                .total_cmp(&contributions[b])
                .then(a.cmp(&b))
        });
        order
    }

    /// Returns what would be measured without the Gaussians `hidden`; `geometry` is the first plane of all.
    fn without(
        &mut self,
        hidden: &[usize],
        geometry: &[[f32; 4]],
        done: u32,
    ) -> Result<SignalPoint> {
        let mut altered = geometry.to_vec();
        for &i in hidden {
            altered[i][3] = HIDDEN;
        }
        self.optimizer.model.blocks[0].write(self.gpu, &altered);
        let point = self.point(done, MOST_HELD_OUT);
        self.optimizer.model.blocks[0].write(self.gpu, geometry);
        point
    }

    /// Removes Gaussians with all that the optimizer remembers of them.
    fn remove(&mut self, removed: &[usize], done: u32) -> Result<()> {
        let mut stays = vec![true; self.optimizer.model.n];
        for &i in removed {
            stays[i] = false;
        }
        let sources: Vec<u32> = (0..stays.len())
            .filter(|&i| stays[i])
            .map(shader_count)
            .collect();
        let plan = Plan {
            changes: vec![[0.0; 4]; sources.len()],
            sources,
            counts: PlanCounts {
                pruned_contribution: removed.len(),
                ..PlanCounts::default()
            },
        };
        self.rearrange(&plan, false, done)
    }
}

/// Returns how far the PSNR of the held-out views or that of the photographs has fallen, dB, whichever further; below 0 if both rose.
fn cost(before: &SignalPoint, after: &SignalPoint) -> f64 {
    let held_out = before.held_out - after.held_out;
    match (before.photographs, after.photographs) {
        (Some(before), Some(after)) => held_out.max(before - after),
        _ => held_out,
    }
}

/// Returns the most of `n` that can go at a cost of at most `allowed`, where the cost rises with their number, by halving an interval;
/// what is returned is 0 or has been tried.
///
/// # Errors
/// What `cost` returns.
pub fn most(n: usize, allowed: f64, mut cost: impl FnMut(usize) -> Result<f64>) -> Result<usize> {
    let (mut low, mut high) = (0, (MOST_SHARE * n as f64) as usize);
    for _ in 0..N_PROBES {
        // The least that is not known to be possible lies in between.
        let middle = (low + high).div_ceil(2);
        if middle <= low {
            break;
        }
        match cost(middle)? <= allowed {
            true => low = middle,
            false => high = middle - 1,
        }
    }
    Ok(low)
}
