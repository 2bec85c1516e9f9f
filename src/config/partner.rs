//! A second set of Gaussians has its keys here.

use super::declare::{any, at_least, positive, section, within};

/// The most that a `u32` holds.
const U32: f64 = u32::MAX as f64;

section! {
    /// A second set of Gaussians that is trained beside the first, from the same points and photographs (CoR-GS, Zhang et al.
    /// 2024). They are seldom right in what they disagree about, so that each learns from the other, too. The file has the first.
    /// Without densification or dropout the two stay alike.
    struct PartnerConfig {
        /// Trains a second set, in twice the time and memory. Virtual views, refined poses and guided dropout do not go with it.
        enabled: bool = false, any();
        /// Iterations before this one have photographs alone. Those after it have a pseudo view each, from an ellipse through the training
        /// cameras, in which each set has the other's render as its target.
        start: u32 = 500, any().unit("iterations");
        /// Weight of the pseudo view's loss.
        weight: f64 = 1.0, at_least(0.0);
        /// Gaussians that stand apart are pruned every so many iterations, once pseudo views have started.
        prune_interval: u32 = 500, within(1.0, U32).unit("iterations");
        /// A Gaussian stands apart if none of the other set lies within this distance.
        prune_distance: f64 = 4.0, positive().unit("R");
    }
}
