//! Unpooling has its keys here.

use super::declare::{positive, section, within};

/// The most that a `u32` holds.
const U32: f64 = u32::MAX as f64;

section! {
    /// Unpooling: new Gaussians half-way between a large one and its three nearest others, where these are far away (FSGS, Zhu et
    /// al. 2024). A part of densification.
    struct UnpoolConfig {
        /// Densifications before this iteration unpool; null: none does.
        until: Option<u32> = None, within(1.0, U32).unit("iterations");
        /// A Gaussian unpools if the mean distance to its three nearest others is above this.
        distance: f64 = 5.0, positive().unit("camera extents");
        /// Only those unpool whose greatest scale is above this, too.
        scale: f64 = 1.0, positive().unit("camera extents");
    }
}
