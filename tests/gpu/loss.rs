//! The image losses and their gradient against the reference.

use gspotential::doctor::loss::{Kind, LossCase, MaskKind, examine};
use gspotential::doctor::{Finding, stage};

use gspotential::gpu::Rasterizer;

use super::rig::{assert_findings, context_of};
use super::views::print;

const SIZES: [(usize, usize); 6] = [(1, 1), (7, 5), (33, 17), (64, 48), (5, 70), (131, 2)];

/// Holds `kind` at every size with every rasterizer; prints the largest error of each quantity.
fn hold(kind: Kind, masks: &[Option<MaskKind>]) {
    for rasterizer in Rasterizer::ALL {
        hold_one(rasterizer, kind, masks);
    }
}

fn hold_one(rasterizer: Rasterizer, kind: Kind, masks: &[Option<MaskKind>]) {
    let own = stage::own(rasterizer);
    let mut all: Vec<Finding> = Vec::new();
    for size in SIZES {
        for &mask in masks {
            let found =
                examine(&context_of(rasterizer), &LossCase { size, kind, mask }).expect("computes");
            assert_findings(&found);
            all.extend(found.list);
        }
    }
    for what in ["L1", "SSIM", "gradient"] {
        let errors = all.iter().filter(|f| f.what == what).map(|f| f.error);
        if let Some(largest) = errors.max_by(f64::total_cmp) {
            print(&format!(
                "{rasterizer}, {kind:?}: {what} off by {largest:.1e}\n"
            ));
        }
    }
    let named = match masks {
        [None] => own.loss,
        _ => own.masked_loss,
    };
    assert!(all.iter().all(|finding| finding.stage == named));
}

#[test]
fn losses_match_the_reference_at_odd_sizes() {
    for kind in [Kind::Noise, Kind::Flat, Kind::Equal, Kind::Black] {
        hold(kind, &[None]);
    }
}

#[test]
fn masked_losses_match_the_reference_at_odd_sizes() {
    for kind in [Kind::Noise, Kind::Flat] {
        hold(kind, &MaskKind::ALL.map(Some));
    }
}
