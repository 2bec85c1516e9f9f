//! What a run finds out about its scene by virtual views that are held out.

use gspotential::config::Config;
use gspotential::doctor::twin::cases::{looking_at, random_scene};
use gspotential::doctor::twin::compare::held_l2;
use gspotential::doctor::twin::random::Random;
use gspotential::doctor::twin::raster::{backward, render};
use gspotential::doctor::{Context, gaussians_of};
use gspotential::gaussians::Gaussians;
use gspotential::metrics::{FloatImage, masked_psnr};
use gspotential::pipeline::{Prepared, prepare};
use gspotential::render::{Model, Renderer, ViewUniform};
use gspotential::run::Seconds;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{Image, Scene};
use gspotential::train::length::Settling;
use gspotential::train::trim::{cost, most, most_that_pays};
use gspotential::train::{SignalPoint, Trained, Trainer, TrainingView};

use crate::gpu::rig::context;
use crate::hard::specimens::noise_supervision;
use crate::kit::keep::{Keep, same};
use crate::kit::program::{run, succeed};

fn small_scene() -> Scene {
    scene(&BuiltinOptions {
        width: 64,
        n_test: 1,
        pixel_step: 2,
        ..BuiltinOptions::default()
    })
}

/// The default with little to do, in which much happens.
fn config() -> Config {
    let mut config = Config::preset("gspotential").expect("a preset");
    config.iterations = 60;
    config.scene.max_points = Some(600);
    config.field.n_candidates = 256;
    config.views.count = 12;
    config.model.sh_degree = 1;
    config.model.sh_interval = 20;
    config.shell.count = 100;
    config.need.hold_out = 4;
    config.need.interval = 20;
    // All of it is stated but where a test says otherwise.
    config.need.ends = false;
    config.need.settle_share = 0.0;
    config.need.prune = false;
    config.validate().expect("allowed values");
    config
}

fn prepared(scene: &Scene, config: &Config) -> Prepared {
    prepare(scene, config, &mut Seconds::default()).expect("a sphere")
}

fn names(views: &[TrainingView]) -> Vec<String> {
    views.iter().map(|view| view.camera.name.clone()).collect()
}

fn trained(prepared: &Prepared, config: &Config) -> Trained {
    let ctx = context();
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let mut trainer =
        Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, config).expect("fits");
    trainer.run(&mut ()).expect("trains")
}

#[test]
fn one_in_so_many_virtual_views_is_held_out_and_the_others_stay_as_they_were() {
    let scene = small_scene();
    let mut config = config();
    let held = prepared(&scene, &config);
    let expected = ["virtual_003", "virtual_007", "virtual_011"];
    assert_eq!(names(&held.supervision.held_out), expected);
    assert_eq!(held.virtual_cameras.len(), 12);
    config.need.hold_out = 0;
    let whole = prepared(&scene, &config);
    assert!(whole.supervision.held_out.is_empty());
    let mut others = names(&whole.supervision.virtual_views);
    others.retain(|name| !expected.contains(&name.as_str()));
    assert_eq!(names(&held.supervision.virtual_views), others);
    // Too few to hold one out of: said, and trained on.
    config.need.hold_out = 13;
    config.need.ends = true;
    let few = prepared(&scene, &config);
    assert!(few.supervision.held_out.is_empty());
    let warnings = few.warnings.join("; ");
    assert!(
        warnings.contains("no virtual view is held out"),
        "{warnings}"
    );
}

/// Mean PSNR of Gaussians at views over their pixels of full weight, by another way than training's.
fn visible_psnr(ctx: &Context, gaussians: &Gaussians, near: f64, views: &[TrainingView]) -> f64 {
    let model = Model::upload(&ctx.gpu, gaussians, gaussians.len()).expect("fits");
    let mut renderer = Renderer::new(&ctx.gpu, &ctx.kernels);
    let scores = views.iter().map(|view| {
        let uniform = ViewUniform::new(&view.camera, near, [0.0; 3]);
        let rendered = renderer.render(&model, &uniform).expect("renders");
        let texels: Vec<[u8; 4]> = view.goal.texels().iter().map(|t| t.to_le_bytes()).collect();
        let truth = Image {
            width: rendered.width,
            height: rendered.height,
            rgb: texels.iter().flat_map(|t| [t[0], t[1], t[2]]).collect(),
        };
        let visible: Vec<bool> = texels.iter().map(|t| t[3] == 255).collect();
        let render = FloatImage {
            width: rendered.width,
            height: rendered.height,
            rgb: &rendered.rgb,
        };
        let psnr = masked_psnr(&render, &truth, &visible).expect("of one size");
        psnr.expect("visible pixels")
    });
    scores.sum::<f64>() / views.len() as f64
}

