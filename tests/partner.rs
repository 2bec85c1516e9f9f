//! Two sets of Gaussians that are trained beside each other.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};
use gspotential::camera::Camera;
use gspotential::config::Config;
use gspotential::doctor::twin::cases::{cameras, random_scene};
use gspotential::doctor::twin::random::Random;
use gspotential::doctor::{Context, Rig, gaussians_of};
use gspotential::gaussians::Gaussians;
use gspotential::pipeline::prepare;
use gspotential::render::ViewUniform;
use gspotential::run::Seconds;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::train::partner::apart::apart;
use gspotential::train::partner::ellipse::Ellipse;
use gspotential::train::trainer::StepViews;
use gspotential::train::{State, Supervision, Trained, Trainer, TrainingView, schedule};

use crate::gpu::rig::context;
use crate::hard::specimens::{self, noise_supervision};
use crate::kit::keep::{Keep, same};

/// A training of both sets from the first iteration on.
fn config(iterations: u32) -> Config {
    let mut config = specimens::config(iterations);
    config.model.sh_degree = 0;
    config.densify.enabled = false;
    config.coverage.prune = false;
    config.loss.random_background = true;
    config.partner.enabled = true;
    config.partner.start = 0;
    config.partner.weight = 0.7;
    config.validate().expect("allowed values");
    config
}

/// The same of one set, whose virtual view is as the pseudo view.
fn alone(config: &Config) -> Config {
    let mut alone = config.clone();
    alone.partner.enabled = false;
    alone.loss.virtual_weight = config.partner.weight;
    alone
}

fn start(seed: u64) -> Gaussians {
    gaussians_of(&random_scene(300, 0, seed).gaussians, 0)
}

/// Everything that a step changes.
fn bytes(trainer: &Trainer<'_>) -> Vec<u8> {
    let buffers: Result<Vec<Vec<u8>>, _> = trainer.buffers().collect();
    buffers.expect("reads").concat()
}

fn supervision() -> Supervision {
    noise_supervision(&cameras()[0])
}

/// A trainer of both sets, which start from `own` and `other`.
fn trainer_of<'a>(
    ctx: &'a Context,
    own: &Gaussians,
    other: &Gaussians,
    supervision: &'a Supervision,
    config: &'a Config,
) -> Trainer<'a> {
    let new = |start| Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, config);
    let mut trainer = new(own).expect("fits");
    let own_bytes = bytes(&trainer);
    let half = own_bytes.len() / 2;
    assert_eq!(own_bytes[..half], own_bytes[half..], "both start as one");
    let other_bytes = bytes(&new(other).expect("fits"));
    let state = trainer.state();
    let both = [&own_bytes[..half], &other_bytes[..half]].concat();
    trainer.restore(state, &both).expect("fits");
    trainer
}

/// What an iteration of one set alone leaves, with `goal` as the target image of its virtual view.
fn step_alone(
    ctx: &Context,
    start: &Gaussians,
    goal: Option<(&Camera, &[u32])>,
    config: &Config,
) -> Vec<u8> {
    let mut supervision = supervision();
    let view = goal.map(|(camera, goal)| TrainingView::photograph(camera.clone(), goal));
    supervision.virtual_views = view.into_iter().collect();
    let config = alone(config);
    let trainer = Trainer::new(&ctx.gpu, &ctx.kernels, start, &supervision, &config);
    let mut trainer = trainer.expect("fits");
    step_with_room(&mut trainer, 0);
    bytes(&trainer)
}

/// Takes an iteration, again if it did not fit.
fn step_with_room(trainer: &mut Trainer<'_>, iteration: u32) -> StepViews {
    let before = bytes(trainer);
    loop {
        let views = trainer.step(iteration, None);
        if trainer.make_room().expect("no fault").is_none() {
            assert!(bytes(trainer) != before, "nothing was learned");
            return views;
        }
    }
}

/// The render of a set as a target image, rounded on the host.
fn goal_of(ctx: &Context, start: &Gaussians, camera: &Camera, config: &Config) -> Vec<u32> {
    let near = supervision().near;
    let background = schedule::background(config, 0).unwrap_or(config.model.background);
    let view = ViewUniform::new(camera, near, background);
    let mut rig = Rig::new(ctx, start, view, 0).expect("fits");
    let rendered = rig.forward(ctx).expect("renders");
    let level = |c: &f32| (255.0 * c.clamp(0.0, 1.0) + 0.5) as u8;
    let texel = |rgb: &[f32]| {
        let [r, g, b] = [level(&rgb[0]), level(&rgb[1]), level(&rgb[2])];
        u32::from_le_bytes([r, g, b, 255])
    };
    rendered.rgb.chunks_exact(3).map(texel).collect()
}

