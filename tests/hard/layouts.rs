//! Layouts of cameras that leave a method of views on a sphere little to hold on to, and scenes
//! of any unit and origin, from the scene to trained Gaussians.

use glam::DVec3;
use gspotential::camera::Camera;
use gspotential::cloud::splat::splat_views;
use gspotential::config::Config;
use gspotential::eval::EvalOptions;
use gspotential::field::{Field, Focus};
use gspotential::pipeline::{self, Prepared, TrainJob, prepare};
use gspotential::run::{RunDir, Seconds, Stop};
use gspotential::scene::builtin::{BuiltinOptions, render, scene};
use gspotential::scene::{Scene, SceneSource, View};
use gspotential::train::{Trained, TrainingView};
use gspotential::views::{Viewpoint, place};

use super::survive;
use crate::gpu::rig::context;

fn small_scene() -> Scene {
    scene(&BuiltinOptions {
        width: 48,
        n_test: 3,
        pixel_step: 2,
        ..BuiltinOptions::default()
    })
}

fn config(iterations: u32) -> Config {
    let mut config = Config::preset("paper").expect("a preset");
    config.iterations = iterations;
    config.scene.max_points = Some(400);
    config.field.n_candidates = 256;
    config.views.count = 5;
    config.model.sh_interval = 10;
    config
}

/// The built-in scene photographed from other places.
fn photographed(poses: &[(DVec3, DVec3)]) -> Scene {
    let mut scene = small_scene();
    let template = scene.train[0].camera.clone();
    let up = template.up();
    scene.train = poses
        .iter()
        .enumerate()
        .map(|(i, &(eye, target))| {
            let axis = (target - eye).normalize();
            // Straight down or up: any other up will do.
            let up = if axis.cross(up).length() < 0.1 {
                template.forward()
            } else {
                up
            };
            let camera = template.looking_at(format!("{i}.png"), eye, target, up);
            View {
                image: render(&camera),
                camera,
                mask: None,
                prior: None,
            }
        })
        .collect();
    scene
}

fn run(name: &str, scene: &Scene, config: &Config) -> (Prepared, Trained) {
    let prepared = prepare(scene, config, &mut Seconds::default());
    let prepared = prepared.unwrap_or_else(|e| panic!("{name}: {e}"));
    let ctx = context();
    let trained = survive(&ctx, name, &prepared.start, &prepared.supervision, config)
        .unwrap_or_else(|e| panic!("{name}: {e}"));
    (prepared, trained)
}

/// Name, (eye, target) of each camera, and part of the warning where there is one.
type Layout = (&'static str, Vec<(DVec3, DVec3)>, Option<&'static str>);

/// The places of the built-in cameras, and the point they look at.
fn ring() -> (Vec<DVec3>, DVec3) {
    let scene = small_scene();
    let eyes = scene.train.iter().map(|v| v.camera.center()).collect();
    let config = config(1);
    let prepared = prepare(&scene, &config, &mut Seconds::default()).expect("a sphere");
    (eyes, prepared.frame.center)
}

