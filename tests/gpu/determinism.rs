//! Same seed, same bits: whole runs against one another, whatever the threads and buffer sizes.

use std::path::Path;

use gspotential::config::Config;
use gspotential::eval::EvalOptions;
use gspotential::files::digest::sha256;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::Gpu;
use gspotential::pipeline::{self, Prepared, TrainJob, prepare};
use gspotential::run::{Evaluation, Metrics, RunDir, Seconds, Stop};
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{Scene, SceneSource};
use gspotential::train::{Trained, Trainer};

use super::rig::context;
use super::views::print;

const WIDTH: u32 = 72;

fn small_scene() -> Scene {
    scene(&BuiltinOptions {
        width: WIDTH,
        n_test: 2,
        pixel_step: 2,
        ..BuiltinOptions::default()
    })
}

/// The paper's method and the parts beyond it, with everything happening early.
fn config() -> Config {
    let mut config = Config::preset("paper").expect("a preset");
    config.iterations = 140;
    config.scene.max_points = Some(500);
    config.field.n_candidates = 256;
    config.views.count = 6;
    config.model.sh_degree = 3;
    config.model.sh_interval = 30;
    config.densify.start = 20;
    config.densify.end = 130;
    config.densify.interval = 20;
    config.densify.opacity_reset_interval = 70;
    config.densify.opacity_reset_end = 120;
    config.coverage.start = 60;
    config.coverage.interval = 20;
    config.coverage.tau_min = 1.5;
    config.coverage.tau_max = 4.0;
    config.dropout.rate_end = 0.4;
    config.loss.fill_weight = 0.3;
    config.shell.count = 100;
    config.validate().expect("allowed values");
    config
}

/// `point_cloud.ply`, and `metrics.json` and `eval.json` without times and memory.
fn run(scene: &Scene, root: &Path, eval_every: Option<u32>) -> (Vec<u8>, String, String) {
    let run = RunDir::create(root, &config(), false).expect("a fresh folder");
    let source = SceneSource::Builtin { width: WIDTH };
    let job = TrainJob {
        eval_every,
        ..TrainJob::new(source, config()).expect("a job")
    };
    let gpu = Gpu::open().expect("an adapter");
    let (options, stop) = (EvalOptions::default(), Stop::unheard());
    pipeline::train(&gpu, scene, &job, Default::default(), &options, &run, &stop).expect("trains");
    let mut metrics = run.metrics().expect("written");
    metrics.seconds = Seconds::default();
    metrics.memory = Default::default();
    check_curve(&metrics, &run.evaluation().expect("written"), eval_every);
    metrics.curve.clear();
    let plans = metrics.model_size.iter().filter_map(|m| m.plan);
    let n = |count: fn(&gspotential::train::PlanCounts) -> usize| {
        plans.clone().map(|p| count(&p)).sum()
    };
    let counts: [usize; 4] = [
        n(|p| p.cloned),
        n(|p| p.split),
        n(|p| p.pruned_opacity + p.pruned_size),
        n(|p| p.pruned_anisotropy),
    ];
    assert!(
        counts.iter().all(|c| *c > 0),
        "too little happens: {counts:?}"
    );
    let mut evaluation = run.evaluation().expect("written");
    evaluation.train_s = None;
    (
        std::fs::read(run.point_cloud()).expect("written"),
        format!("{metrics:?}"),
        format!("{evaluation:?}"),
    )
}

#[test]
fn runs_with_one_seed_are_equal_to_the_byte_whatever_the_threads_and_the_curve() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = small_scene();
    // For the memory of this machine, not for the runs: each opens the adapter itself.
    let _alone = context();
    let first = run(&scene, &folder.path().join("first"), None);
    // Measured on the way where nothing else is due, too.
    let second = run(&scene, &folder.path().join("second"), Some(23));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build();
    let third = pool
        .expect("threads")
        .install(|| run(&scene, &folder.path().join("third"), None));
    print(&format!(
        "point_cloud.ply of three runs: {:.16}, {:.16}, {:.16}\n",
        sha256(&first.0),
        sha256(&second.0),
        sha256(&third.0)
    ));
    for (which, other) in [("second", &second), ("other threads", &third)] {
        assert!(first.0 == other.0, "{which}: point_cloud.ply differs");
        assert_eq!(first.1, other.1, "{which}: metrics");
        assert_eq!(first.2, other.2, "{which}: evaluation");
    }
}

/// A point every `eval_every` iterations from the start, the last that of `eval.json`.
fn check_curve(metrics: &Metrics, evaluation: &Evaluation, eval_every: Option<u32>) {
    let Some(every) = eval_every else {
        return assert!(metrics.curve.is_empty());
    };
    let iterations: Vec<u32> = metrics.curve.iter().map(|p| p.iteration).collect();
    let end = config().iterations;
    let expected: Vec<u32> = (0..end).step_by(every as usize).chain([end]).collect();
    assert_eq!(iterations, expected);
    let psnr: Vec<f64> = metrics.curve.iter().filter_map(|p| p.psnr).collect();
    assert_eq!(psnr.last().copied(), evaluation.mean.psnr);
    // Training helps, and every point is of its own moment.
    assert!(
        psnr.len() == expected.len() && psnr[1] > psnr[0],
        "{psnr:?}"
    );
    assert!(psnr.windows(2).all(|pair| pair[0] != pair[1]), "{psnr:?}");
    let at_80 = metrics.model_size.iter().rfind(|m| m.iteration < 92);
    assert_eq!(
        Some(metrics.curve[4].n_gaussians),
        at_80.map(|m| m.n_gaussians)
    );
}

#[test]
fn a_run_whose_pairs_do_not_fit_at_first_is_equal_to_one_with_room() {
    let mut config = config();
    config.iterations = 90;
    config.scene.max_points = Some(150);
    // Not so strict that the wide ones below are all pruned.
    config.densify.max_scale = 10.0;
    let prepared = prepare(&small_scene(), &config, &mut Seconds::default()).expect("a sphere");
    let Prepared {
        supervision,
        mut start,
        ..
    } = prepared;
    // Wide enough to overflow.
    let widen = |g: &mut Gaussians| g.scales_log.iter_mut().for_each(|s| *s += 1.5);
    widen(&mut start);
    let ctx = context();
    let train = |pairs: Option<usize>, config: &Config| -> (Trained, bool) {
        let mut trainer =
            Trainer::new(&ctx.gpu, &ctx.kernels, &start, &supervision, config).expect("fits");
        if let Some(pairs) = pairs {
            trainer.reserve_pairs(pairs).expect("fits");
        }
        let before = trainer.pair_capacity();
        let trained = trainer.run(&mut ()).expect("trains");
        (trained, trainer.pair_capacity() > before)
    };
    let (tight, grew) = train(None, &config);
    assert!(grew, "nothing overflowed");
    let (roomy, grew) = train(Some(1 << 18), &config);
    assert!(!grew, "the other run overflowed, too");
    assert!(!tight.gaussians.is_empty(), "nothing is left to compare");
    assert_eq!(tight.samples, roomy.samples);
    assert_eq!(tight.plans, roomy.plans);
    assert!(tight.gaussians == roomy.gaussians, "Gaussians differ");
    let (other, _) = train(
        None,
        &Config {
            seed: 1,
            ..config.clone()
        },
    );
    assert!(tight.gaussians != other.gaussians, "the seed does nothing");
}
