//! Views whose numbers nearly cancel in single precision, as the program renders them: the pose has
//! all digits of f64.

use glam::{DMat3, DVec3, Vec3};
use gspotential::camera::Camera;
use gspotential::doctor::twin::cases::{TwinCase, beside, distant_needles, narrow};
use gspotential::doctor::twin::compare::held_off_mask;
use gspotential::doctor::twin::raster::render;
use gspotential::doctor::twin::tolerance;
use gspotential::doctor::{gaussians_of, view_of, wide};
use gspotential::gaussians::Gaussians;
use gspotential::render::{Model, Renderer, ViewUniform};

use super::rig::context;
use super::views::print;

/// Holds what the renderer makes of a case at several sizes to the reference.
fn hold(name: &str, case: &TwinCase, bound: f64) {
    let ctx = context();
    let degree = case.gaussians.sh_degree as u32;
    let gaussians = gaussians_of(&case.gaussians, degree);
    let model = Model::upload(&ctx.gpu, &gaussians, gaussians.len()).expect("fits");
    let mut renderer = Renderer::new(&ctx.gpu, &ctx.kernels);
    for (width, height) in [(160, 104), (61, 47), (640, 416)] {
        let camera = case.cameras[0].resized(width, height);
        let twin = render(&case.gaussians, &camera);
        let image = renderer.render(&model, &view_of(&camera)).expect("renders");
        let ours = wide(&image.rgb);
        let error = held_off_mask(&ours, &twin.rgb, &twin.fragile, bound);
        print(&format!("{name} {width}x{height}: off by {error:.1e}\n"));
        assert!(error <= bound, "{name} {width}x{height}: {error:e}");
        assert!(twin.count.iter().any(|n| *n > 3), "{name}: nothing to see");
    }
}

#[test]
fn a_view_of_a_tenth_of_a_degree_matches_the_reference() {
    hold("0.1 degrees", &narrow(400, 21), tolerance::GPU_IMAGE);
}

#[test]
fn a_camera_beside_what_it_sees_matches_the_reference() {
    hold("camera at 1e-3", &beside(400, 22), tolerance::GPU_IMAGE);
}

#[test]
fn needles_centred_far_outside_the_image_match_the_reference() {
    let case = distant_needles(60, 23);
    hold(
        "needles from far outside",
        &case,
        2.0 * tolerance::GPU_IMAGE,
    );
}

/// A blue and a red disc about `place`, the red one nearer to a camera that looks along z by `gap`.
fn discs(place: [f64; 3], gap: f64, size: f64) -> Gaussians {
    let [blue, red] = [gap, 0.0].map(|behind| {
        let [x, y, z] = place;
        DVec3::new(x, y, z + behind).as_vec3()
    });
    assert!(red.z < blue.z, "single precision holds the discs apart");
    Gaussians {
        means: vec![blue, red],
        scales_log: vec![Vec3::splat(size.ln() as f32); 2],
        rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        opacity_logits: vec![9.0; 2],
        sh: vec![-1.7, -1.7, 1.7, 1.7, -1.7, -1.7],
        sh_degree: 0,
    }
}

/// Depths differ by less than f32 holds at the distance from which they are seen, or by as little as
/// it holds beside the camera.
#[test]
fn the_nearer_disc_is_in_front_however_close_they_are() {
    let ctx = context();
    let mut renderer = Renderer::new(&ctx.gpu, &ctx.kernels);
    for (place, gap, distance) in [
        ([0.0, 0.0, 0.0], 1e-9, 1.0),
        ([0.0, 0.0, 0.0], 1e-9, 1000.0),
        ([0.0, 0.0, 1e-3], 1e-9, 3.0),
        ([0.0, 0.0, -1e-3], 1e-9, 3.0),
        ([0.25, 0.25, 0.015625], 2e-9, 1e-3),
        ([0.25, 0.25, 0.015625], 2e-9, 1.0),
        ([0.0, 0.0, 30.0], 4e-6, 1.0),
    ] {
        let camera = Camera {
            name: "any".into(),
            width: 16,
            height: 16,
            fx: 100.0,
            fy: 100.0,
            cx: 8.0,
            cy: 8.0,
            rotation: DMat3::IDENTITY,
            translation: DVec3::Z * distance - DVec3::from_array(place),
        };
        let gaussians = discs(place, gap, 0.1 * distance);
        let model = Model::upload(&ctx.gpu, &gaussians, 2).expect("fits");
        let view = ViewUniform::new(&camera, 1e-4, [0.0; 3]);
        let image = renderer.render(&model, &view).expect("renders");
        let [red, _, blue] = [0, 1, 2].map(|c| image.rgb[3 * (8 * 16 + 8) + c]);
        assert!(
            red > 0.9 && blue < 0.1,
            "{place:?}, {distance}: {red} {blue}"
        );
    }
}
