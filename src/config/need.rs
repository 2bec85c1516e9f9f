//! This module has the keys of what is chosen for a scene.

use super::declare::{any, at_least, from_below, positive, section, within, zero_or};

/// Time of training with its decisions, in times of its iterations alone, at most.
const DECIDING: f64 = 1.15;

section! {
    /// What is chosen for the scene while it trains, by virtual views that are held out.
    struct NeedConfig {
        /// One in so many virtual views is held out: it is not trained on, and measures how training
        /// goes; 0: none is.
        hold_out: usize = 0, zero_or(2.0, 1e6);
        /// Iterations between two measurements at the held-out views; past ten times as many, a tenth of those
        /// done.
        interval: u32 = 100, within(1.0, 1e8).unit("iterations");
        /// Training ends when the held-out views have stopped rising; `iterations` are then the most.
        ends: bool = false, any();
        /// Training that may end has room for so many iterations a photograph, where they are more than `iterations`: more
        /// photographs take longer to learn; 0: `iterations` alone.
        iterations_a_photograph: u32 = 0, zero_or(1.0, 1e8).unit("iterations");
        /// They have stopped when the last third of the iterations has raised their best PSNR by less than this, dB, and half of `iterations` are done.
        least_gain_db: f64 = 0.05, at_least(0.0);
        /// Share of all iterations, the last, in which all learning rates fall to nothing.
        settle_share: f64 = 0.0, from_below(0.0, 1.0);
        /// Prunes the Gaussians that contribute least, when the learning rates begin to fall and, if any could go, once more half-way.
        prune: bool = false, any();
        /// What pruning may cost in all, dB of the held-out views; a rise of the photographs' error counts as one of theirs.
        tolerance_db: f64 = 0.05, at_least(0.0);
        /// The trained file takes at most this, MB of 10^6 bytes: Gaussians that contribute least go with that
        /// pruning until it does, whatever they cost; null: whatever there is.
        max_mb: Option<f64> = None, positive().unit("MB");
        /// Training takes at most about so many seconds: `iterations` are as many as `iteration_s` has fit; null:
        /// however long it takes.
        max_s: Option<f64> = None, positive().unit("s");
        /// Seconds of an iteration for `max_s`; null: measured once before training and noted here in the run's
        /// `config.json`, from which the run can be repeated.
        iteration_s: Option<f64> = None, positive().unit("s");
    }
}

impl NeedConfig {
    /// Returns the most iterations that `max_s` has time for, what decides included; `None` where it is not known or not bounded.
    pub fn most_iterations(&self) -> Option<u32> {
        let each = DECIDING * self.iteration_s?;
        Some((self.max_s? / each).max(1.0) as u32)
    }

    /// Says whether anything is chosen.
    pub fn chooses(&self) -> bool {
        self.ends || self.prunes()
    }

    /// Says whether Gaussians are pruned by contribution.
    pub fn prunes(&self) -> bool {
        self.prune || self.max_mb.is_some()
    }

    /// Bytes that the trained file may take; `None`: as many as there are.
    pub fn most_bytes(&self) -> Option<usize> {
        self.max_mb.map(|mb| (1e6 * mb) as usize)
    }
}
