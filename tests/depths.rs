//! Training views that are held to depths and normals: what it changes, and what it leaves.

use gspotential::config::{Config, PriorLoss, PriorSource, RenderedDepth};
use gspotential::dense::{DepthMap, normals};
use gspotential::gpu::Rasterizer;
use gspotential::pipeline::{Prepared, prepare};
use gspotential::run::Seconds;
use gspotential::scene::Scene;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::train::{DepthLosses, DepthTarget, LossSample, Trained, Trainer, fingerprint};

use crate::gpu::rig::{context, context_of};
use crate::kit::keep::Keep;

fn small_scene() -> Scene {
    scene(&BuiltinOptions {
        width: 64,
        n_test: 1,
        ..BuiltinOptions::default()
    })
}

/// A short training without virtual views, held to the cloud.
fn config(iterations: u32) -> Config {
    let mut config = Config::preset("3dgs").expect("a preset");
    config.iterations = iterations;
    config.scene.max_points = Some(1500);
    config.densify.start = 20;
    config.densify.end = iterations.max(21);
    config.densify.interval = 20;
    config.prior.source = PriorSource::Cloud;
    config.prior.patch_px = 16;
    config
}

fn prepared(config: &Config) -> Prepared {
    prepare(&small_scene(), config, &mut Seconds::default()).expect("prepares")
}

fn trained(prepared: &Prepared, config: &Config, rasterizer: Rasterizer) -> Trained {
    let ctx = context_of(rasterizer);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, config)
        .and_then(|mut trainer| trainer.run(&mut ()))
        .expect("trains")
}

/// Means of the last losses.
fn last(trained: &Trained) -> DepthLosses {
    let losses: Vec<DepthLosses> = trained.samples.iter().filter_map(|s| s.depths).collect();
    let last = &losses[losses.len() - 8..];
    let mean = |of: fn(&DepthLosses) -> f64| last.iter().map(of).sum::<f64>() / 8.0;
    DepthLosses {
        image: mean(|l| l.image),
        patches: mean(|l| l.patches),
        normals: mean(|l| l.normals),
        share: mean(|l| l.share),
    }
}

#[test]
fn depths_and_normals_move_towards_what_they_are_held_to() {
    let mut config = config(160);
    config.densify.enabled = false;
    let on = |loss: PriorLoss, rendered: RenderedDepth, weights: [f64; 3]| {
        let mut config = config.clone();
        (config.prior.loss, config.prior.rendered) = (loss, rendered);
        let prior = &mut config.prior;
        [prior.weight, prior.patch_weight, prior.normal_weight] = weights;
        last(&trained(&prepared(&config), &config, Rasterizer::Thread))
    };
    let least = 1e-9;
    for (loss, rendered) in [
        (PriorLoss::Pearson, RenderedDepth::Expected),
        (PriorLoss::ScaleShift, RenderedDepth::Expected),
        (PriorLoss::L1, RenderedDepth::Expected),
    ] {
        let without = on(loss, rendered, [least, 0.0, 0.0]);
        let with = on(loss, rendered, [1.0, 0.0, 0.0]);
        println!("{loss:?} of {rendered:?}: {without:?} {with:?}");
        assert!(without.share > 0.3, "{without:?}");
        assert!(with.image < 0.9 * without.image, "{loss:?} of {rendered:?}");
    }
    let (loss, rendered) = (PriorLoss::Pearson, RenderedDepth::Expected);
    let without = on(loss, rendered, [0.0, least, least]);
    let patches = on(loss, rendered, [0.0, 1.0, least]);
    let normals = on(loss, rendered, [0.0, least, 1.0]);
    println!("{without:?} {patches:?} {normals:?}");
    assert!(patches.patches < 0.9 * without.patches);
    assert!(normals.normals < 0.9 * without.normals);
}

