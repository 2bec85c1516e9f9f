//! This module lowers the SH degree of Gaussians whose higher coefficients show in no view.
//!
//! What a Gaussian's bands from a degree on put into the views is about their energy times its contribution. Those with the
//! least go first, as many as what is left of the tolerance allows, at the price of pruning ([`cost`]). It
//! happens after the last iteration: coefficients that are 0 would be learned again. Files of fixed size gain where the highest degree
//! falls for all, compressed ones with each.

use std::time::Instant;

use super::record::Lowering;
use super::trainer::Trainer;
use super::trim::{MOST_HELD_OUT, cost, most};
use crate::error::Result;
use crate::gaussians::Gaussians;

/// Bands of a Gaussian from a degree on.
#[derive(Clone, Copy)]
struct Bands {
    gaussian: usize,
    /// The lowest of them; those below stay.
    from: u32,
    /// Their energy times the Gaussian's contribution.
    shown: f64,
}

impl Trainer<'_> {
    /// Lowers SH degrees after the last iteration, number `done`, as far as what is left of the tolerance allows; `None` where there is no degree
    /// to lower or nothing that measures the cost.
    ///
    /// # Errors
    /// A view that the adapter cannot hold, or a GPU fault.
    pub(super) fn lower(&mut self, done: u32) -> Result<Option<Lowering>> {
        let degree = self.sh_degree(done.saturating_sub(1));
        if !self.config.need.prune || self.held_out.is_empty() || degree == 0 {
            return Ok(None);
        }
        let clock = Instant::now();
        let whole = self.optimizer.model.download(self.gpu)?;
        let order = least_first(&whole, &self.contributions(done)?);
        let before = self.point(done, MOST_HELD_OUT)?;
        let allowed_db = self.left_of_tolerance();
        let (mut lowered, mut cost_db) = (whole.clone(), 0.0);
        most(order.len(), allowed_db, |n| {
            let tried = without(&whole, &order[..n]);
            self.optimizer.model.write_sh(self.gpu, &tried);
            let cost = cost(&before, &self.point(done, MOST_HELD_OUT)?);
            if cost <= allowed_db {
                (lowered, cost_db) = (tried, cost);
            }
            Ok(cost)
        })?;
        self.optimizer.model.write_sh(self.gpu, &lowered);
        self.seconds.signal += clock.elapsed().as_secs_f64();
        Ok(Some(Lowering {
            of_degree: n_of_degree(&lowered),
            allowed_db,
            cost_db,
        }))
    }
}

/// Lists the bands of all Gaussians that have any above degree 0, those that show least first; a Gaussian's higher ones come before its
/// lower ones.
fn least_first(gaussians: &Gaussians, contributions: &[f64]) -> Vec<Bands> {
    let n_sh = 3 * gaussians.n_sh();
    let mut order = Vec::new();
    for (gaussian, sh) in gaussians.sh.chunks_exact(n_sh).enumerate() {
        for from in (1..=gaussians.sh_degree).rev() {
            let bands = &sh[first_of(from)..];
            let energy: f64 = bands.iter().map(|c| f64::from(*c).powi(2)).sum();
            if energy > 0.0 {
                let shown = energy * contributions[gaussian];
                order.push(Bands {
                    gaussian,
                    from,
                    shown,
                });
            }
        }
    }
    // Stable: of equals the higher bands stay first.
    order.sort_by(|a, b| a.shown.total_cmp(&b.shown));
    order
}

/// Returns the Gaussians without `bands`.
fn without(gaussians: &Gaussians, bands: &[Bands]) -> Gaussians {
    let mut left = gaussians.clone();
    let n_sh = 3 * gaussians.n_sh();
    for band in bands {
        left.sh[band.gaussian * n_sh..][first_of(band.from)..n_sh].fill(0.0);
    }
    left
}

/// Returns how many Gaussians have each SH degree, from 0 on: that of the highest band with a coefficient.
fn n_of_degree(gaussians: &Gaussians) -> [usize; 4] {
    let n_sh = 3 * gaussians.n_sh();
    let mut n = [0; 4];
    for sh in gaussians.sh.chunks_exact(n_sh) {
        let has = |degree: &u32| sh[first_of(*degree)..].iter().any(|c| *c != 0.0);
        let degree = (1..=gaussians.sh_degree).rev().find(has);
        n[degree.unwrap_or(0) as usize] += 1;
    }
    n
}

/// Returns the first float of a band among a Gaussian's.
fn first_of(degree: u32) -> usize {
    3 * (degree as usize).pow(2)
}
