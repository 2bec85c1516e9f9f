//! The presets of other systems train, and what only they have does what their sources say.

use gspotential::config::Config;
use gspotential::pipeline::{Prepared, prepare};
use gspotential::run::Seconds;
use gspotential::scene::Scene;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::train::Trainer;

use crate::gpu::rig::context;

fn still_life() -> Scene {
    scene(&BuiltinOptions {
        width: 48,
        n_test: 1,
        pixel_step: 2,
        ..BuiltinOptions::default()
    })
}

fn config(name: &str) -> Config {
    let mut config = Config::preset(name).expect("a preset");
    config.iterations = 40;
    config.scene.max_points = Some(500);
    config
}

fn prepared(scene: &Scene, config: &Config) -> Prepared {
    prepare(scene, config, &mut Seconds::default()).expect("prepares")
}

#[test]
fn presets_of_other_systems_train_on_the_built_in_scene() {
    let scene = still_life();
    let ctx = context();
    for name in [
        "instantsplat",
        "dropgaussian",
        "d2gs",
        "corgs",
        "fsgs",
        "sparsegs",
        "splatfields",
        "sparsesurf",
    ] {
        let mut config = config(name);
        config.partner.start = 20;
        config.generator.noise_side = 4;
        let prepared = prepared(&scene, &config);
        let (start, supervision) = (&prepared.start, &prepared.supervision);
        assert!(supervision.virtual_views.is_empty());
        let trained = Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config)
            .and_then(|mut trainer| trainer.run(&mut ()))
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let l1 = |k: usize| trained.samples[k].real.l1;
        assert!(l1(3) < l1(0), "{name}: {} {}", l1(0), l1(3));
        assert_eq!(trained.gaussians.n_broken(), 0);
        let n_virtual = trained.samples.iter().filter(|s| s.virt.is_some()).count();
        let n_expected = if name == "corgs" { 2 } else { 0 };
        assert_eq!(n_virtual, n_expected, "{name}");
        let moved = trained.cameras.iter().zip(&supervision.real);
        let moved = moved.filter(|(after, view)| **after != view.camera).count();
        let n_moved = if name == "instantsplat" { 4 } else { 0 };
        assert_eq!(moved, n_moved, "{name}");
    }
}

/// Positions whose point is sure, of confidence 20 say, learn at the rate of all; at 1 it is 27.6 times as fast, and at most a
/// hundred times.
#[test]
fn rates_of_positions_follow_the_confidence_of_their_points() {
    let mut scene = still_life();
    let confidence = scene.cloud.confidence.as_mut().expect("confidences");
    for (i, c) in confidence.iter_mut().enumerate() {
        *c = [1.0, 20.0, -30.0][i % 3];
    }
    let mut config = config("instantsplat");
    config.scene.max_points = None;
    config.shell.count = 100;
    let prepared = prepared(&scene, &config);
    let gains = &prepared.supervision.position_gains;
    assert_eq!(gains.len(), prepared.start.len());
    let n = scene.cloud.len();
    let (of_cloud, of_shell) = gains.split_at(n.min(gains.len() - 100));
    assert!(of_cloud.len() > 200, "{}", of_cloud.len());
    for gain in of_cloud {
        let is = |expected: f64| (f64::from(*gain) - expected).abs() < 1e-4 * expected.max(0.01);
        assert!(
            is(99.0 / (1.0 + 1f64.exp())) || is(99.0 / (1.0 + 20f64.exp())) || is(99.0),
            "{gain}"
        );
    }
    assert_eq!(of_shell, [0.0; 100]);
    assert!(prepared.warnings.iter().all(|w| !w.contains("confidence")));
}

#[test]
fn a_cloud_without_confidences_says_so_and_presets_without_the_rule_have_no_rates() {
    let mut scene = still_life();
    assert!(
        prepared(&scene, &config("3dgs"))
            .supervision
            .position_gains
            .is_empty()
    );
    scene.cloud.confidence = None;
    let prepared = prepared(&scene, &config("instantsplat"));
    assert!(prepared.supervision.position_gains.is_empty());
    let told = |warning: &&String| warning.contains("no confidences");
    assert_eq!(prepared.warnings.iter().filter(told).count(), 1);
}

/// Twice as many Gaussians as points: those that came of others move as their points may.
#[test]
fn unsure_positions_move_further_after_densification_too() {
    let mut scene = still_life();
    let n = scene.cloud.len();
    scene.cloud.confidence = Some(
        (0..n)
            .map(|i| if i % 2 == 0 { 0.0 } else { 30.0 })
            .collect(),
    );
    let mut config = config("3dgs");
    config.scene.max_points = None;
    config.densify.start = 4;
    config.densify.interval = 5;
    config.densify.end = 35;
    config.densify.gradient_threshold = 1e-9;
    config.densify.max_gaussians = 3 * n;
    config.optimizer.confidence_gain = 99.0;
    let ctx = context();
    let prepared = prepared(&scene, &config);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let mut trainer =
        Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config).expect("fits");
    let trained = trainer.run(&mut ()).expect("trains");
    assert!(
        trained.gaussians.len() > 2 * n,
        "{}",
        trained.gaussians.len()
    );
    // The last number of a Gaussian's statistics is its rate's gain.
    let statistics = trainer
        .buffers()
        .last()
        .expect("buffers")
        .expect("readable");
    let numbers: &[[f32; 4]] = bytemuck::cast_slice(&statistics);
    let gains = numbers[..trained.gaussians.len()].iter().map(|s| s[3]);
    let (sure, unsure): (Vec<f32>, Vec<f32>) = gains.partition(|gain| *gain < 1e-6);
    assert!(
        sure.len() > n / 2 && unsure.len() > n / 2,
        "{} {}",
        sure.len(),
        unsure.len()
    );
    assert!(unsure.iter().all(|gain| *gain == 49.5));
}