#[test]
fn a_target_without_weight_changes_no_bit_and_neither_does_one_that_has_ended() {
    let held = config(60);
    let free = Config {
        prior: Default::default(),
        ..held.clone()
    };
    let plain = prepared(&free);
    assert!(plain.supervision.real.iter().all(|v| v.depths.is_none()));
    let mut empty = prepared(&held);
    for view in &mut empty.supervision.real {
        let depths = view.depths.as_mut().expect("held");
        depths.weight.fill(0.0);
    }
    for rasterizer in Rasterizer::ALL {
        let without = trained(&plain, &free, rasterizer);
        assert!(without.samples.iter().all(|s| s.depths.is_none()));
        let weightless = trained(&empty, &held, rasterizer);
        assert!(weightless.samples.iter().all(|s| s.depths.is_some()));
        assert!(without.gaussians == weightless.gaussians, "{rasterizer}");
        // What has weight does change them.
        let full = trained(&prepared(&held), &held, rasterizer);
        assert!(without.gaussians != full.gaussians, "{rasterizer}");
    }
    let mut early = held.clone();
    early.prior.end = 21;
    let ended = trained(&prepared(&early), &early, Rasterizer::Thread);
    let n_held = ended.samples.iter().filter(|s| s.depths.is_some()).count();
    assert_eq!(n_held, 2, "of samples after 10, 20, 30, ...");
}

#[test]
fn after_its_end_the_loss_over_the_image_has_the_last_weight_and_the_others_none() {
    let mut config = config(60);
    config.prior.end = 21;
    config.prior.end_weight = 0.3;
    config.prior.patch_weight = 0.1;
    config.prior.normal_weight = 0.1;
    let late = trained(&prepared(&config), &config, Rasterizer::Thread);
    let total = |sample: &LossSample, [image, patches, normals]: [f64; 3]| {
        let w = config.loss.ssim_weight;
        let held = sample.depths.expect("held");
        (1.0 - w) * sample.real.l1
            + w * (1.0 - sample.real.ssim)
            + image * held.image
            + patches * held.patches
            + normals * held.normals
    };
    let (before, after) = ([0.05, 0.1, 0.1], [0.3, 0.0, 0.0]);
    for sample in &late.samples {
        let (own, other) = match sample.iteration <= 21 {
            true => (before, after),
            false => (after, before),
        };
        assert!((sample.loss - total(sample, own)).abs() < 1e-6);
        assert!((sample.loss - total(sample, other)).abs() > 1e-4);
    }
    // What is optimised follows: an equal weight goes on as if nothing had ended.
    let mut level = config.clone();
    level.prior.patch_weight = 0.0;
    level.prior.normal_weight = 0.0;
    level.prior.end_weight = level.prior.weight;
    let mut endless = level.clone();
    endless.prior.end = 1_000_000;
    endless.prior.end_weight = 0.0;
    let of = |config: &Config| trained(&prepared(config), config, Rasterizer::Thread).gaussians;
    let whole = of(&endless);
    assert!(of(&level) == whole);
    level.prior.end_weight = 0.3;
    assert!(of(&level) != whole);
}

#[test]
fn a_training_that_is_held_and_resumed_ends_with_the_same_bits() {
    let mut config = config(70);
    config.prior.normal_weight = 0.1;
    config.prior.patch_weight = 0.1;
    config.poses.refine = true;
    let prepared = prepared(&config);
    let ctx = context();
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let trainer =
        || Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config).expect("fits");
    let mut halfway = Keep::at(47);
    let whole = trainer().run(&mut halfway).expect("trains");
    let (state, buffers) = halfway.kept.expect("kept");
    let json = serde_json::to_string(&state).expect("JSON");
    let mut resumed = trainer();
    let state = serde_json::from_str(&json).expect("JSON");
    resumed.restore(state, &buffers.concat()).expect("restores");
    let resumed = resumed.run(&mut ()).expect("trains");
    assert!(whole.gaussians == resumed.gaussians);
    assert_eq!(whole.cameras, resumed.cameras);
    assert_eq!(whole.samples, resumed.samples);
    // Another target is another run.
    let known = fingerprint(supervision, start);
    let mut other = prepared.supervision.clone();
    let depths: &mut DepthTarget = other.real[0].depths.as_mut().expect("held");
    depths.depth[7] += 0.5;
    let found = fingerprint(&other, start);
    let name = format!("depths of `{}`", other.real[0].camera.name);
    let changed: Vec<&String> = known.keys().filter(|k| known[*k] != found[*k]).collect();
    assert_eq!(changed, [&name]);
}

