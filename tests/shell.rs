//! The far shell: opaque from everywhere within, and nothing but its colour ever changes.

use glam::{DMat3, DVec3, Vec3};
use gspotential::camera::Camera;
use gspotential::config::ShellConfig;
use gspotential::doctor::gaussians_of;
use gspotential::doctor::twin::cases::{looking_at, random_scene};
use gspotential::doctor::twin::random::Random;
use gspotential::gaussians::Gaussians;
use gspotential::render::{Model, Renderer, ViewUniform};
use gspotential::train::PlanCounts;
use gspotential::train::Shell;

use crate::gpu::rig::context;
use crate::hard::specimens::{config, noise_supervision};
use crate::hard::survive;

const COLOR: DVec3 = DVec3::new(0.25, 0.5, 0.875);

fn config_of(count: usize) -> ShellConfig {
    ShellConfig {
        count,
        radius: 10.0,
    }
}

/// A Gaussian at `x` on the first axis and one at the focus.
fn scene(x: f32) -> Gaussians {
    Gaussians {
        means: vec![Vec3::X * x, Vec3::ZERO],
        ..Gaussians::default()
    }
}

#[test]
fn the_shell_lies_beyond_the_scene_and_can_be_told_from_it() {
    for (x, radius) in [(0.5, 10.0), (6.0, 10.0), (40.0, 60.0), (1e6, 1.5e6)] {
        let shell = Shell::around(&scene(x), &config_of(500)).expect("is on");
        assert!(f64::from(x) < 0.9 * shell.inner_radius());
        for mean in shell.gaussians(COLOR, 0).means {
            let distance = f64::from(mean.length());
            assert!((distance / radius - 1.0).abs() < 1e-6, "{x}: {distance}");
            assert!(distance > 1.1 * shell.inner_radius());
        }
    }
    assert_eq!(Shell::around(&scene(0.5), &config_of(0)), None);
}

#[test]
fn from_anywhere_within_the_shell_is_opaque_and_of_its_colour() {
    let ctx = context();
    let mut random = Random::new(3);
    for count in [100, 2000] {
        let shell = Shell::around(&scene(1.0), &config_of(count)).expect("is on");
        let gaussians = shell.gaussians(COLOR, 2);
        assert_eq!(gaussians.len(), count);
        let model = Model::upload(&ctx.gpu, &gaussians, count).expect("fits");
        let mut renderer = Renderer::new(&ctx.gpu, &ctx.kernels);
        let (mut thinnest, mut off) = (1.0_f32, 0.0_f64);
        for _ in 0..12 {
            let mut within = || DVec3::from_array([(); 3].map(|()| random.uniform(-1.0, 1.0)));
            let (eye, target) = (within(), 3.0 * within());
            let camera = Camera {
                name: "within".into(),
                width: 60,
                height: 44,
                fx: 40.0,
                fy: 40.0,
                cx: 30.0,
                cy: 22.0,
                rotation: DMat3::IDENTITY,
                translation: DVec3::ZERO,
            };
            let camera = camera.looking_at("within".into(), eye, target, DVec3::Y);
            let view = ViewUniform::new(&camera, 0.01, COLOR.to_array());
            let image = renderer.render(&model, &view).expect("renders");
            thinnest = image.alpha.iter().fold(thinnest, |t, a| t.min(*a));
            for pixel in image.rgb.chunks_exact(3) {
                let color = DVec3::new(pixel[0].into(), pixel[1].into(), pixel[2].into());
                off = off.max((color - COLOR).abs().max_element());
            }
        }
        assert!(thinnest > 0.97, "{count}: alpha {thinnest}");
        assert!(off < 1e-5, "{count}: colour off by {off}");
    }
}

#[test]
fn training_changes_nothing_of_the_shell_but_its_colour() {
    const COUNT: usize = 200;
    let mut start = gaussians_of(&random_scene(80, 1, 44).gaussians, 1);
    let n_scene = start.len();
    let shell = Shell::around(&start, &config_of(COUNT)).expect("is on");
    start.extend(shell.gaussians(COLOR, 1));
    let camera = looking_at([0.0, 0.0, -1.5], [0.0; 3]).resized(61, 43);
    let mut supervision = noise_supervision(&camera);
    supervision.shell = Some(shell);
    let mut config = config(60);
    // Everything that removes, adds and resets.
    config.densify.start = 5;
    config.densify.interval = 10;
    config.densify.max_scale = 0.05;
    config.densify.opacity_reset_interval = 20;
    config.densify.gradient_threshold = 1e-9;
    config.coverage.densify = false;
    config.coverage.start = 30;
    config.coverage.interval = 10;
    config.coverage.tau_min = 1.0;
    config.coverage.tau_max = 1.0;
    let trained = survive(&context(), "shell", &start, &supervision, &config).expect("trains");
    let total = |count: fn(&PlanCounts) -> usize| -> usize {
        trained.plans.iter().map(|plan| count(&plan.counts)).sum()
    };
    assert!(total(|c| c.cloned + c.split) > 0);
    assert!(total(|c| c.pruned_size) > 0 && total(|c| c.pruned_anisotropy) > 0);

    let after = &trained.gaussians;
    let kept: Vec<usize> = (0..after.len())
        .filter(|&i| f64::from(after.means[i].length()) > shell.inner_radius())
        .collect();
    assert_eq!(kept.len(), COUNT);
    let mut n_colored = 0;
    for (k, &i) in kept.iter().enumerate() {
        let before = n_scene + k;
        assert_eq!(after.means[i], start.means[before]);
        assert_eq!(after.scales_log[i], start.scales_log[before]);
        assert_eq!(after.rotations_wxyz[i], start.rotations_wxyz[before]);
        assert_eq!(after.opacity_logits[i], start.opacity_logits[before]);
        n_colored += usize::from(after.sh[12 * i..][..12] != start.sh[12 * before..][..12]);
    }
    assert!(n_colored > 5, "{n_colored} have learned");
}