#[test]
fn any_layout_of_cameras_trains_or_says_why_not() {
    let (eyes, c) = ring();
    let side = |k: f64| eyes[0] + (eyes[1] - eyes[0]) * k;
    let above = small_scene().train[0].camera.up();
    let r = (eyes[0] - c).length();
    let away = (eyes[0] - c).cross(above).normalize();
    let layouts: Vec<Layout> = vec![
        ("one camera", vec![(eyes[0], c)], Some("one camera")),
        ("coincident", vec![(eyes[0], c); 4], Some("parallel")),
        (
            "collinear",
            [0.0, 0.3, 0.6, 1.0].map(|k| (side(k), c)).to_vec(),
            None,
        ),
        (
            "parallel axes",
            [0.0, 0.3, 0.6, 1.0]
                .map(|k| (side(k), side(k) + c - eyes[0]))
                .to_vec(),
            Some("parallel"),
        ),
        (
            "opposed axes",
            vec![(c + away * r, c), (c - away * r, c)],
            Some("parallel"),
        ),
        (
            "one centre",
            vec![
                (eyes[0], c),
                (eyes[0], c + away * 0.3 * r),
                (eyes[0], c - away * 0.3 * r),
            ],
            Some("meet"),
        ),
        (
            "one side",
            [-0.05, 0.0, 0.05]
                .map(|k| (eyes[0] + away * k * r, c))
                .to_vec(),
            None,
        ),
        (
            "from the pole",
            vec![(c + above * r, c), (eyes[0], c), (eyes[1], c)],
            None,
        ),
    ];
    for (name, poses, warning) in layouts {
        let scene = photographed(&poses);
        let (prepared, trained) = run(name, &scene, &config(30));
        assert_eq!(prepared.supervision.virtual_views.len(), 5, "{name}");
        let said = prepared.warnings.join("; ");
        match warning {
            Some(part) => assert!(said.contains(part), "{name}: {said:?}"),
            None => assert!(said.is_empty(), "{name}: {said}"),
        }
        let losses: Vec<f64> = trained.samples.iter().map(|s| s.real.l1).collect();
        assert!(losses.iter().all(|l| *l < 0.5), "{name}: {losses:?}");
    }
}

#[test]
fn virtual_views_at_the_poles_are_learned_from() {
    let scene = small_scene();
    let mut config = config(40);
    let (mut prepared, _) = run("as drawn", &scene, &config);
    let train: Vec<Camera> = scene.train.iter().map(|v| v.camera.clone()).collect();
    let focus = Focus::find(&train, &scene.cloud).expect("a sphere");
    let field = Field::new(&train, &focus, &config.field);
    let up = train.iter().map(Camera::up).sum::<DVec3>().normalize();
    let poles = [up, -up].map(Viewpoint::on_sphere);
    let poles = place(&poles, &train, &focus, &field, &config).expect("cameras");
    let cameras: Vec<Camera> = poles.into_iter().map(|view| view.camera).collect();
    let near = config.model.near;
    let splats = splat_views(
        &scene.cloud,
        &prepared.frame,
        (&cameras, &train),
        &config.splat,
        near,
    );
    let splats = splats.expect("splats");
    assert!(splats[0].coverage() > 0.1, "nothing is seen from above");
    prepared.supervision.virtual_views = cameras
        .iter()
        .zip(&splats)
        .map(|(camera, splat)| {
            let camera = prepared.frame.camera_to_canonical(camera);
            {
                let goal: Vec<u32> = bytemuck::pod_collect_to_vec(&splat.rgba);
                TrainingView::masked(camera, &goal, 1.0)
            }
        })
        .collect();
    config.views.count = 2;
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let trained = survive(&context(), "poles", start, supervision, &config).expect("trains");
    let losses: Vec<f64> = trained.samples.iter().map(|s| s.loss).collect();
    assert!(losses.last() < losses.first(), "{losses:?}");
}

/// The scene in another unit and from another origin.
fn moved(scene: &Scene, scale: f64, offset: DVec3) -> Scene {
    let mut scene = scene.clone();
    for view in scene.train.iter_mut().chain(&mut scene.test) {
        let camera: &mut Camera = &mut view.camera;
        let eye = camera.center() * scale + offset;
        camera.translation = -(camera.rotation * eye);
    }
    for p in &mut scene.cloud.positions {
        *p = *p * scale + offset;
    }
    scene
}