#[test]
fn each_set_learns_from_the_photograph_and_from_the_others_render_held_constant() {
    let ctx = context();
    let config = config(3);
    let (own, other, supervision) = (start(50), start(51), supervision());
    let mut both = trainer_of(&ctx, &own, &other, &supervision, &config);
    let views = step_with_room(&mut both, 0);
    assert!(views.pseudo_view);
    let after = bytes(&both);
    let (own_after, other_after) = after.split_at(after.len() / 2);

    let cameras: Vec<Camera> = supervision.real.iter().map(|v| v.camera.clone()).collect();
    let camera = Ellipse::through(&cameras).expect("an ellipse").camera(0, 0);
    let goal = |of: &Gaussians| goal_of(&ctx, of, &camera, &config);
    let step = |of: &Gaussians, goal: &[u32]| step_alone(&ctx, of, Some((&camera, goal)), &config);
    let (own_goal, other_goal) = (goal(&own), goal(&other));
    assert!(own_after == step(&own, &other_goal), "the first set");
    assert!(other_after == step(&other, &own_goal), "the second set");
    // Other targets leave something else: its own render, and the other's one level brighter in a pixel.
    assert!(own_after != step(&own, &own_goal));
    let mut off = other_goal.clone();
    let middle = off.len() / 2;
    off[middle] ^= 1;
    assert!(own_after != step(&own, &off));
    // So does a background that is not the photograph's.
    let mut black = config.clone();
    black.loss.random_background = false;
    let black_goal = goal_of(&ctx, &other, &camera, &black);
    assert!(own_after != step(&own, &black_goal));
}

#[test]
fn before_the_start_each_set_learns_from_the_photograph_alone() {
    let ctx = context();
    let mut config = config(3);
    config.partner.start = 1;
    let (own, other, supervision) = (start(50), start(51), supervision());
    let mut both = trainer_of(&ctx, &own, &other, &supervision, &config);
    assert!(!step_with_room(&mut both, 0).pseudo_view);
    let first = bytes(&both);
    let expected = [&own, &other].map(|of| step_alone(&ctx, of, None, &config));
    assert!(first == expected.concat());
    // The next one is drawn to the other.
    assert!(step_with_room(&mut both, 1).pseudo_view);
}

#[test]
fn sets_that_start_as_one_come_apart_by_dropout() {
    let ctx = context();
    let mut config = config(3);
    let (own, supervision) = (start(50), supervision());
    let differ = |config: &Config| {
        let mut both = trainer_of(&ctx, &own, &own, &supervision, config);
        step_with_room(&mut both, 0);
        let after = bytes(&both);
        after[..after.len() / 2] != after[after.len() / 2..]
    };
    assert!(!differ(&config));
    config.dropout.rate_start = 0.3;
    config.dropout.rate_end = 0.3;
    assert!(differ(&config));
}

#[test]
fn a_step_that_one_set_has_no_room_for_is_taken_again_by_both() {
    let ctx = context();
    let config = config(7);
    let (own, mut other, supervision) = (start(50), start(51), supervision());
    for scales in &mut other.scales_log {
        *scales = Vec3::splat(0.0);
    }
    let mut trainer = trainer_of(&ctx, &own, &other, &supervision, &config);
    let (state, first) = (trainer.state(), bytes(&trainer));
    let held = ctx.gpu.live_bytes();
    let mut run = || {
        trainer.restore(state.clone(), &first).expect("fits");
        let trained = trainer.run(&mut ()).expect("trains");
        (trained, bytes(&trainer), ctx.gpu.live_bytes())
    };
    let (short_of_room, after, grown) = run();
    assert!(
        grown > held + held / 10,
        "{grown} for {held}: nothing was short of room"
    );
    let (with_room, after_again, still) = run();
    assert_eq!(still, grown);
    assert!(same(&short_of_room, &with_room));
    assert!(after == after_again);
}

