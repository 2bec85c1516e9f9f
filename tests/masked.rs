//! Training with masks: what they leave out teaches nothing, or is the background.

use gspotential::config::Config;
use gspotential::pipeline::{Prepared, prepare};
use gspotential::run::Seconds;
use gspotential::scene::{Mask, Outside, Scene};
use gspotential::train::{Trained, Trainer};

use crate::gpu::rig::context;
use crate::scene::fixtures::still_life;

/// The left half of every training view is its subject.
fn masked(outside: Outside) -> Scene {
    let mut scene = still_life();
    for view in &mut scene.train {
        let (width, n) = (view.image.width, view.image.rgb.len() / 3);
        view.mask = Some(Mask {
            set: (0..n as u32).map(|i| i % width < width / 2).collect(),
            outside,
        });
    }
    scene
}

/// The same with every pixel inverted that no mask has.
fn inverted_outside(mut scene: Scene) -> Scene {
    for view in &mut scene.train {
        let mask = view.mask.as_ref().expect("a mask");
        for (pixel, set) in view.image.rgb.chunks_exact_mut(3).zip(&mask.set) {
            if !set {
                pixel.iter_mut().for_each(|value| *value = !*value);
            }
        }
    }
    scene
}

fn config() -> Config {
    let mut config = Config::preset("gspotential").expect("a preset");
    config.iterations = 24;
    config.views.count = 8;
    config.scene.max_points = Some(400);
    config.shell.count = 100;
    config
}

fn prepared(scene: &Scene) -> Prepared {
    prepare(scene, &config(), &mut Seconds::default()).expect("prepares")
}

fn trained(scene: &Scene) -> Trained {
    let ctx = context();
    let (config, prepared) = (config(), prepared(scene));
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config)
        .and_then(|mut trainer| trainer.run(&mut ()))
        .expect("trains")
}

#[test]
fn ignored_pixels_decide_nothing_from_carving_to_the_last_bit() {
    let scene = masked(Outside::Ignored);
    let means = trained(&scene).gaussians;
    assert!(trained(&inverted_outside(scene)).gaussians == means);
    // If they count, they decide.
    let scene = masked(Outside::Kept);
    let means = trained(&scene).gaussians;
    assert!(trained(&inverted_outside(scene)).gaussians != means);
}

#[test]
fn a_view_whose_every_pixel_is_ignored_trains_nothing_and_breaks_nothing() {
    let mut scene = masked(Outside::Ignored);
    for view in &mut scene.train[1..] {
        view.mask.as_mut().expect("a mask").set.fill(false);
    }
    let trained = trained(&scene);
    assert_eq!(trained.gaussians.n_broken(), 0);
    assert!(trained.samples.iter().all(|sample| sample.loss.is_finite()));
}

#[test]
fn a_cut_out_subject_has_no_shell_and_no_filled_holes() {
    for (outside, n_shell) in [(Outside::Background, 0), (Outside::Kept, 100)] {
        let prepared = prepared(&masked(outside));
        let supervision = &prepared.supervision;
        assert_eq!(supervision.shell.map_or(0, |shell| shell.count()), n_shell);
        assert_eq!(prepared.start.len(), 400 + n_shell);
        let is_told = |warning: &String| warning.contains("no far shell");
        assert_eq!(prepared.warnings.iter().any(is_told), n_shell == 0);
        let mut texels = supervision
            .virtual_views
            .iter()
            .flat_map(|view| view.goal.texels());
        let is_filled = |texel: u32| ![0, 255].contains(&(texel >> 24));
        assert_eq!(texels.any(is_filled), n_shell > 0);
    }
}