#[test]
fn a_scene_trains_alike_in_any_unit_and_from_any_origin() {
    let config = config(40);
    let scene = small_scene();
    let (prepared, reference) = run("as it is", &scene, &config);
    let radius = prepared.frame.radius;
    for (name, scale, offset) in [
        ("a unit of 2^20", 2f64.powi(20), DVec3::ZERO),
        ("a unit of 2^-20", 2f64.powi(-20), DVec3::ZERO),
    ] {
        // Every number is the same but for its exponent.
        let (_, other) = run(name, &moved(&scene, scale, offset), &config);
        assert_eq!(other.samples, reference.samples, "{name}");
        assert!(other.gaussians == reference.gaussians, "{name}");
    }
    for (name, scale, offset) in [
        ("a unit of 1e6", 1e6, DVec3::ZERO),
        ("a unit of 1e-6", 1e-6, DVec3::ZERO),
        (
            "1e5 R away",
            1.0,
            DVec3::new(0.6, -0.5, 0.62) * 1e5 * radius,
        ),
        (
            "in a unit of 1e-6, 1e5 R away",
            1e-6,
            DVec3::new(0.6, -0.5, 0.62) * 0.1 * radius,
        ),
    ] {
        let (_, other) = run(name, &moved(&scene, scale, offset), &config);
        for (a, b) in other.samples.iter().zip(&reference.samples) {
            let difference = (a.loss - b.loss).abs();
            assert!(difference < 2e-3 * b.loss, "{name}: {a:?} {b:?}");
        }
        let pairs = other.gaussians.means.iter().zip(&reference.gaussians.means);
        let n = other.gaussians.len() as f32;
        let mean = pairs.map(|(a, b)| a.distance(*b)).sum::<f32>() / n;
        assert!(mean < 1e-4, "{name}: means differ by {mean} R");
    }
}

#[test]
fn a_test_view_that_is_a_training_view_is_evaluated_like_any_other() {
    let mut scene = small_scene();
    scene.test.truncate(1);
    scene.test.push(scene.train[0].clone());
    let folder = tempfile::tempdir().expect("a folder");
    let run = RunDir::create(&folder.path().join("run"), &config(60), false).expect("fresh");
    let source = SceneSource::Builtin { width: 48 };
    let _alone = context();
    let job = TrainJob::new(source, config(60)).expect("a job");
    let gpu = gspotential::gpu::Gpu::open().expect("an adapter");
    let (options, stop) = (EvalOptions::default(), Stop::unheard());
    let evaluation = pipeline::train(
        &gpu,
        &scene,
        &job,
        Default::default(),
        &options,
        &run,
        &stop,
    )
    .expect("trains");
    let psnr: Vec<f64> = evaluation.views.iter().filter_map(|v| v.psnr).collect();
    assert_eq!(psnr.len(), 2);
    assert!(psnr[1] > psnr[0], "{psnr:?}");
    assert!(psnr.iter().all(|p| (5.0..60.0).contains(p)), "{psnr:?}");
}

#[test]
fn a_camera_far_away_clips_nothing_that_the_others_have_before_them() {
    let mut scene = small_scene();
    let (eyes, c) = ring();
    // A wall so near the first camera that a hundredth of 30 radii lies behind it.
    let camera = scene.train[0].camera.clone();
    let reach = (eyes[0] - c).length();
    let side = camera.forward().cross(camera.up());
    for i in -20..=20 {
        for j in -20..=20 {
            let place =
                camera.forward() * 0.2 + (side * f64::from(i) + camera.up() * f64::from(j)) * 0.01;
            scene.cloud.positions.push(eyes[0] + place * reach);
            scene.cloud.colors.push([200, 0, 0]);
        }
    }
    scene.cloud.confidence = None;
    let config = config(1);
    let covered = |scene: &Scene, robust: bool| {
        let cameras: Vec<Camera> = scene.train.iter().map(|v| v.camera.clone()).collect();
        let focus = Focus::find(&cameras, &scene.cloud).expect("a sphere");
        let mut frame = focus.frame();
        if !robust {
            frame.extent = frame.radius;
        }
        let near = frame.near(config.model.near);
        let views = (&cameras[..1], &cameras[..]);
        let splats = splat_views(&scene.cloud, &frame, views, &config.splat, near);
        splats.expect("splats")[0].coverage()
    };
    let before = covered(&scene, true);
    let eye = c + (eyes[1] - c) * 30.0;
    let mut far = scene.train[1].clone();
    far.camera = camera.looking_at("far.png".to_owned(), eye, c, camera.up());
    scene.train.push(far);
    let after = covered(&scene, true);
    assert!(after > before - 0.02, "{before} {after}");
    // With the greatest distance in its place, the wall is gone.
    let clipped = covered(&scene, false);
    assert!(clipped < after - 0.1, "{clipped} {after}");
}