/// Whether no other mean is near, the long way.
fn far_from_all(mean: Vec3, others: &[Vec3], distance: f64) -> bool {
    let near = |other: &Vec3| mean.as_dvec3().distance(other.as_dvec3()) <= distance;
    !others.iter().any(near)
}

#[test]
fn gaussians_stand_apart_where_none_of_the_others_is_within_the_distance() {
    let mut random = Random::new(3);
    let mut draw = |n: usize| -> Vec<Vec3> {
        let mut value = || random.uniform(-1.0, 1.0) as f32;
        (0..n)
            .map(|_| Vec3::new(value(), value(), value()))
            .collect()
    };
    let (means, others) = (draw(400), draw(300));
    for distance in [0.05, 0.15, 0.25] {
        let expected = |distance| -> Vec<bool> {
            let far = |mean: &Vec3| far_from_all(*mean, &others, distance);
            means.iter().map(far).collect()
        };
        let found = apart(&means, &others, distance);
        assert_eq!(found, expected(distance));
        let farther = expected(1.1 * distance);
        assert!(found != farther, "the cases tell distances apart");
        assert!(found.contains(&true) && found.contains(&false));
    }
    // That far exactly is within; what is no number has no neighbours and is none.
    let at = |x: f32| Vec3::new(x, 0.0, 0.0);
    assert_eq!(apart(&[at(0.0)], &[at(0.5)], 0.5), [false]);
    assert_eq!(apart(&[at(0.0)], &[at(0.5)], 0.49), [true]);
    assert_eq!(
        apart(&[at(0.0), at(f32::NAN)], &[at(f32::NAN)], 9.0),
        [true; 2]
    );
    assert_eq!(apart(&[at(0.0)], &[], 9.0), [true]);
    // Many at one place.
    assert_eq!(
        apart(&vec![at(1.0); 3000], &vec![at(1.1); 3000], 0.2),
        vec![false; 3000]
    );
}

#[test]
fn both_sets_lose_what_stands_apart_as_they_were_before() {
    let ctx = context();
    let mut config = config(2);
    config.optimizer.mean_lr_start = 1e-12;
    config.optimizer.mean_lr_end = 1e-12;
    config.partner.prune_interval = 1;
    config.partner.prune_distance = 0.1;
    let (own, other, supervision) = (start(50), start(51), supervision());
    let mut trainer = trainer_of(&ctx, &own, &other, &supervision, &config);
    let trained = trainer.run(&mut ()).expect("trains");
    let stays = |of: &Gaussians, others: &Gaussians| -> Vec<Vec3> {
        let near = |mean: &&Vec3| !far_from_all(**mean, &others.means, 0.1);
        of.means.iter().filter(near).copied().collect()
    };
    let (own_left, other_left) = (stays(&own, &other), stays(&other, &own));
    assert!(own_left.len() < own.len() && !own_left.is_empty());
    let distance = |(a, b): (&Vec3, &Vec3)| a.distance(*b);
    assert_eq!(trained.gaussians.len(), own_left.len());
    let moved = trained.gaussians.means.iter().zip(&own_left).map(distance);
    assert!(moved.fold(0.0, f32::max) < 1e-6);
    let partner = trainer.state().partner.expect("a partner");
    assert_eq!(partner.n_gaussians, other_left.len());
    let after = bytes(&trainer);
    let geometry: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&after[after.len() / 2..]);
    let means = geometry.iter().map(|v| Vec3::new(v[0], v[1], v[2]));
    let means: Vec<Vec3> = means.take(other_left.len()).collect();
    let moved = means.iter().zip(&other_left).map(distance);
    assert!(moved.fold(0.0, f32::max) < 1e-6);
    let counts: Vec<usize> = trained
        .plans
        .iter()
        .map(|p| p.counts.pruned_apart)
        .collect();
    assert_eq!(counts, [own.len() - own_left.len()]);
}

/// A training in which both sets are split, pruned and reset.
fn eventful() -> Config {
    let mut config = Config::preset("corgs").expect("a preset");
    for setting in [
        "iterations=60",
        "scene.max_points=100",
        "field.n_candidates=128",
        "model.sh_interval=5",
        "densify.start=5",
        "densify.end=55",
        "densify.interval=10",
        "densify.gradient_threshold=1e-3",
        "densify.max_gaussians=400",
        "densify.opacity_reset_interval=30",
        "dropout.rate_end=0.3",
        "shell.count=100",
        "partner.start=7",
        "partner.prune_interval=15",
        "partner.prune_distance=0.1",
    ] {
        config = config.set(setting).expect("a setting");
    }
    config
}

