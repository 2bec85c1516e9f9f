//! Marked pixels of the photographs: which are far, whose silhouette counts, and what training makes of it.

use gspotential::cloud::far::far_pixels;
use gspotential::cloud::splat::splat_depths;
use gspotential::config::Config;
use gspotential::pipeline::{Prepared, prepare};
use gspotential::render::{Model, Renderer, ViewUniform};
use gspotential::run::Seconds;
use gspotential::scene::{Mask, Outside, Scene};
use gspotential::train::{Goal, Trained, Trainer};

use crate::gpu::rig::context;
use crate::scene::fixtures::still_life;

const FAR: u32 = 254;

fn config(settings: &[&str]) -> Config {
    let mut config = Config::preset("3dgs").expect("a preset");
    config.iterations = 60;
    config.scene.max_points = Some(400);
    let set = |config: Config, setting: &&str| config.set(setting);
    settings.iter().try_fold(config, set).expect("settings")
}

fn prepared(scene: &Scene, config: &Config) -> Prepared {
    prepare(scene, config, &mut Seconds::default()).expect("prepares")
}

fn trained(scene: &Scene, config: &Config) -> Trained {
    let ctx = context();
    let prepared = prepared(scene, config);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, config)
        .and_then(|mut trainer| trainer.run(&mut ()))
        .expect("trains")
}

/// The left half of every training view is its subject.
fn cut_out() -> Scene {
    let mut scene = still_life();
    for view in &mut scene.train {
        let (width, n) = (view.image.width, view.image.rgb.len() / 3);
        view.mask = Some(Mask {
            set: (0..n as u32).map(|i| i % width < width / 2).collect(),
            outside: Outside::Background,
        });
    }
    scene
}

#[test]
fn the_farthest_twentieth_of_the_pixels_with_a_known_depth_is_far() {
    let far = |depths: &[f32], counts: fn(usize) -> bool| -> Vec<usize> {
        let far = far_pixels(depths, counts);
        assert_eq!(far.len(), depths.len());
        (0..far.len()).filter(|i| far[*i]).collect()
    };
    let mut depths: Vec<f32> = (0..41).map(|i| ((i * 17) % 41) as f32).collect();
    // A twentieth of 41 is 3, rounded up: depths 38, 39 and 40.
    let expected: Vec<usize> = (0..41).filter(|i| depths[*i] >= 38.0).collect();
    assert_eq!(far(&depths, |_| true), expected);
    // Pixels without a point have no depth, and those that do not count are not asked.
    depths.extend([f32::INFINITY; 30]);
    assert_eq!(far(&depths, |_| true), expected);
    assert!(far(&depths, |_| false).is_empty());
    assert_eq!(far(&depths, |i| i < 2), [1]);
    // The first of equal depths.
    assert_eq!(far(&[2.0; 30], |i| i > 3), [4, 5]);
    assert!(far(&[], |_| true).is_empty());
}

#[test]
fn far_pixels_of_the_photographs_are_those_of_the_clouds_depth() {
    let scene = still_life();
    let config = config(&["loss.far_weight=1"]);
    let prepared = prepared(&scene, &config);
    let cameras: Vec<_> = scene.train.iter().map(|view| view.camera.clone()).collect();
    let near = prepared.frame.near(config.model.near);
    let depths = splat_depths(
        &scene.cloud,
        &prepared.frame,
        (&cameras, &cameras),
        &config.splat,
        near,
    )
    .expect("depths");
    for (view, depths) in prepared.supervision.real.iter().zip(&depths) {
        let texels = view.goal.texels();
        let n_known = depths.iter().filter(|d| d.is_finite()).count();
        assert_eq!(view.n_far, n_known.div_ceil(20));
        let depth_of = |is_far: bool| {
            let own = texels
                .iter()
                .zip(depths)
                .filter(move |(t, d)| (**t >> 24 == FAR) == is_far && d.is_finite());
            own.map(|(_, d)| *d)
        };
        let nearest_far = depth_of(true).fold(f32::INFINITY, f32::min);
        let farthest_else = depth_of(false).fold(0.0, f32::max);
        assert!(
            nearest_far >= farthest_else,
            "{nearest_far} {farthest_else}"
        );
        assert_eq!(depth_of(true).count(), view.n_far);
        // Nothing else of the photograph has changed.
        assert_eq!(view.total_weight, texels.len() as f64);
        assert!(texels.iter().all(|texel| view.weight_of(*texel) == 1.0));
    }
}