#[test]
fn the_signal_is_the_psnr_of_views_that_are_not_trained_on_and_changes_no_bit() {
    let scene = small_scene();
    let config = config();
    let mut prepared = prepared(&scene, &config);
    let measured = trained(&prepared, &config);
    let iterations: Vec<u32> = measured.signal.iter().map(|p| p.iteration).collect();
    assert_eq!(iterations, [20, 40, 60]);
    let last = measured.signal[2];
    assert_eq!(last.n_gaussians, measured.gaussians.len());
    let supervision = &prepared.supervision;
    let psnr = |views| visible_psnr(&context(), &measured.gaussians, supervision.near, views);
    assert!((psnr(&supervision.held_out) - last.held_out).abs() < 1e-9);
    let photographs = last.photographs.expect("they have pixels");
    assert!((psnr(&supervision.real) - photographs).abs() < 1e-9);
    // Other views have another.
    assert!((psnr(&supervision.virtual_views) - last.held_out).abs() > 1e-3);
    // Without anything to measure the same is trained.
    prepared.supervision.held_out.clear();
    let alone = trained(&prepared, &config);
    assert!(alone.signal.is_empty());
    assert!(alone.gaussians == measured.gaussians && alone.samples == measured.samples);
}

#[test]
fn of_many_photographs_sixteen_are_measured() {
    let scene = small_scene();
    let mut config = config();
    config.views.count = 40;
    config.iterations = 20;
    let mut prepared = prepared(&scene, &config);
    let many = prepared.supervision.virtual_views[..21].to_vec();
    prepared.supervision.real = many;
    let measured = trained(&prepared, &config);
    let supervision = &prepared.supervision;
    let psnr = |views: &[TrainingView]| {
        visible_psnr(&context(), &measured.gaussians, supervision.near, views)
    };
    let evenly: Vec<TrainingView> = (0..16)
        .map(|i| supervision.real[i * 21 / 16].clone())
        .collect();
    let photographs = measured.signal[0].photographs.expect("they have pixels");
    assert!((psnr(&evenly) - photographs).abs() < 1e-9);
    assert!((psnr(&supervision.real) - photographs).abs() > 1e-3);
}

#[test]
fn contributions_are_those_of_the_reference_and_sum_to_what_the_images_show() {
    let twin = random_scene(60, 1, 5).gaussians;
    let camera = looking_at([0.0, 0.2, -2.5], [0.0; 3]).resized(61, 43);
    let mut supervision = noise_supervision(&camera);
    let mut random = Random::new(29);
    let view = &supervision.real[0];
    // Every pixel has a weight of its own.
    let goal: Vec<u32> = (0..61 * 43)
        .map(|_| (random.uniform(0.0, 256.0) as u32) << 24 | 1)
        .collect();
    let weights: Vec<f64> = goal.iter().map(|t| f64::from(t >> 24) / 255.0).collect();
    supervision.real = vec![TrainingView::masked(view.camera.clone(), &goal, 1.0)];

    let mut config = crate::hard::specimens::config(10);
    config.model.near = camera.near;
    let start = gaussians_of(&twin, 1);
    let ctx = context();
    let mut trainer =
        Trainer::new(&ctx.gpu, &ctx.kernels, &start, &supervision, &config).expect("fits");
    let ours = trainer.contributions(0).expect("fits");

    let rendered = render(&twin, &camera);
    let d_rgb: Vec<f64> = weights.iter().flat_map(|w| [0.0, 0.0, *w]).collect();
    let d_alpha = vec![0.0; weights.len()];
    let gradients = backward(&twin, &camera, &rendered, &d_rgb, &d_alpha);
    let reference: Vec<f64> = gradients.splats.iter().map(|splat| splat[7]).collect();
    assert!(reference.iter().filter(|c| **c > 0.1).count() > 20);
    let error = held_l2(&ours, &reference, 1e-3);
    assert!(error < 1e-3, "relative L2 {error:e}");
    // In every pixel they add up to the opacity.
    let shown: f64 = weights
        .iter()
        .zip(&rendered.alpha)
        .map(|(w, a)| w * a)
        .sum();
    let sum: f64 = ours.iter().sum();
    assert!((sum / shown - 1.0).abs() < 1e-3, "{sum} of {shown}");
}