#[test]
fn two_sets_go_on_from_a_state_to_the_bit_and_no_part_of_it_is_idle() {
    let ctx = context();
    let scene = scene(&BuiltinOptions {
        width: 32,
        n_test: 1,
        pixel_step: 2,
        ..BuiltinOptions::default()
    });
    let config = eventful();
    let prepared = prepare(&scene, &config, &mut Seconds::default()).expect("a sphere");
    let trainer = || {
        let (start, supervision) = (&prepared.start, &prepared.supervision);
        Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config).expect("fits")
    };
    type Kept = Option<(State, Vec<Vec<u8>>)>;
    let run = |mut trainer: Trainer<'_>, at: u32| -> (Trained, Kept) {
        let mut keep = Keep::at(at);
        (trainer.run(&mut keep).expect("trains"), keep.kept)
    };
    let resumed = |(state, buffers): (State, Vec<Vec<u8>>)| {
        let mut trainer = trainer();
        trainer.restore(state, &buffers.concat()).expect("fits");
        run(trainer, 0).0
    };
    let (whole, _) = run(trainer(), 0);
    let count = |of: fn(&gspotential::train::PlanCounts) -> usize| -> usize {
        whole.plans.iter().map(|plan| of(&plan.counts)).sum()
    };
    assert!(count(|c| c.pruned_apart) > 0 && count(|c| c.cloned + c.split) > 0);
    assert!(whole.samples.last().expect("a sample").virt.is_some());
    let shell = prepared.supervision.shell.expect("a shell");
    let is_far = |mean: &&Vec3| f64::from(mean.length()) > shell.inner_radius();
    let n_far = whole.gaussians.means.iter().filter(is_far).count();
    assert_eq!(n_far, 100, "the far shell stays");
    // Between two looks, after prunings, a plan and a reset, and at the end.
    for at in [13, 30, 45, 60] {
        let (other, kept) = run(trainer(), at);
        assert!(same(&whole, &other), "keeping after {at} changes the run");
        assert!(
            same(&whole, &resumed(kept.expect("kept"))),
            "differs from {at} on"
        );
    }
    let (state, buffers) = run(trainer(), 27).1.expect("kept");
    assert!(
        buffers[0] != buffers[buffers.len() / 2],
        "the sets have come apart"
    );
    for (i, _) in buffers.iter().enumerate() {
        let mut altered = buffers.clone();
        altered[i]
            .iter_mut()
            .skip(3)
            .step_by(4)
            .for_each(|byte| *byte ^= 1);
        let other = resumed((state.clone(), altered));
        assert!(
            !same(&whole, &other),
            "buffer {i} of {} is idle",
            buffers.len()
        );
    }
    // A state of one set is none of two, nor the other way round.
    let lonely = State {
        partner: None,
        ..state.clone()
    };
    let error = trainer().restore(lonely, &[]).unwrap_err().to_string();
    assert!(error.contains("do not fit this run"), "{error}");
    let single = alone(&config);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let mut one = Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &single).expect("fits");
    assert!(one.restore(state, &buffers.concat()).is_err());
}

