//! The network that finds depth and cameras, held to what its original computes.

mod goldens;
mod images;
mod rays;
mod scene;
mod weights;

use std::path::PathBuf;

use crate::kit::data::shared;

/// A file or folder of the specification's goldens.
fn golden(name: &str) -> PathBuf {
    shared("prior").join(name)
}

/// The largest difference; of the right values where `relative`.
fn worst(ours: &[f32], right: &[f64], relative: bool) -> f64 {
    assert_eq!(ours.len(), right.len());
    let difference = |(a, b): (&f32, &f64)| {
        let difference = (f64::from(*a) - b).abs();
        if relative {
            difference / b.abs()
        } else {
            difference
        }
    };
    // A value that is no number is as wrong as can be.
    let differences = ours.iter().zip(right).map(difference);
    differences
        .map(|d| if d.is_nan() { f64::INFINITY } else { d })
        .fold(0.0, f64::max)
}
