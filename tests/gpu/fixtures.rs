//! The GPU against the reference cases on disk.

use gspotential::doctor::image::{Truth, hold_gradients, hold_image};
use gspotential::doctor::twin::tolerance;
use gspotential::doctor::view::{Bounds, Residual, ViewCase};
use gspotential::doctor::{Findings, Rig};
use gspotential::gpu::Rasterizer;

use super::rig::{assert_findings, context_of};
use super::views::{hold, print, row, table_head};
use crate::reference::fixture::{Fixture, fixtures};

fn bounds_of(fixture: &Fixture) -> Bounds {
    let (image, gradient) = if fixture.name.starts_with("needle") {
        tolerance::GPU_REFERENCE_NEEDLE
    } else {
        tolerance::GPU_REFERENCE
    };
    Bounds {
        projection: tolerance::GPU_PROJECTION,
        image,
        gradient,
    }
}

#[test]
#[ignore = "needs ../shared/fixtures"]
fn reference_cases_are_met_in_image_and_gradient() {
    let mut table = table_head();
    for fixture in fixtures() {
        let bounds = bounds_of(&fixture);
        for index in 0..fixture.n_views() {
            let view = fixture.view(index);
            let (gaussians, camera) = (&view.gaussians, &view.camera);
            let truth = Truth {
                rgb: &view.rgb,
                alpha: &view.alpha,
                fragile: &view.fragile,
                d_rgb: &view.d_rgb,
                d_alpha: &view.d_alpha,
                classes: view.gradients.classes(),
            };
            for rasterizer in Rasterizer::ALL {
                let name = format!("{} {index}, {rasterizer}", fixture.name);
                let mut out = Findings::of(&name);
                let ctx = context_of(rasterizer);
                let mut rig = Rig::of_twin(&ctx, gaussians, camera).expect("fits");
                let image = rig.forward(&ctx).expect("renders");
                hold_image(&image, rasterizer, &truth, bounds.image, &mut out);
                let ours = rig.backward(&ctx, truth.d_rgb, truth.d_alpha);
                let ours = ours.expect("differentiates");
                hold_gradients(&ours, gaussians, camera, &truth, bounds.gradient, &mut out);
                assert_findings(&out);
                table += &row(&name, &out);
            }
        }
    }
    print(&table);
}

#[test]
#[ignore = "needs ../shared/fixtures"]
fn every_stage_holds_on_the_reference_cases() {
    let mut table = table_head();
    for fixture in fixtures() {
        let bounds = bounds_of(&fixture);
        let view = fixture.view(0);
        table += &hold(&ViewCase {
            name: fixture.name.clone(),
            gaussians: view.gaussians,
            camera: view.camera,
            bounds,
            residual: Residual::Random,
        });
    }
    print(&table);
}
