//! The network that finds depth and cameras, held to what its original computes.

mod goldens;
mod images;
mod scene;
mod weights;

use std::path::{Path, PathBuf};

/// A file or folder of the specification's goldens, where they lie beside the repository.
fn golden(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/prior");
    if root.is_dir() {
        return Some(root.join(name));
    }
    eprintln!("not checked: there are no goldens at {}", root.display());
    None
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