#[test]
fn the_most_that_can_go_is_found_and_never_costs_more_than_is_allowed() {
    for (n, limit) in [
        (1000, 0),
        (1000, 137),
        (1000, 899),
        (1000, 5000),
        (1, 1),
        (0, 0),
    ] {
        let mut n_tried = 0;
        let found = most(n, 1.0, |k| {
            n_tried += 1;
            Ok(if k <= limit { 1.0 } else { 1.0 + 1e-9 })
        });
        let found = found.expect("nothing fails");
        let possible = limit.min(n * 9 / 10);
        assert!(found <= possible, "{found} of {possible}");
        assert!(possible - found <= n * 6 / 100, "{found} of {possible}");
        assert!(n_tried <= 4);
    }
    // One that rises and falls: what comes out has been tried.
    let mut tried = vec![0];
    let found = most(500, 1.0, |k| {
        let cost = if k % 3 == 0 { 2.0 } else { 0.5 };
        if cost <= 1.0 {
            tried.push(k);
        }
        Ok(cost)
    });
    assert!(tried.contains(&found.expect("nothing fails")));
    // A cost that is no number is none that is allowed.
    assert_eq!(most(500, 1.0, |_| Ok(f64::NAN)).expect("nothing fails"), 0);
}

#[test]
fn the_least_that_pays_is_tried_first_and_is_all_that_is_tried_where_it_costs_too_much() {
    // Points, how many may go, those tried.
    for (n, limit, expected) in [
        (1000, 0, &[50][..]),
        (1000, 49, &[50]),
        (1000, 99, &[50, 100]),
        (1000, 137, &[50, 100, 200, 150]),
        (1000, 5000, &[50, 100, 200, 400, 800, 900]),
        // Fewer than pay.
        (40, 5000, &[]),
    ] {
        let mut tried = Vec::new();
        let found = most_that_pays(n, 50, 1.0, |k| {
            tried.push(k);
            Ok(if k <= limit { 1.0 } else { 1.0 + 1e-9 })
        });
        let found = found.expect("nothing fails");
        assert_eq!(tried, expected);
        let possible = limit.min(n * 9 / 10);
        assert!(found == 0 || found <= possible, "{found} of {possible}");
        assert!(
            possible < 50 || n < 50 || possible - found <= n * 6 / 100,
            "{found} of {possible}"
        );
    }
}

#[test]
fn what_photographs_lose_counts_as_if_the_held_out_views_had_lost_it() {
    let point = |held_out: f64, photographs: f64| SignalPoint {
        iteration: 100,
        n_gaussians: 10,
        held_out,
        photographs: Some(photographs),
    };
    let before = point(20.0, 40.0);
    // An error of 1e-4 doubles: beside 1e-2 that is a hundredth, 0.0432 dB.
    let halved = cost(&before, &point(20.0, 40.0 - 10.0 * 2.0_f64.log10()));
    assert!((halved - 10.0 * 1.01_f64.log10()).abs() < 1e-9, "{halved}");
    // The held-out views' own fall counts where it is greater.
    let fallen = cost(&before, &point(19.9, 39.9));
    assert!((fallen - 0.1).abs() < 1e-9, "{fallen}");
    // Both rise: less than nothing, by the one that rises less.
    let risen = cost(&before, &point(20.1, 40.1));
    assert!(risen < 0.0 && risen > -0.01, "{risen}");
    let without = SignalPoint {
        photographs: None,
        ..point(19.9, 0.0)
    };
    assert!((cost(&before, &without) - 0.1).abs() < 1e-9);
}

