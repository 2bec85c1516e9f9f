//! The GPU against the reference cases on disk.

use super::render::{Truth, hold_view, print, row, table_head};
use super::rig::context;
use crate::reference::fixture::fixtures;
use gspotential::reference::tolerance;

#[test]
fn reference_cases_are_met_in_image_and_gradient() {
    let mut table = table_head();
    for fixture in fixtures() {
        let needles = fixture.name.starts_with("needle");
        let tolerances = if needles {
            tolerance::GPU_REFERENCE_NEEDLE
        } else {
            tolerance::GPU_REFERENCE
        };
        for index in 0..fixture.n_views() {
            let view = fixture.view(index);
            let truth = Truth {
                rgb: &view.rgb,
                alpha: &view.alpha,
                fragile: &view.fragile,
                d_rgb: &view.d_rgb,
                d_alpha: &view.d_alpha,
                classes: view.gradients.classes(),
            };
            let name = format!("{} {index}", fixture.name);
            let (gaussians, camera) = (&view.gaussians, &view.camera);
            let held = hold_view(&context(), &name, gaussians, camera, &truth, tolerances);
            table += &row(&name, &held);
        }
    }
    print(&table);
}
