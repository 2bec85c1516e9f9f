//! More than a loop may take: Mesa's CPU driver ends all loops of an invocation after 65,535 turns.

use gspotential::doctor::twin::cases::{TwinCase, cover, crowd};
use gspotential::doctor::twin::compare::max_abs_off_mask;
use gspotential::doctor::twin::raster::{TwinRender, render};
use gspotential::doctor::view::{ORDINARY, Residual, ViewCase, examine, large_cases};
use gspotential::doctor::{gaussians_of, stage, view_of};
use gspotential::render::{Model, Rendered, Renderer};

use super::rig::{assert_findings, context};
use super::views::{hold, print, table_head};

/// The Renderer's image of the case's first camera, resized, and the reference's.
fn images(case: &TwinCase, (width, height): (usize, usize)) -> (Rendered, TwinRender) {
    let camera = case.cameras[0].resized(width, height);
    let ctx = context();
    let degree = case.gaussians.sh_degree as u32;
    let gaussians = gaussians_of(&case.gaussians, degree);
    let model = Model::upload(&ctx.gpu, &gaussians, gaussians.len()).expect("fits");
    let mut renderer = Renderer::new(&ctx.gpu, &ctx.kernels);
    let image = renderer.render(&model, &view_of(&camera)).expect("renders");
    (image, render(&case.gaussians, &camera))
}

/// Largest difference of opacity, everywhere.
fn difference(image: &Rendered, twin: &TwinRender) -> f64 {
    let ours: Vec<f64> = image.alpha.iter().map(|a| f64::from(*a)).collect();
    max_abs_off_mask(&ours, &twin.alpha, &vec![false; twin.alpha.len()])
}

#[test]
fn a_gaussian_over_100_000_tiles_reaches_all_of_them() {
    let (image, twin) = images(&cover(), (1600, 2133));
    let least = twin.alpha.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(least > 0.02, "the case covers the image: {least}");
    let error = difference(&image, &twin);
    assert!(error < 1e-5, "{error:e}");
}

#[test]
fn the_farther_half_of_140_000_splats_in_a_tile_counts() {
    let case = crowd(140_000, 4, |i, _| i < 70_000);
    let (image, twin) = images(&case, (4, 8));
    assert!(
        twin.alpha.iter().all(|a| *a > 0.999),
        "all of it is covered"
    );
    let error = difference(&image, &twin);
    assert!(error < 1e-5, "{error:e}");
}

/// The largest error of a gradient.
fn worst_gradient(case: &ViewCase) -> f64 {
    let (findings, _) = examine(&context(), case).expect("computes");
    assert_findings(&findings);
    let gradients = findings
        .list
        .iter()
        .filter(|f| f.stage == stage::PROJECT_BACKWARD);
    gradients.map(|f| f.error).fold(0.0, f64::max)
}

#[test]
fn what_exceeds_a_loop_matches_the_reference_stage_by_stage() {
    let mut table = table_head();
    for case in large_cases() {
        table += &hold(&case);
    }
    print(&table);
}

#[test]
fn a_sum_over_a_whole_image_is_as_good_as_one_over_a_tile() {
    for residual in [Residual::Constant, Residual::Random] {
        let case = ViewCase {
            residual,
            ..ViewCase::new("cover", &cover(), 0, (1600, 1067), ORDINARY)
        };
        let error = worst_gradient(&case);
        print(&format!("{residual:?}: {error:.1e}\n"));
        assert!(error < 1e-5, "{residual:?}: {error:e}");
    }
}