fn signal(points: &[(u32, f64)]) -> Vec<SignalPoint> {
    let point = |&(iteration, held_out): &(u32, f64)| SignalPoint {
        iteration,
        n_gaussians: 1,
        held_out,
        photographs: None,
    };
    points.iter().map(point).collect()
}

#[test]
fn training_settles_when_the_last_third_has_brought_too_little() {
    let mut config = config();
    config.iterations = 1500;
    config.need.ends = true;
    config.need.settle_share = 0.2;
    config.need.least_gain_db = 0.1;
    let planned = |points: &[(u32, f64)]| {
        let Settling { from, until } = Settling::of(&config, &signal(points));
        (from, until)
    };
    let rising = [
        (100, 10.0),
        (200, 12.0),
        (300, 13.0),
        (400, 13.5),
        (500, 13.8),
        (600, 14.0),
    ];
    // 14.05 at 1,050 against 14.05 at 700: it had stopped before, but seven tenths of the iterations are done first.
    let flat = [700, 800, 900, 1000, 1050].map(|iteration| (iteration, 14.05));
    let stopped = [&rising[..], &flat].concat();
    assert_eq!(planned(&stopped[..10]), (1200, 1500));
    assert_eq!(planned(&stopped), (1050, 1313));
    // A measurement that happens to be low ends nothing: the best counts.
    let dip = [&rising[..], &[(700, 14.1), (900, 14.5), (1100, 14.0)]].concat();
    assert_eq!(planned(&dip), (1200, 1500));
    // What is measured later changes nothing, nor does a second measurement at one time.
    let later = [&stopped[..], &[(1050, 10.0), (1100, 20.0), (1313, 30.0)]].concat();
    assert_eq!(planned(&later), (1050, 1313));
    // A signal that falls has stopped rising.
    assert_eq!(planned(&[(100, 10.0), (1040, 9.0)]), (1200, 1500));
    assert_eq!(planned(&[(100, 10.0), (1050, 9.0)]), (1050, 1313));
    assert_eq!(planned(&[(1050, 10.0)]), (1200, 1500));
    config.need.ends = false;
    assert_eq!(Settling::of(&config, &signal(&stopped)).until, 1500);
}

#[test]
fn rates_fall_linearly_from_all_to_nothing() {
    let mut config = config();
    config.iterations = 100;
    config.need.settle_share = 0.2;
    let settling = Settling::of(&config, &[]);
    assert_eq!((settling.from, settling.until), (80, 100));
    assert_eq!(settling.prunings(), [80, 90]);
    assert_eq!([0, 79, 80].map(|i| settling.rate(i)), [1.0; 3]);
    assert_eq!([85, 90, 99].map(|i| settling.rate(i)), [0.75, 0.5, 0.05]);
    config.need.settle_share = 0.0;
    let settling = Settling::of(&config, &[]);
    assert_eq!([0, 99].map(|i| settling.rate(i)), [1.0; 2]);
}

