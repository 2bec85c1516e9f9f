//! Training on a single photograph.

use gspotential::config::Config;
use gspotential::pipeline::prepare;
use gspotential::run::Seconds;
use gspotential::scene::Scene;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::train::Trainer;

use crate::gpu::rig::context;

fn with_views(n: usize) -> Scene {
    let mut scene = scene(&BuiltinOptions {
        width: 48,
        n_test: 1,
        pixel_step: 2,
        ..BuiltinOptions::default()
    });
    scene.train.truncate(n);
    scene
}

fn config() -> Config {
    let mut config = Config::preset("3dgs").expect("a preset");
    config.iterations = 60;
    config.scene.max_points = Some(500);
    config.densify.start = 10;
    config.densify.interval = 10;
    config.densify.opacity_reset_interval = 20;
    // The rest is left to learn from it.
    config.densify.opacity_reset_end = 20;
    config
}

#[test]
fn cameras_in_one_place_have_the_extent_of_a_ring_and_others_their_own() {
    let extent = |scene: &Scene| {
        let prepared = prepare(scene, &config(), &mut Seconds::default()).expect("prepares");
        let in_one_place = |warning: &String| warning.contains("stand in one place");
        let warns = prepared.warnings.iter().any(in_one_place);
        (prepared.supervision.extent, warns)
    };
    assert_eq!(extent(&with_views(1)), (1.1, true));
    // The mean of two is midway.
    let two = with_views(2);
    let prepared = prepare(&two, &config(), &mut Seconds::default()).expect("prepares");
    let [a, b] = [0, 1].map(|i| two.train[i].camera.center());
    let expected = 1.1 * 0.5 * a.distance(b) / prepared.frame.radius;
    let (found, warns) = extent(&two);
    assert!(
        (found - expected).abs() < 1e-12 && !warns,
        "{found} {expected}"
    );
}

#[test]
fn one_photograph_trains_through_densification_and_pruning() {
    let (scene, config) = (with_views(1), config());
    let prepared = prepare(&scene, &config, &mut Seconds::default()).expect("prepares");
    let ctx = context();
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let trained = Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config)
        .and_then(|mut trainer| trainer.run(&mut ()))
        .expect("trains");
    // An extent of 0 would leave every mean where it is, and nothing after the first reset.
    let l1: Vec<f64> = trained.samples.iter().map(|s| s.real.l1).collect();
    let (before, after) = l1.split_at(2);
    assert!(before[1] < before[0], "{l1:?}");
    assert!(after.windows(2).all(|pair| pair[1] < pair[0]), "{l1:?}");
    assert!(trained.gaussians.len() >= start.len() / 2);
    assert_eq!(trained.gaussians.n_broken(), 0);
}
