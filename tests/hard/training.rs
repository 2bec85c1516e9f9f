//! Training on images, masks and sets of Gaussians that leave little to learn from, and at the
//! limits of densification.

use glam::{DVec3, Vec3};
use gspotential::camera::Frame;
use gspotential::config::Config;
use gspotential::doctor::twin::cases::{cameras, looking_at, random_scene};
use gspotential::doctor::twin::model::TwinCamera;
use gspotential::doctor::{gaussians_of, view_of};
use gspotential::gaussians::Gaussians;
use gspotential::gpu::constants::{TILE_H, TILE_W};
use gspotential::render::{Model, Renderer};
use gspotential::scene::PointCloud;
use gspotential::train::{Goal, Supervision, Trained, TrainingView};

use super::specimens::{config, noise_supervision};
use super::survive;
use crate::gpu::rig::context;

fn camera() -> TwinCamera {
    looking_at([0.0, 0.0, -1.5], [0.0; 3]).resized(61, 43)
}

fn ball(n: usize) -> Gaussians {
    gaussians_of(&random_scene(n, 1, 44).gaussians, 1)
}

fn trained(name: &str, start: &Gaussians, supervision: &Supervision, config: &Config) -> Trained {
    survive(&context(), name, start, supervision, config).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// The loss has fallen from the first look to the last.
fn assert_learns(name: &str, trained: &Trained) {
    let losses: Vec<f64> = trained.samples.iter().map(|s| s.loss).collect();
    assert!(losses.last() < losses.first(), "{name}: {losses:?}");
}

#[test]
fn images_of_any_size_are_learned_from() {
    for (width, height) in [(1, 1), (7, 5), (5, 7), (2, 131), (33, 17), (64, 48)] {
        let name = format!("{width}x{height}");
        let supervision = noise_supervision(&camera().resized(width, height));
        assert_learns(&name, &trained(&name, &ball(80), &supervision, &config(60)));
    }
}

#[test]
fn a_black_photograph_is_learned_as_black() {
    let mut supervision = noise_supervision(&camera());
    let view = &mut supervision.real[0];
    view.goal = Goal::new(&vec![0xff00_0000; view.goal.texels().len()]);
    let result = trained("black", &ball(80), &supervision, &config(150));
    assert_learns("black", &result);
    let last = result.samples.last().expect("samples").real;
    assert!(last.l1 < 0.05, "{last:?}");
}

/// A second view with the pixels of `valid` alone.
fn with_mask(valid: impl Fn(usize) -> bool) -> Supervision {
    let mut supervision = noise_supervision(&camera());
    let view: TrainingView = supervision.real[0].clone();
    let mut goal = view.goal.texels();
    for (i, texel) in goal.iter_mut().enumerate() {
        // Colours of invalid pixels must not matter.
        *texel = if valid(i) {
            *texel | 0xff00_0000
        } else {
            *texel & 0x00ff_ffff
        };
    }
    supervision.virtual_views = vec![TrainingView::masked(view.camera, &goal, 1.0)];
    supervision
}

#[test]
fn masks_may_be_empty_full_or_one_pixel() {
    let start = ball(80);
    for (name, supervision) in [
        ("full", with_mask(|_| true)),
        ("one pixel", with_mask(|i| i == 1300)),
        ("corner pixel", with_mask(|i| i == 0)),
    ] {
        let result = trained(name, &start, &supervision, &config(60));
        assert_learns(name, &result);
        let virt = result
            .samples
            .last()
            .expect("samples")
            .virt
            .expect("a virtual view");
        assert!(virt.l1 > 0.0, "{name}");
    }
    // To the bit what there is without the view.
    let empty = trained("empty", &start, &with_mask(|_| false), &config(40));
    let none = trained("none", &start, &noise_supervision(&camera()), &config(40));
    assert!(
        empty.gaussians == none.gaussians,
        "an empty mask teaches something"
    );
    let virt = empty.samples[0].virt.expect("a virtual view");
    assert_eq!((virt.l1, virt.ssim), (0.0, 0.0));
}

#[test]
fn gaussians_that_no_view_sees_stay_as_they_are() {
    let mut start = ball(50);
    start.means.iter_mut().for_each(|m| m.z -= 10.0);
    let result = trained("behind", &start, &noise_supervision(&camera()), &config(40));
    assert!(result.gaussians == start, "something has moved");
    let losses: Vec<f64> = result.samples.iter().map(|s| s.loss).collect();
    assert!(losses.iter().all(|l| *l == losses[0]), "{losses:?}");
}

#[test]
fn clouds_of_one_point_and_of_points_that_coincide_are_learned_from() {
    let mut config = config(60);
    config.model.sh_degree = 1;
    let mixed: Vec<DVec3> = (0..60)
        .map(|i| {
            if i < 40 {
                DVec3::ZERO
            } else {
                DVec3::splat(0.01 * f64::from(i - 40))
            }
        })
        .collect();
    for (name, positions) in [
        ("one point", vec![DVec3::new(0.1, 0.0, 0.0)]),
        ("forty at one place", vec![DVec3::new(0.1, -0.1, 0.2); 40]),
        ("some at one place", mixed),
    ] {
        let cloud = PointCloud {
            colors: vec![[200, 100, 50]; positions.len()],
            confidence: None,
            positions,
        };
        let start = Gaussians::from_cloud(&cloud, &Frame::IDENTITY, &config.model)
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let result = trained(name, &start, &noise_supervision(&camera()), &config);
        assert_learns(name, &result);
        assert_eq!(result.gaussians.len(), start.len());
    }
}

/// Densification every ten iterations.
fn densifying(iterations: u32) -> Config {
    let mut config = config(iterations);
    config.densify.start = 5;
    config.densify.end = iterations;
    config.densify.interval = 10;
    config.coverage.prune = false;
    config.coverage.densify = false;
    config
}

#[test]
fn densification_stops_at_its_cap() {
    let mut config = densifying(60);
    config.densify.gradient_threshold = 1e-9;
    config.densify.max_gaussians = 130;
    let result = trained("cap", &ball(80), &noise_supervision(&camera()), &config);
    assert_eq!(result.gaussians.len(), 130);
    assert!(result.plans.iter().all(|p| p.n_gaussians <= 130));
    assert_learns("cap", &result);
}

#[test]
fn everything_may_be_split_over_and_over() {
    let mut config = densifying(40);
    config.densify.gradient_threshold = 1e-12;
    config.densify.split_scale = 1e-9;
    config.densify.min_opacity = 0.0;
    let result = trained("split", &ball(80), &noise_supervision(&camera()), &config);
    let sizes: Vec<usize> = result.plans.iter().map(|p| p.n_gaussians).collect();
    // All that are drawn double each time.
    assert!(
        sizes.len() == 3 && *sizes.last().expect("plans") > 500,
        "{sizes:?}"
    );
    // Halves cover more than the whole did, so the loss rises a little with each doubling.
    let losses: Vec<f64> = result.samples.iter().map(|s| s.loss).collect();
    assert!(losses.iter().all(|l| *l < 1.2 * losses[0]), "{losses:?}");
}

#[test]
fn everything_may_be_pruned() {
    let mut config = densifying(40);
    config.densify.min_opacity = 1.0;
    let result = trained("prune", &ball(80), &noise_supervision(&camera()), &config);
    assert_eq!(result.plans[0].counts.pruned_opacity, 80);
    assert!(result.gaussians.is_empty());
    // What is left is the background, of which nothing changes.
    let last = &result.samples[result.samples.len() - 2..];
    assert_eq!(last[0].loss, last[1].loss);
}

#[test]
fn no_gaussians_at_all_render_the_background() {
    let ctx = context();
    let model = Model::upload(&ctx.gpu, &ball(0), 0).expect("fits");
    let mut view = view_of(&camera());
    view.background = [0.25, 0.5, 0.75];
    let image = Renderer::new(&ctx.gpu, &ctx.kernels)
        .render(&model, &view)
        .expect("renders");
    assert!(image.rgb.chunks_exact(3).all(|p| p == [0.25, 0.5, 0.75]));
    assert!(image.alpha.iter().all(|a| *a == 0.0));
}

/// Side of a square image of more than `n_tiles` tiles.
fn side_of(n_tiles: u64) -> usize {
    let area = n_tiles * u64::from(TILE_W * TILE_H);
    (area as f64).sqrt() as usize + 64
}

#[test]
fn more_pairs_than_the_adapter_binds_are_refused_and_the_next_view_renders() {
    let mut wide = ball(0);
    let n = 400;
    wide.means = (0..n)
        .map(|i| Vec3::new(0.0, 0.0, 0.001 * i as f32))
        .collect();
    wide.scales_log = vec![Vec3::splat(4.0); n];
    wide.rotations_wxyz = vec![[1.0, 0.0, 0.0, 0.0]; n];
    wide.opacity_logits = vec![0.0; n];
    wide.sh = vec![0.1; 12 * n];
    let ctx = context();
    let model = Model::upload(&ctx.gpu, &wide, n).expect("fits");
    let mut renderer = Renderer::new(&ctx.gpu, &ctx.kernels);
    let side = side_of(ctx.gpu.max_binding() / 8 / n as u64);
    let large = camera().resized(side.min(4096), side.min(4096));
    let refused = renderer.render(&model, &view_of(&large)).map(|_| ());
    let text = refused.expect_err("too many pairs").to_string();
    assert!(text.contains("pair"), "{text}");
    let small = renderer.render(&model, &view_of(&camera()));
    let small = small.expect("renders");
    assert!(small.rgb.iter().all(|v| v.is_finite()));
    assert!(small.alpha.iter().all(|a| *a > 0.99));
}

#[test]
fn a_step_with_more_pairs_than_the_adapter_binds_is_refused() {
    let mut wide = ball(300);
    wide.scales_log.fill(Vec3::splat(4.0));
    let ctx = context();
    let side = side_of(ctx.gpu.max_binding() / 16 / 300);
    let supervision = noise_supervision(&cameras()[0].resized(side.min(2400), side.min(2400)));
    let refused = survive(&ctx, "too many", &wide, &supervision, &config(1));
    let text = refused.err().expect("too many pairs").to_string();
    assert!(text.contains("pair") && text.contains("--max-"), "{text}");
}
