//! This module decides how long training takes.
//!
//! Rates stay as they are until the held-out views have stopped rising; then training settles: all rates fall
//! linearly to nothing over `need.settle_share` of the whole. The length need not be known before for that, as a
//! schedule over a fixed number of iterations asks (Hägele et al. 2024, "Scaling Laws and Compute-Optimal Training Beyond
//! Fixed Training Durations"), and stopping is not cutting a schedule off.
//!
//! The views have stopped rising when the last third of the iterations has raised the best of them by less than
//! `need.least_gain_db`: half as many again would bring less still. All of it follows from the config and the
//! measurements, so that a run that goes on from a checkpoint chooses as the one that was not interrupted.

use super::record::SignalPoint;
use crate::config::Config;

/// Share of the most iterations before which no measurement ends training: while rates are high the views may stand still and
/// rise again, as kitchen's do from 200 to 400 iterations at 320 px, and sharpness goes on rising where they no longer do.
const EARLIEST: f64 = 0.7;

/// The last part of a training, in which rates fall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settling {
    /// Number of iterations before it.
    pub from: u32,
    /// Number of all iterations.
    pub until: u32,
}

impl Settling {
    /// Returns the settling as it is planned after the measurements `signal`: that of `config.iterations`, unless
    /// the config has them end training and they have.
    pub fn of(config: &Config, signal: &[SignalPoint]) -> Settling {
        let (need, most) = (&config.need, config.iterations);
        let share = need.settle_share;
        let latest = most - (share * f64::from(most)).round() as u32;
        let earliest = (EARLIEST * f64::from(most)).ceil() as u32;
        let stopped = |k: &usize| {
            signal[*k].iteration >= earliest && has_stopped(&signal[..=*k], need.least_gain_db)
        };
        let stop = (0..signal.len()).filter(|_| need.ends).find(stopped);
        match stop.map(|k| signal[k].iteration) {
            Some(from) if from < latest => {
                let settling = (f64::from(from) * share / (1.0 - share)).round() as u32;
                Settling {
                    from,
                    until: from.saturating_add(settling).min(most),
                }
            }
            _ => Settling {
                from: latest,
                until: most,
            },
        }
    }

    /// Returns what all rates are multiplied by at `iteration` (from 0).
    pub fn rate(&self, iteration: u32) -> f64 {
        if iteration < self.from {
            return 1.0;
        }
        let left = self.until.saturating_sub(iteration);
        f64::from(left) / f64::from((self.until - self.from).max(1))
    }

    /// Returns after how many iterations Gaussians are pruned that contribute least: when rates begin to fall, and once more
    /// half-way.
    pub fn prunings(&self) -> [u32; 2] {
        [self.from, self.from + (self.until - self.from) / 2]
    }
}

/// Says whether the last third of the iterations has raised the best that was measured of the held-out views by less than
/// `least_gain_db`. The best does not fall with a measurement that happens to be low, as the last may.
fn has_stopped(signal: &[SignalPoint], least_gain_db: f64) -> bool {
    let Some(last) = signal.last() else {
        return false;
    };
    let best = |within: f64| {
        let until = signal.iter().filter(|p| f64::from(p.iteration) <= within);
        until.map(|p| p.held_out).max_by(f64::total_cmp)
    };
    let whole = f64::from(last.iteration);
    let gained = |before: f64| best(whole).map(|best| best - before);
    best(2.0 / 3.0 * whole)
        .and_then(gained)
        .is_some_and(|gain| gain < least_gain_db)
}