/// A camera at `eye` that looks at the origin, y up.
fn camera_at(eye: DVec3) -> Camera {
    let camera = Camera {
        name: "any".into(),
        width: 60,
        height: 40,
        fx: 50.0,
        fy: 50.0,
        cx: 30.0,
        cy: 20.0,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    camera.looking_at("any".into(), eye, DVec3::ZERO, DVec3::Y)
}

fn ellipse_of(eyes: &[DVec3]) -> Ellipse {
    let cameras: Vec<Camera> = eyes.iter().map(|eye| camera_at(*eye)).collect();
    Ellipse::through(&cameras).expect("an ellipse")
}

#[test]
fn pseudo_cameras_stand_on_the_ellipse_of_the_training_cameras() {
    // 40 on one of half axes 1.2 and 0.8, turned by 30 degrees, in a plane that all look down from.
    let (sin, cos) = (PI / 6.0).sin_cos();
    let on_ring = |k: usize| {
        let angle = 2.0 * PI * (k as f64 + 0.5) / 40.0;
        let (a, b) = (1.2 * angle.cos(), 0.8 * angle.sin());
        DVec3::new(cos * a - sin * b, 0.3, sin * a + cos * b)
    };
    let eyes: Vec<DVec3> = (0..40).map(on_ring).collect();
    let ellipse = ellipse_of(&eyes);
    let [long, short] = ellipse.axes;
    // Nine of ten cameras are less far along an axis: |cos| of a uniform angle is below sin(81 degrees).
    let reach = (81.0_f64).to_radians().sin();
    assert!((long.length() / (1.2 * reach) - 1.0).abs() < 0.02, "{long}");
    assert!(
        (short.length() / (0.8 * reach) - 1.0).abs() < 0.02,
        "{short}"
    );
    assert!(long.normalize().dot(DVec3::new(cos, 0.0, sin)).abs() > 0.999);
    assert!((ellipse.height - 0.3).abs() < 1e-9);
    for iteration in 0..50 {
        let camera = ellipse.camera(0, iteration);
        let eye = camera.center();
        let (a, b) = (
            eye.dot(long) / long.length_squared(),
            eye.dot(short) / short.length_squared(),
        );
        assert!((a * a + b * b - 1.0).abs() < 1e-9 && (eye.y - 0.3).abs() < 1e-9);
        assert!(camera.forward().dot(-eye.normalize()) > 1.0 - 1e-12);
        assert!(camera.up().y > 0.5);
        assert_eq!((camera.width, camera.height), (60, 40));
    }
    assert_eq!(ellipse.camera(0, 7), ellipse.camera(0, 7));
    assert_ne!(ellipse.camera(0, 7), ellipse.camera(0, 8));
    assert_ne!(ellipse.camera(0, 7), ellipse.camera(1, 7));
}

#[test]
fn pseudo_cameras_rise_and_fall_by_a_tenth_of_the_cameras_heights() {
    // Opposite ones are at one height, so that up is y.
    let at = |k: u32| {
        let angle = 2.0 * PI * f64::from(k) / 22.0;
        DVec3::new(angle.cos(), 0.2 + 0.05 * f64::from(k % 11), angle.sin())
    };
    let eyes: Vec<DVec3> = (0..22).map(at).collect();
    let ellipse = ellipse_of(&eyes);
    assert!((ellipse.height - 0.45).abs() < 1e-9, "{}", ellipse.height);
    // Those that a tenth are lower or higher than lie 0.2 from the mean.
    let [low, high] = ellipse.rise;
    assert!(
        (low + 0.02).abs() < 1e-9 && (high - 0.02).abs() < 1e-9,
        "{low} {high}"
    );
}

/// Holds pseudo cameras all around to distances like those of training cameras.
fn check_distances(ellipse: &Ellipse) {
    for k in 0..32 {
        let camera = ellipse.at(2.0 * PI * f64::from(k) / 32.0);
        assert!(camera.rotation.is_finite() && camera.translation.is_finite());
        let distance = camera.center().length();
        assert!((0.3..2.0).contains(&distance), "{ellipse:?}: {distance}");
    }
}

#[test]
fn few_cameras_have_pseudo_cameras_at_a_distance_from_the_focus() {
    let layouts: [&[DVec3]; 5] = [
        // One, two opposite ones, a short arc, all overhead, all at one place.
        &[DVec3::new(0.0, 0.2, 1.0)],
        &[DVec3::new(0.0, 0.0, 1.0), DVec3::new(0.0, 0.0, -1.0)],
        &[
            DVec3::new(-0.1, 0.1, 1.0),
            DVec3::new(0.0, 0.1, 1.0),
            DVec3::new(0.1, 0.1, 1.0),
        ],
        &[DVec3::new(0.01, 1.0, 0.0), DVec3::new(0.0, 1.0, 0.01)],
        &[DVec3::new(0.6, 0.5, 0.6); 3],
    ];
    for eyes in layouts {
        check_distances(&ellipse_of(eyes));
    }
    // Above the focus, but looking to the side.
    let aside = |x: f64| {
        let eye = DVec3::Y;
        camera_at(eye + DVec3::X).looking_at(
            "aside".into(),
            eye,
            eye + DVec3::new(x, 0.0, 0.0),
            eye,
        )
    };
    let overhead = Ellipse::through(&[aside(1.0), aside(-1.0)]).expect("an ellipse");
    check_distances(&overhead);
    assert!(Ellipse::through(&[]).is_err());
}