#[test]
fn what_is_chosen_is_chosen_again_from_any_state() {
    let scene = small_scene();
    let mut config = config();
    config.need.ends = true;
    config.iterations = 56;
    // The last third of 40 iterations brings less than that.
    config.need.least_gain_db = 100.0;
    config.need.settle_share = 0.2;
    config.need.prune = true;
    config.need.tolerance_db = 0.5;
    let prepared = prepared(&scene, &config);
    let ctx = context();
    let trainer = || {
        let (start, supervision) = (&prepared.start, &prepared.supervision);
        Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config).expect("fits")
    };
    let run = |mut trainer: Trainer<'_>, at: u32| {
        let mut keep = Keep::at(at);
        let trained = trainer.run(&mut keep).expect("trains");
        assert_eq!(keep.lengths.last(), Some(&trained.iterations));
        (trained, keep.kept)
    };
    let (whole, _) = run(trainer(), 0);
    assert_eq!(whole.iterations, 50);
    let trims: Vec<u32> = whole.trims.iter().map(|t| t.iteration).collect();
    assert_eq!(trims, [40, 45]);
    let n_shell = 100;
    for trim in &whole.trims {
        assert!(trim.cost_db <= trim.allowed_db, "{trim:?}");
        assert!(trim.n_after <= trim.n_before && trim.n_after > n_shell);
        assert!((0.0..0.5).contains(&trim.contribution), "{trim:?}");
    }
    let pruned = whole.trims[0].n_before - whole.gaussians.len();
    assert!(pruned > 50, "{:?}", whole.trims);
    let spent: f64 = whole.trims.iter().map(|t| t.cost_db.max(0.0)).sum();
    assert!(spent <= 0.5 + 1e-12);
    // The shell stays whole.
    let far = whole.gaussians.means.iter().map(|m| m.length());
    let inner = prepared.supervision.frozen_beyond();
    assert_eq!(far.filter(|r| *r > inner).count(), n_shell);
    // What was said of the pruned set holds for it.
    let last = whole.signal.last().expect("measured");
    let (near, held_out) = (prepared.supervision.near, &prepared.supervision.held_out);
    let psnr = visible_psnr(&ctx, &whole.gaussians, near, held_out);
    // But for SH degrees that were lowered after it.
    let lowering = whole.lowering.expect("degrees to lower");
    assert!((lowering.allowed_db - (0.5 - spent)).abs() < 1e-12);
    assert!(lowering.cost_db <= lowering.allowed_db, "{lowering:?}");
    assert!(
        last.held_out - psnr <= lowering.cost_db + 1e-9,
        "{lowering:?}"
    );
    let has_first = |sh: &&[f32]| sh[3..].iter().any(|c| *c != 0.0);
    let n_first = whole.gaussians.sh.chunks(12).filter(has_first).count();
    let n_zero = whole.gaussians.len() - n_first;
    assert_eq!(lowering.of_degree, [n_zero, n_first, 0, 0]);
    assert!(n_zero > n_shell + 50 && n_first > 20, "{lowering:?}");
    // Before, at and after each decision.
    for at in [7, 39, 40, 41, 45, 47, 50] {
        let (other, kept) = run(trainer(), at);
        assert!(same(&whole, &other), "keeping after {at} changes the run");
        let (state, buffers) = kept.expect("kept");
        let mut trainer = trainer();
        trainer.restore(state, &buffers.concat()).expect("fits");
        assert!(same(&whole, &run(trainer, 0).0), "differs from {at} on");
    }
}

#[test]
fn where_none_could_go_when_rates_began_to_fall_none_is_tried_half_way() {
    let scene = small_scene();
    let mut config = config();
    config.need.settle_share = 0.2;
    let trims = |config: &Config| {
        let prepared = prepared(&scene, config);
        trained(&prepared, config).trims
    };
    // Only a size that is asked for prunes, and the file is far below it.
    config.need.max_mb = Some(100.0);
    let none = trims(&config);
    assert_eq!(none.len(), 1);
    assert_eq!((none[0].iteration, none[0].n_before), (48, none[0].n_after));
    // It is not at the first, and still not at the second.
    config.need.max_mb = Some(0.01);
    let some = trims(&config);
    assert!(some[0].n_after < some[0].n_before, "{some:?}");
    assert_eq!(some[1].iteration, 54);
}

#[test]
fn degrees_that_no_gaussian_has_are_left_out() {
    let whole = Gaussians {
        means: vec![glam::Vec3::ZERO; 2],
        sh: (0..96)
            .map(|i| if i % 48 < 12 { 1.0 + i as f32 } else { 0.0 })
            .collect(),
        sh_degree: 3,
        ..Gaussians::default()
    };
    let less = whole.clone().without_empty_degrees();
    assert_eq!((less.sh_degree, less.sh.len()), (1, 24));
    assert!(less.sh.iter().all(|c| *c > 0.0));
    let mut used = whole;
    used.sh[95] = 1e-30;
    assert_eq!(used.clone().without_empty_degrees(), used);
}