#[test]
fn losses_that_are_off_leave_the_photographs_and_every_bit_alone() {
    let scene = cut_out();
    let off = config(&[]);
    let goals = |prepared: Prepared| -> Vec<_> {
        prepared
            .supervision
            .real
            .into_iter()
            .map(|view| view.goal)
            .collect()
    };
    let plain = goals(prepared(&scene, &off));
    let marked = goals(prepared(
        &scene,
        &config(&["loss.far_weight=1", "loss.silhouette_weight=1"]),
    ));
    assert!(
        plain
            .iter()
            .all(|goal| goal.texels().iter().all(|t| t >> 24 == 255))
    );
    for mark in [FAR, 0] {
        let has = |goal: &Goal| goal.texels().iter().any(|texel| texel >> 24 == mark);
        assert!(marked.iter().all(has), "{mark}");
    }
    // Marks without a weight are not looked at.
    let prepared = prepared(
        &scene,
        &config(&["loss.far_weight=1", "loss.silhouette_weight=1"]),
    );
    let plain = trained(&scene, &off).gaussians;
    let ctx = context();
    let run = |config: &Config| {
        let (start, supervision) = (&prepared.start, &prepared.supervision);
        Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, config)
            .and_then(|mut trainer| trainer.run(&mut ()))
            .expect("trains")
            .gaussians
    };
    let unweighed = run(&off);
    assert!(unweighed == plain);
    assert!(run(&config(&["loss.far_weight=1"])) != unweighed);
    assert!(run(&config(&["loss.silhouette_weight=0.01"])) != unweighed);
}

/// Mean absolute error of the far pixels, by the marks that they have under the first config.
fn far_error(scene: &Scene, trained: &Trained) -> f64 {
    let ctx = context();
    let marked = prepared(scene, &config(&["loss.far_weight=1"]));
    let mut renderer = Renderer::new(&ctx.gpu, &ctx.kernels);
    let gaussians = &trained.gaussians;
    let model = Model::upload(&ctx.gpu, gaussians, gaussians.len()).expect("fits");
    let (mut sum, mut n) = (0.0, 0);
    for view in &marked.supervision.real {
        let uniform = ViewUniform::new(&view.camera, marked.supervision.near, [0.0; 3]);
        let rendered = renderer.render(&model, &uniform).expect("renders");
        for (texel, rgb) in view.goal.texels().iter().zip(rendered.rgb.chunks_exact(3)) {
            if texel >> 24 == FAR {
                let goal = texel.to_le_bytes();
                for (value, goal) in rgb.iter().zip(goal) {
                    sum += (f64::from(*value) - f64::from(goal) / 255.0).abs();
                    n += 1;
                }
            }
        }
    }
    sum / f64::from(n)
}

#[test]
fn far_pixels_are_learned_better_when_they_count_twice() {
    let scene = still_life();
    let plain = far_error(&scene, &trained(&scene, &config(&[])));
    let with = far_error(&scene, &trained(&scene, &config(&["loss.far_weight=3"])));
    assert!(with < 0.95 * plain, "{with} {plain}");
}

/// Mean opacity beside the subjects.
fn opacity_outside(scene: &Scene, trained: &Trained) -> f64 {
    let ctx = context();
    let prepared = prepared(scene, &config(&[]));
    let mut renderer = Renderer::new(&ctx.gpu, &ctx.kernels);
    let gaussians = &trained.gaussians;
    let model = Model::upload(&ctx.gpu, gaussians, gaussians.len()).expect("fits");
    let (mut sum, mut n) = (0.0, 0);
    for (view, of) in prepared.supervision.real.iter().zip(&scene.train) {
        let uniform = ViewUniform::new(&view.camera, prepared.supervision.near, [0.0; 3]);
        let rendered = renderer.render(&model, &uniform).expect("renders");
        let mask = of.mask.as_ref().expect("a mask");
        for (alpha, shows) in rendered.alpha.iter().zip(&mask.set) {
            if !shows {
                sum += f64::from(*alpha);
                n += 1;
            }
        }
    }
    sum / f64::from(n)
}

#[test]
fn the_silhouettes_loss_takes_opacity_away_beside_the_subject() {
    let scene = cut_out();
    let plain = opacity_outside(&scene, &trained(&scene, &config(&[])));
    let with = trained(&scene, &config(&["loss.silhouette_weight=1"]));
    let with = opacity_outside(&scene, &with);
    assert!(with < 0.7 * plain, "{with} {plain}");
}

#[test]
fn losses_that_find_nothing_to_look_at_say_so() {
    let mut scene = still_life();
    let told = |scene: &Scene, settings: &[&str], part: &str| {
        let prepared = prepared(scene, &config(settings));
        prepared
            .warnings
            .iter()
            .any(|warning| warning.contains(part))
    };
    assert!(told(
        &scene,
        &["loss.silhouette_weight=1"],
        "no photograph's subject is cut out"
    ));
    assert!(!told(&cut_out(), &["loss.silhouette_weight=1"], "cut out:"));
    assert!(!told(&scene, &["loss.far_weight=1"], "far pixels"));
    // Masks that show nothing leave no pixel to be far.
    for view in &mut scene.train {
        let n = view.image.rgb.len() / 3;
        view.mask = Some(Mask {
            set: vec![false; n],
            outside: Outside::Ignored,
        });
    }
    assert!(told(&scene, &["loss.far_weight=1"], "far pixels"));
}
