//! Training poses that are off are refined with the Gaussians; without the switch nothing moves.

use gspotential::camera::json::read_cameras;
use gspotential::camera::{Camera, Frame, Motion};
use gspotential::config::Config;
use gspotential::eval::PoseErrors;
use gspotential::pipeline::{load_scene, prepare};
use gspotential::run::{RunDir, Seconds};
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{LoadOptions, Scene, SceneSource};
use gspotential::train::{PoseAdam, Trained, Trainer, pose_rates};

use crate::gpu::rig::context;
use crate::kit::keep::Keep;
use crate::kit::program::succeed;

fn config(iterations: u32, refine: bool) -> Config {
    let mut config = Config::preset("gspotential").expect("a preset");
    config.iterations = iterations;
    config.views.count = 6;
    config.scene.max_points = Some(3000);
    config.poses.refine = refine;
    config
}

/// The built-in scene with all training cameras off by 1 degree and 1 % of `R`, and the true ones.
fn jolted() -> (Scene, Vec<Camera>) {
    let mut scene = scene(&BuiltinOptions {
        width: 96,
        n_test: 1,
        ..BuiltinOptions::default()
    });
    let truth: Vec<Camera> = scene.train.iter().map(|v| v.camera.clone()).collect();
    let turn = 1f64.to_radians() / 3f64.sqrt();
    let shift = 0.01 * frame_of(&scene).radius / 3f64.sqrt();
    // Four corners of a tetrahedron: the mean motion is none.
    let signs = [
        [1.0, 1.0, 1.0],
        [1.0, -1.0, -1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0],
    ];
    for (view, [x, y, z]) in scene.train.iter_mut().zip(signs) {
        let [a, b, c] = [x, y, z].map(|sign| sign * turn);
        let [x, y, z] = [y, z, x].map(|sign| sign * shift);
        view.camera = view.camera.moved([a, b, c, x, y, z]);
    }
    (scene, truth)
}

fn frame_of(scene: &Scene) -> Frame {
    gspotential::pipeline::focus_of(scene).expect("a sphere").1
}

fn trained(scene: &Scene, config: &Config) -> (Frame, Trained) {
    let prepared = prepare(scene, config, &mut Seconds::default()).expect("prepares");
    let ctx = context();
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let trained = Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, config)
        .and_then(|mut trainer| trainer.run(&mut ()))
        .expect("trains");
    (prepared.frame, trained)
}

#[test]
fn refined_poses_come_nearer_to_the_truth_and_the_loss_falls() {
    let (scene, truth) = jolted();
    let mut config = config(400, true);
    let (frame, refined) = trained(&scene, &config);
    let errors = |cameras: &[Camera]| {
        let world = cameras.iter().map(|c| frame.camera_to_world(c));
        PoseErrors::of(&world.collect::<Vec<_>>(), &truth, &scene.cloud, &frame)
    };
    // Steps of no length are how the run would end with a gradient of no use.
    (config.poses.turn_lr, config.poses.shift_lr) = (0.0, 0.0);
    let (_, held) = trained(&scene, &config);
    let (before, after) = (errors(&held.cameras), errors(&refined.cameras));
    println!("{before:?}\n{after:?}");
    assert!((before.turn_deg - 1.0).abs() < 1e-6);
    assert!(after.pixels < before.pixels / 3.0);
    assert!(after.turn_deg < before.turn_deg / 2.0);
    assert!(after.shift < before.shift);
    let last = |trained: &Trained| -> f64 {
        let last = trained.samples.iter().rev().take(8);
        last.map(|s| s.real.l1).sum()
    };
    assert!(
        last(&refined) < 0.9 * last(&held),
        "{} {}",
        last(&refined),
        last(&held)
    );
}

#[test]
fn a_refinement_that_is_resumed_ends_with_the_same_bits() {
    let (scene, _) = jolted();
    let config = config(80, true);
    let prepared = prepare(&scene, &config, &mut Seconds::default()).expect("prepares");
    let ctx = context();
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let trainer =
        || Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config).expect("fits");
    let mut halfway = Keep::at(67);
    let whole = trainer().run(&mut halfway).expect("trains");
    let (state, buffers) = halfway.kept.expect("kept");
    // Through the form that checkpoints store it in.
    let json = serde_json::to_string(&state).expect("JSON");
    let mut resumed = trainer();
    let state = serde_json::from_str(&json).expect("JSON");
    resumed.restore(state, &buffers.concat()).expect("restores");
    let resumed = resumed.run(&mut ()).expect("trains");
    assert!(
        whole.cameras
            != prepared
                .supervision
                .real
                .iter()
                .map(|v| v.camera.clone())
                .collect::<Vec<_>>()
    );
    assert_eq!(whole.cameras, resumed.cameras);
    assert!(whole.gaussians == resumed.gaussians);
}

#[test]
fn adam_steps_against_the_gradient_by_its_rate_and_rates_fall_to_their_share() {
    let camera = jolted().1.remove(0);
    let gradient = [3.0, 0.0, 0.0, 0.0, 0.0, -1e-6];
    let moved = PoseAdam::default().step(&camera, gradient, [0.01, 0.02]);
    let expected = camera.moved([-0.01, 0.0, 0.0, 0.0, 0.0, 0.02]);
    assert!(moved.rotation.abs_diff_eq(expected.rotation, 1e-12));
    assert!(moved.translation.abs_diff_eq(expected.translation, 1e-9));

    let config = config(1000, true).poses;
    assert_eq!(pose_rates(&config, 0, 1000), [2e-3, 5e-4]);
    let [turn, shift] = pose_rates(&config, 500, 1000);
    assert!((turn - 2e-4).abs() < 1e-12 && (shift - 5e-5).abs() < 1e-12);
}

#[test]
fn a_run_with_refined_poses_writes_them_and_is_measured_in_its_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let gspotential = |line: &str| succeed(folder.path(), line);
    gspotential(
        "train --scene builtin:48 --iterations 30 --max-points 400 --set views.count=4 \
         --set field.n_candidates=128 --set scene.n_test=1 --refine-poses --out run",
    );
    let run = RunDir::open(&folder.path().join("run")).expect("a run");
    assert!(run.config().expect("a config").poses.refine);
    let source = SceneSource::Builtin { width: 48 };
    let options = LoadOptions::new(&run.config().expect("a config"));
    let scene = load_scene(&source, &options).expect("loads");
    let frame = frame_of(&scene);
    let written = read_cameras(&run.cameras()).expect("cameras");
    let changes = run.metrics().expect("metrics").refined_poses;
    assert_eq!(changes.len(), scene.train.len());
    for (change, view) in changes.iter().zip(&scene.train) {
        let mut own = written.iter().filter(|c| c.name == view.camera.name);
        let Motion { turn, shift } = own.next().expect("there").difference(&view.camera);
        assert!(own.next().is_none() && change.view == view.camera.name);
        assert!(turn > 1e-4 && (turn.to_degrees() - change.turn_deg).abs() < 1e-4);
        assert!((shift / frame.radius - change.shift).abs() < 1e-6);
    }
    let before = run.evaluation().expect("measured").mean;
    gspotential("eval run --again");
    assert_eq!(run.evaluation().expect("measured").mean, before);
}