#[test]
fn a_budget_bounds_the_file_and_the_iterations_and_can_be_repeated() {
    let folder = tempfile::tempdir().expect("a folder");
    let read = |path: &str| std::fs::read(folder.path().join(path)).expect("a file");
    let json =
        |path: &str| -> serde_json::Value { serde_json::from_slice(&read(path)).expect("JSON") };
    let tiny = "train --scene builtin:32 --max-points 400 --set views.count=16 --set shell.count=100 \
                --set scene.n_test=1 --set iterations=60 --set need.interval=10";
    succeed(folder.path(), &format!("{tiny} --out free"));
    let budget = "--budget 20kB --budget 1h";
    let log = succeed(folder.path(), &format!("{tiny} {budget} --out tight")).log;
    let bytes = |run: &str| read(&format!("{run}/point_cloud.ply")).len();
    assert!(bytes("free") > 20_000, "{}", bytes("free"));
    assert!(bytes("tight") <= 20_000, "{}", bytes("tight"));
    assert!(log.contains("for the file to fit (need.max_mb)"), "{log}");
    let config = json("tight/config.json");
    assert_eq!(config["need"]["max_mb"], 0.02);
    assert_eq!(config["need"]["max_s"], 3600.0);
    assert!(
        config["need"]["iteration_s"].as_f64() > Some(0.0),
        "{config}"
    );
    // From its config alone, with the time of an iteration that stands there.
    let again = "train --scene builtin:32 --config tight/config.json --out again";
    succeed(folder.path(), again);
    assert!(read("tight/point_cloud.ply") == read("again/point_cloud.ply"));
    // Less time than one iteration takes leaves one, and says that it is too few.
    let short = format!("{tiny} --budget 1s --set need.iteration_s=10 --out short");
    let log = succeed(folder.path(), &short).log;
    assert!(
        log.contains("the budget has time for 1 iterations"),
        "{log}"
    );
    assert_eq!(json("short/metrics.json")["iterations"], 1);
}

#[test]
fn more_photographs_may_train_for_longer() {
    let folder = tempfile::tempdir().expect("a folder");
    let most = |options: &str| {
        let tiny = "train --scene builtin:32 --max-points 400 --set views.count=16 --set iterations=60 --dry-run";
        let keys = "--set need.iterations_a_photograph=12";
        succeed(folder.path(), &format!("{tiny} {keys} {options}")).stdout
    };
    let six = "--train-views train_00.png,train_01.png,train_02.png,train_03.png,test_00.png,test_10.png --test-views test_05.png";
    for (options, part) in [
        ("", "at most 60 iterations"),
        (six, "at most 72 iterations"),
        // What is stated holds.
        (&*format!("{six} --iterations 50"), "50 iterations"),
        (
            &*format!("{six} --set need.iteration_s=10 --budget 100s"),
            "at most 8 iterations",
        ),
    ] {
        let text = most(options);
        assert!(text.contains(part), "{options}: {text}");
    }
}

#[test]
fn virtual_views_count_for_less_beside_more_photographs() {
    let scene = small_scene();
    let mut config = config();
    config.iterations = 20;
    config.loss.virtual_photographs = 4;
    let four = prepared(&scene, &config);
    let mut six = prepared(&scene, &config);
    six.supervision.real = four.supervision.virtual_views[..6].to_vec();
    let mut stated = config.clone();
    stated.loss.virtual_photographs = 0;
    let same_set = |prepared: &Prepared, config: &Config, other: &Config| {
        let (one, other) = (trained(prepared, config), trained(prepared, other));
        one.gaussians == other.gaussians && one.samples == other.samples
    };
    assert!(same_set(&four, &config, &stated));
    assert!(!same_set(&six, &config, &stated));
    stated.loss.virtual_weight = config.loss.virtual_weight * 4.0 / 6.0;
    assert!(same_set(&six, &config, &stated));
}

#[test]
fn budgets_and_tolerances_that_are_none_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    for (option, part) in [
        ("--budget 20", "20MB, 3min"),
        ("--budget 0MB", "20MB, 3min"),
        ("--budget -1s", "-1"),
        ("--budget infMB", "20MB, 3min"),
        ("--budget 3days", "20MB, 3min"),
        ("--tolerance=-1dB", "0.1dB"),
        ("--tolerance much", "0.1dB"),
        ("--gaussians 5 --max-points 5", "--max-points"),
    ] {
        let ended = run(folder.path(), &format!("train --dry-run {option}"));
        assert_eq!(ended.code, Some(2), "{option}: {}", ended.log);
        assert!(ended.log.contains(part), "{option}: {}", ended.log);
    }
}