#[test]
fn the_cloud_is_a_target_where_it_covers_a_view_off_edges() {
    let mut config = config(10);
    config.prior.normal_weight = 0.1;
    let scene = small_scene();
    let prepared = prepare(&scene, &config, &mut Seconds::default()).expect("prepares");
    let frame = &prepared.frame;
    let (mut n, mut n_near) = (0, 0);
    for view in &prepared.supervision.real {
        let depths = view.depths.as_ref().expect("held");
        let camera = &view.camera;
        assert_eq!(depths.depth.len(), (camera.width * camera.height) as usize);
        let weighed = depths.weight.iter().filter(|w| **w > 0.0).count();
        assert!(weighed > depths.weight.len() / 4, "{weighed}");
        for (weight, normal) in depths.weight.iter().zip(&depths.normal) {
            let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt();
            assert!((length - weight).abs() < 1e-5);
        }
        // The cloud's own points lie at most behind what is nearest in their pixel.
        for point in scene.cloud.positions.iter().step_by(50) {
            let (at, depth) = camera.project(frame.to_canonical(*point));
            let inside = at.x >= 0.0
                && at.y >= 0.0
                && at.x < f64::from(camera.width)
                && at.y < f64::from(camera.height);
            if depth > prepared.supervision.near && inside {
                let pixel = at.y as usize * camera.width as usize + at.x as usize;
                if depths.weight[pixel] > 0.0 {
                    n += 1;
                    assert!(f64::from(depths.depth[pixel]) <= depth * (1.0 + 1e-6));
                    n_near += usize::from(f64::from(depths.depth[pixel]) > 0.95 * depth);
                }
            }
        }
    }
    assert!(n > 100 && n_near > n / 2, "{n_near} of {n}");
    config.prior.inverse = true;
    let inverse = prepare(&scene, &config, &mut Seconds::default()).expect("prepares");
    let views = prepared
        .supervision
        .real
        .iter()
        .zip(&inverse.supervision.real);
    for (a, b) in views {
        let (a, b) = (
            a.depths.as_ref().expect("held"),
            b.depths.as_ref().expect("held"),
        );
        for (a, b) in a.depth.iter().zip(&b.depth).filter(|(a, _)| **a > 0.0) {
            assert!((a * b - 1.0).abs() < 1e-6);
        }
    }
}

#[test]
fn normals_of_a_plane_are_its_own_and_a_step_has_none() {
    let camera = small_scene().train[0].camera.clone();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let normal = glam::DVec3::new(0.3, -0.2, -0.9).normalize();
    // Depths of the plane normal . p = -2.
    let depth = |i: usize, behind: f64| {
        let (x, y) = (i % width, i / width);
        let ray = glam::DVec3::new(
            (x as f64 + 0.5 - camera.cx) / camera.fx,
            (y as f64 + 0.5 - camera.cy) / camera.fy,
            1.0,
        );
        (-(2.0 + behind) / normal.dot(ray)) as f32
    };
    let map = |behind: f64| DepthMap {
        camera: camera.clone(),
        depth: (0..width * height)
            .map(|i| depth(i, if i % width < 20 { 0.0 } else { behind }))
            .collect(),
        confidence: Vec::new(),
        colors: Vec::new(),
    };
    for found in normals(&map(0.0)) {
        assert!(found.expect("smooth").distance(normal) < 1e-3, "{found:?}");
    }
    for (i, found) in normals(&map(1.0)).into_iter().enumerate() {
        assert_eq!(found.is_none(), (19..21).contains(&(i % width)), "{i}");
    }
}
