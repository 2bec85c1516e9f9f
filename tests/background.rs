//! Backgrounds that each iteration draws anew.

use glam::Vec3;
use gspotential::config::Config;
use gspotential::doctor::camera_of;
use gspotential::doctor::twin::cases::cameras;
use gspotential::gaussians::Gaussians;
use gspotential::scene::{Image, Mask, Outside, View};
use gspotential::train::{Supervision, Trainer, TrainingView, schedule};

use crate::gpu::rig::context;
use crate::hard::specimens::{self, noise_supervision};

fn config() -> Config {
    let mut config = specimens::config(3);
    config.loss.random_background = true;
    config.loss.ssim_weight = 0.0;
    config
}

#[test]
fn seed_and_iteration_decide_the_colour() {
    let config = config();
    let draw = |seed: u64, iteration| {
        let config = Config {
            seed,
            ..config.clone()
        };
        schedule::background(&config, iteration).expect("a colour")
    };
    assert_eq!(draw(0, 7), draw(0, 7));
    assert_ne!(draw(0, 7), draw(0, 8));
    assert_ne!(draw(0, 7), draw(1, 7));
    let mut sum = 0.0;
    for iteration in 0..1000 {
        for value in draw(0, iteration) {
            let level = 255.0 * value;
            assert!((level - level.round()).abs() < 1e-9 && (0.0..=1.0).contains(&value));
            sum += value;
        }
    }
    // The standard deviation of the mean is 0.005.
    assert!((sum / 3000.0 - 0.5).abs() < 0.025, "{}", sum / 3000.0);
    let off = specimens::config(3);
    assert_eq!(schedule::background(&off, 7), None);
}

/// A grey photograph whose subject is its first `n_subject` pixels.
fn view(n_subject: usize, outside: Outside) -> View {
    let camera = camera_of(&cameras()[0]);
    let (width, height) = (camera.width, camera.height);
    let n = (width * height) as usize;
    let color = |i: usize| if i < n_subject { [128; 3] } else { [0; 3] };
    View {
        camera,
        image: Image {
            width,
            height,
            rgb: (0..n).flat_map(color).collect(),
        },
        mask: Some(Mask {
            set: (0..n).map(|i| i < n_subject).collect(),
            outside,
        }),
        prior: None,
    }
}

/// L1 of the last of three iterations, of which nothing but the background is seen.
fn loss_of(view: TrainingView, config: &Config) -> f64 {
    let ctx = context();
    let supervision = Supervision {
        real: vec![view],
        ..noise_supervision(&cameras()[0])
    };
    // It lies far behind the camera.
    let start = Gaussians {
        means: vec![Vec3::new(130.0, -70.0, 110.0)],
        scales_log: vec![Vec3::splat(-9.0)],
        rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.0],
        sh: vec![0.0; 12],
        sh_degree: 1,
    };
    let trainer = Trainer::new(&ctx.gpu, &ctx.kernels, &start, &supervision, config);
    let trained = trainer.expect("fits").run(&mut ()).expect("trains");
    trained.samples.last().expect("a sample").real.l1
}

#[test]
fn a_cut_out_subject_stands_before_the_iterations_colour() {
    let color = schedule::background(&config(), 2).expect("a colour");
    let n = {
        let camera = camera_of(&cameras()[0]);
        (camera.width * camera.height) as usize
    };
    let grey = 128.0 / 255.0;
    let off_grey = color.map(|c: f64| (c - grey).abs()).iter().sum::<f64>() / 3.0;
    let of_black = color.iter().sum::<f64>() / 3.0;
    for targets_mib in [0, 1] {
        let mut config = config();
        config.render.targets_mib = Some(targets_mib);
        for n_subject in [0, n / 2, n] {
            let share = n_subject as f64 / n as f64;
            let view = view(n_subject, Outside::Background);
            let before_any = TrainingView::before_any_background(view.camera.clone(), &view);
            let loss = loss_of(before_any, &config);
            assert!(
                (loss - share * off_grey).abs() < 1e-5,
                "{n_subject}: {loss}"
            );
            // A target that shows black there does not follow.
            let fixed = TrainingView::of(view.camera.clone(), &view);
            let loss = loss_of(fixed, &config);
            let expected = share * off_grey + (1.0 - share) * of_black;
            assert!((loss - expected).abs() < 1e-5, "{n_subject}: {loss}");
        }
    }
}

#[test]
fn what_is_not_cut_out_keeps_its_target() {
    for outside in [Outside::Kept, Outside::Ignored] {
        let view = view(100, outside);
        let [own, usual] = [TrainingView::before_any_background, TrainingView::of]
            .map(|of| of(view.camera.clone(), &view));
        assert_eq!(own.goal, usual.goal);
        assert_eq!((own.masked, own.has_ground), (usual.masked, false));
        assert_eq!(own.total_weight, usual.total_weight);
    }
}
