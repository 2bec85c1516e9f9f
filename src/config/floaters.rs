//! The pruning of floaters has its keys here.

use super::declare::{at_least, section, within};

/// The most that a `u32` holds.
const U32: f64 = u32::MAX as f64;

section! {
    /// Pruning of floaters: Gaussians before the surface that a training view shows behind them (SparseGS, Xiong et al. 2023).
    struct FloatersConfig {
        /// Floaters go once, after this iteration; null: they stay.
        after: Option<u32> = None, within(1.0, U32).unit("iterations");
        /// Share of a training view's pixels that keep what they show, of those whose heaviest Gaussian lies before the mean depth,
        /// if depths have one mode; 1: all do.
        share: f64 = 0.98, within(0.0, 1.0);
        /// The share is multiplied by `exp(-falloff dip)`, and is 0.8 at the least; Hartigan's dip, in the mean over the training views, is the
        /// larger the more the pixels fall apart into two kinds.
        falloff: f64 = 7.5, at_least(0.0);
    }
}
