//! The gradient with respect to a camera's pose, against central differences; the program's camera
//! moves as the reference's does.

use gspotential::doctor::twin::cases::{self, TwinCase, loss_weights};
use gspotential::doctor::twin::compare::relative_l2;
use gspotential::doctor::twin::pose::{moved, pose_gradient};
use gspotential::doctor::twin::raster::{backward, render, render_with_tolerance};
use gspotential::doctor::twin::tolerance;
use gspotential::doctor::{camera_of, twin_of};

use super::project::central_difference;

/// Central differences of each of the six motions in every camera of a case.
fn check_case(name: &str, case: &TwinCase) {
    for (index, camera) in case.cameras.iter().enumerate() {
        let camera = camera.resized(26, 17);
        let reference = render_with_tolerance(&case.gaussians, &camera, tolerance::FRAGILE_STEP);
        let (d_rgb, d_alpha) = loss_weights(&reference, 200 + index as u64);
        let loss = |motion: &[f64; 6]| {
            let image = render(&case.gaussians, &moved(&camera, motion));
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            dot(&image.rgb, &d_rgb) + dot(&image.alpha, &d_alpha)
        };
        let splats = backward(&case.gaussians, &camera, &reference, &d_rgb, &d_alpha).splats;
        let gradient = pose_gradient(&case.gaussians, &camera, &splats);
        let differences: [f64; 6] = std::array::from_fn(|k| {
            central_difference(|h| loss(&std::array::from_fn(|i| if i == k { h } else { 0.0 })))
        });
        let off = |ours: &[f64]| relative_l2(ours, &differences);
        let bound = tolerance::FINITE_DIFFERENCE;
        assert!(
            off(&gradient) <= bound,
            "{name}, camera {index}: {gradient:?} against {differences:?}"
        );
        // Neither part hides in the other, nor one axis in the rest.
        for k in 0..6 {
            let mut slip = gradient;
            slip[k] *= 1.001;
            let share = gradient[k].abs() / gradient.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
            assert!(share < 0.01 || off(&slip) > bound, "{name}: axis {k}");
        }
    }
}

#[test]
fn pose_gradients_match_central_differences_at_every_sh_degree() {
    for sh_degree in 0..4 {
        let case = cases::random_scene(10, sh_degree, 40 + sh_degree as u64);
        check_case(&format!("degree {sh_degree}"), &case);
    }
}

#[test]
fn pose_gradients_of_needles_and_screen_covers_match_central_differences() {
    check_case("needles", &cases::needles(12, 50));
    check_case("huge", &cases::huge(8, 60));
}

#[test]
fn a_camera_moves_as_its_twin_does() {
    let motion = [0.02, -0.3, 0.11, 0.4, -0.05, 0.2];
    for twin in cases::cameras() {
        let ours = twin_of(&camera_of(&twin).moved(motion), twin.near);
        let theirs = moved(&twin, &motion);
        // The twin's rotation is one to the precision of f32.
        let off = relative_l2(ours.w2c.as_flattened(), theirs.w2c.as_flattened());
        assert!(off < 1e-6, "{off:e}");
        let turned = camera_of(&twin).moved([0.1, 0.2, 0.3, 0.0, 0.0, 0.0]);
        let stays = turned.center().distance(camera_of(&twin).center());
        assert!(stays < 1e-6, "a turn moves the centre by {stays:e}");
    }
}
