//! The evidence that the f64 reference is right: central differences of its forward against its
//! backward, values worked out by hand, and reference cases from disk.

pub(crate) mod fixture;
pub(crate) mod npy;

mod comparison;
mod depth;
mod fixtures;
mod loss;
mod pose;
mod project;
mod raster;

use gspotential::doctor::twin::compare::{max_abs_off_mask, relative_l2};

/// Fails, naming `what`, where the relative L2 exceeds `tolerance`.
pub(crate) fn assert_relative_l2(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    let difference = relative_l2(a, b);
    assert!(
        difference <= tolerance,
        "{what}: relative L2 {difference:e} > {tolerance:e}"
    );
}

/// Fails, naming `what`, where a pixel off the mask differs by more than `tolerance`.
pub(crate) fn assert_close_off_mask(
    what: &str,
    a: &[f64],
    b: &[f64],
    mask: &[bool],
    tolerance: f64,
) {
    let difference = max_abs_off_mask(a, b, mask);
    assert!(
        difference <= tolerance,
        "{what}: differs by {difference:e} > {tolerance:e}"
    );
}
