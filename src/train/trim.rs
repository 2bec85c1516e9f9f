//! This module prunes by contribution: Gaussians that put next to nothing into the views are removed, the least first, as
//! many as the tolerance allows.
//!
//! The cost of removing some is how far the PSNR of the held-out views falls, measured at once, with the opacity of
//! those that would go set to nothing. The photographs show detail that splats lack, so that what they lose counts, too: their error
//! rises by as much as if it had risen at the held-out views ([`cost`]). Their own PSNR would be no measure: they are learned by
//! heart, far beyond what any other view is shown with. The least share that pays is tried first, then twice as much, until one
//! costs too much: most scenes have little to spare, and an attempt costs as much as a measurement ([`most_that_pays`]).
//!
//! It happens when training begins to settle and, if any could go, once more half-way ([`Settling::prunings`]): what is
//! left of training has fewer Gaussians to render and makes good for the cost, which over both is at most the tolerance.
//!
//! [`Settling::prunings`]: super::length::Settling::prunings

use std::time::Instant;

use super::policy::Plan;
use super::record::{PlanCounts, SignalPoint, Trim};
use super::trainer::Trainer;
use crate::error::Result;
use crate::gaussians::ply::most_in;

/// Greatest share of the Gaussians that one pruning removes.
const MOST_SHARE: f64 = 0.9;

/// A pruning that would remove a smaller share does not pay and is left out.
const LEAST_SHARE: f64 = 0.05;

/// Share of what is left of the tolerance that the last pruning may take where SH degrees are lowered after it.
const LAST_SHARE: f64 = 0.5;

/// A number is found to one in so many of the most that can go: to 6 %.
const PRECISION: usize = 16;

/// Most held-out views at which a cost is measured, evenly over all: before and after are measured at the same ones.
pub(super) const MOST_HELD_OUT: usize = 8;

/// An opacity logit with which a Gaussian is not drawn.
const HIDDEN: f32 = -100.0;

impl Trainer<'_> {
    /// Says whether a pruning follows after `done` iterations: not if the one before left the same Gaussians as they were.
    pub(super) fn trims(&self, done: u32) -> bool {
        let n = self.optimizer.model.n;
        let left_all = |trim: &Trim| trim.n_before == trim.n_after && trim.n_after == n;
        let before = self.trims.last();
        let is_new = before.is_none_or(|trim| trim.iteration < done && !left_all(trim));
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
        let least = (LEAST_SHARE * contributions.len() as f64).ceil() as usize;
        let n = most_that_pays(n_candidates, least, allowed, |n| {
            let point = self.without(&order[..n], &geometry, done)?;
            let cost = cost(&before, &point);
            if cost <= allowed {
                after = point;
            }
            Ok(cost)
        })?;
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

    /// Returns what the pruning after `done` iterations may cost, dB: half of the tolerance; the last one half of what is left if
    /// SH degrees are lowered after it, else all.
    fn allowance(&self, done: u32) -> f64 {
        let [first, last] = self.settling.prunings();
        let is_first = done == first && first != last;
        let lowers = self.config.model.sh_degree > 0;
        match (is_first, lowers) {
            (true, _) => 0.5 * self.config.need.tolerance_db,
            (false, true) => LAST_SHARE * self.left_of_tolerance(),
            (false, false) => self.left_of_tolerance(),
        }
    }

    /// Returns what prunings have left of the tolerance, dB.
    pub(super) fn left_of_tolerance(&self) -> f64 {
        let spent: f64 = self.trims.iter().map(|trim| trim.cost_db.max(0.0)).sum();
        (self.config.need.tolerance_db - spent).max(0.0)
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
        let counts = PlanCounts {
            pruned_contribution: removed.len(),
            ..PlanCounts::default()
        };
        let plan = Plan::of_those_that_stay(&stays, counts);
        self.rearrange(&plan, false, done)
    }
}

/// Returns the cost of a change, dB: how far the PSNR of the held-out views has fallen, or how far it would have fallen had their
/// error risen as the photographs' has, whichever further; below 0 if both errors fell.
pub fn cost(before: &SignalPoint, after: &SignalPoint) -> f64 {
    let held_out = before.held_out - after.held_out;
    match (before.photographs, after.photographs) {
        (Some(sharp), Some(blurred)) => {
            let risen = squared_error(blurred) - squared_error(sharp);
            let share = 1.0 + risen / squared_error(before.held_out);
            // It is below 0 where the photographs were far worse than the held-out views and no longer are.
            held_out.max(10.0 * share.max(f64::MIN_POSITIVE).log10())
        }
        _ => held_out,
    }
}

/// Returns the mean squared error of a PSNR in dB, of values in `[0, 1]`.
fn squared_error(psnr: f64) -> f64 {
    10_f64.powf(-psnr / 10.0)
}

/// Returns the most of `n` that can go at a cost of at most `allowed`, where the cost rises with their number, by halving an interval;
/// what is returned is 0 or has been tried.
///
/// # Errors
/// What `cost` returns.
pub fn most(n: usize, allowed: f64, cost: impl FnMut(usize) -> Result<f64>) -> Result<usize> {
    let high = (MOST_SHARE * n as f64) as usize;
    halved(0, high, high / PRECISION, allowed, cost)
}

/// Returns the most of `n`, `least` or more of them, that can go at a cost of at most `allowed`, where the cost rises with their number;
/// 0 if `least` cannot. `least` is tried first, then twice as many as before, until a number costs too much; then the interval is
/// halved as far as [`most`] does it.
///
/// # Errors
/// What `cost` returns.
pub fn most_that_pays(
    n: usize,
    least: usize,
    allowed: f64,
    mut cost: impl FnMut(usize) -> Result<f64>,
) -> Result<usize> {
    let most = (MOST_SHARE * n as f64) as usize;
    let (mut low, mut high, mut next) = (0, most, least.max(1));
    if next > most {
        return Ok(0);
    }
    while low < high {
        match cost(next)? <= allowed {
            true => low = next,
            false => {
                high = next - 1;
                break;
            }
        }
        next = (2 * next).min(high);
    }
    if low == 0 {
        return Ok(0);
    }
    halved(low, high, most / PRECISION, allowed, cost)
}

/// Halves the interval from `low`, which is 0 or has been tried, to `high` until it is no wider than `width`, and returns its lower end.
fn halved(
    mut low: usize,
    mut high: usize,
    width: usize,
    allowed: f64,
    mut cost: impl FnMut(usize) -> Result<f64>,
) -> Result<usize> {
    while high - low > width {
        // The least that is not known to be possible lies in between.
        let middle = (low + high).div_ceil(2);
        match cost(middle)? <= allowed {
            true => low = middle,
            false => high = middle - 1,
        }
    }
    Ok(low)
}
