//! Floaters and the dip statistic that says how many there are.

use std::collections::BTreeSet;

use glam::Vec3;
use gspotential::config::{Config, FloatersConfig, ShellConfig};
use gspotential::doctor::gaussians_of;
use gspotential::doctor::twin::cases::{looking_at, random_scene};
use gspotential::doctor::twin::model::{TwinCamera, TwinGaussians};
use gspotential::doctor::twin::project::project;
use gspotential::doctor::twin::raster::{ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN, depth_order};
use gspotential::train::floaters::dip::dip;
use gspotential::train::floaters::{Depths, differences, quantile, share};
use gspotential::train::{Shell, Supervision, Trained, Trainer};

use crate::gpu::rig::context;
use crate::hard::specimens::{self, noise_supervision};
use crate::kit::keep::{Keep, same};

/// `n` numbers of [0, 1), the same everywhere.
fn spread(n: usize, step: f64) -> impl Iterator<Item = f64> {
    (0..n).map(move |i| (i as f64 * step).fract())
}

/// Values of the Python package `diptest` 0.12.0.
#[test]
fn dips_are_those_of_another_program() {
    let cases: [(Vec<f64>, f64); 7] = [
        ((0..20).map(|i| f64::from(i * i)).collect(), 0.025),
        (
            (0..40)
                .map(|i| f64::from(i % 20) / 20.0 + if i < 20 { 0.0 } else { 3.0 })
                .collect(),
            0.170_833_333_333_333_34,
        ),
        (
            spread(64, 0.618_034)
                .chain(spread(40, 0.414_214).map(|x| 2.5 + x))
                .collect(),
            0.117_006_993_187_552_53,
        ),
        (
            (0..31).map(|i| f64::from(i - 15).powi(3)).collect(),
            0.016_129_032_258_064_516,
        ),
        ((0..50).map(|i| f64::from(i * i % 7)).collect(), 0.14),
        (
            spread(90, 0.7549)
                .zip(0..)
                .map(|(x, i)| x + f64::from(2 * (i % 3)))
                .collect(),
            0.086_576_549_811_843_82,
        ),
        (
            spread(70, 0.618_034)
                .map(|x| x.powi(3))
                .chain(spread(30, 0.414_214).map(|x| 1.0 - 0.2 * x * x))
                .collect(),
            0.106_336_873_762_631_04,
        ),
    ];
    for (mut values, expected) in cases {
        values.sort_unstable_by(f64::total_cmp);
        let found = dip(&values);
        assert!((found - expected).abs() < 1e-12, "{found} for {expected}");
        // It depends on neither place nor scale.
        let moved: Vec<f64> = values.iter().map(|x| 8.0 * x - 3.0).collect();
        assert!((dip(&moved) - expected).abs() < 1e-12);
    }
    // Two places that share the values alike are as far from one mode as can be.
    let halves: Vec<f64> = (0..100).map(|i| f64::from(i / 50)).collect();
    assert_eq!(dip(&halves), 0.25);
    assert_eq!(dip(&[2.0; 9]), 0.0);
    assert_eq!(dip(&[]), 0.0);
    assert_eq!(dip(&[1.0, 2.0]), 0.25);
}

#[test]
fn differences_shares_and_quantiles_are_those_worked_out_by_hand() {
    let of = |mode: f64, expected: f64| {
        let beyond = expected - mode;
        Some(Depths { mode, beyond })
    };
    // Depths 2, 3 and 4: mean 3, deviation 1; the least is above 3 - 3.
    let found = differences(&[of(1.0, 2.0), None, of(3.0, 3.0), of(5.0, 4.0)]);
    assert_eq!(found, [1.0 / 4.0, 0.0, 0.0, -1.0 / 6.0]);
    // Depths 10 but for one of 1: the mean less three deviations is above the least.
    let mut pixels = vec![of(8.0, 10.0); 99];
    pixels.push(of(1.0, 1.0));
    let (mean, squares) = (9.91, 99.0 * 0.09 * 0.09 + 8.91 * 8.91);
    let base = mean - 3.0 * f64::sqrt(squares / 99.0);
    assert!(base > 1.0);
    assert!((differences(&pixels)[0] - 2.0 / (10.0 + base)).abs() < 1e-12);
    assert_eq!(differences(&[None]), [0.0]);
    assert_eq!(differences(&[of(1.0, 2.0)]), [1.0 / 4.0]);

    let config = FloatersConfig::default();
    assert_eq!(share(&config, 0.0), 0.98);
    assert!((share(&config, 0.01) - 0.98 * (-0.075f64).exp()).abs() < 1e-12);
    assert_eq!(share(&config, 0.1), 0.8);
    assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.75), Some(3.0));
    assert_eq!(quantile(&[1.0, 2.0, 4.0], 1.0), Some(4.0));
    assert_eq!(quantile(&[], 0.5), None);
}

/// The rule, with slack and with faults.
#[derive(Clone, Copy)]
struct Rule {
    share: f64,
    falloff: f64,
    least: f64,
    exponent: f64,
    /// Factor of the threshold.
    slack: f64,
    /// Gaussians behind the mode that go, too.
    beyond: usize,
}

const RULE: Rule = Rule {
    share: 0.98,
    falloff: 7.5,
    least: 0.8,
    exponent: -4.0,
    slack: 1.0,
    beyond: 0,
};

/// Gaussians of a pixel from the front: index, exponent, whether it is the mode.
type List = Vec<(usize, f64, bool)>;

/// Mean depth and mode of a pixel in which something is drawn, and its list.
type Pixel = (Option<[f64; 2]>, List);

/// What every pixel shows, by brute force.
fn pixel(gaussians: &TwinGaussians, camera: &TwinCamera) -> Vec<Pixel> {
    let splats: Vec<_> = (0..gaussians.n())
        .map(|i| project(gaussians, i, camera))
        .collect();
    let order = depth_order(&splats);
    let of = |at: usize| {
        let (x, y) = (at % camera.width, at / camera.width);
        let mut list = List::new();
        let mut drawn: Vec<(usize, f64, f64)> = Vec::new();
        let mut transmittance = 1.0;
        for id in &order {
            let splat = &splats[*id];
            let dx = x as f64 + 0.5 - splat.mean2d[0];
            let dy = y as f64 + 0.5 - splat.mean2d[1];
            let [a, b, c] = splat.conic;
            let exponent = -0.5 * (a * dx * dx + 2.0 * b * dx * dy + c * dy * dy);
            let alpha = (splat.opacity * exponent.exp()).min(ALPHA_MAX);
            if alpha < ALPHA_MIN {
                continue;
            }
            list.push((*id, exponent, false));
            let weight = transmittance * alpha;
            if transmittance - weight <= TRANSMITTANCE_MIN {
                break;
            }
            drawn.push((list.len() - 1, splat.depth, weight));
            transmittance -= weight;
        }
        let total: f64 = drawn.iter().map(|(_, _, weight)| weight).sum();
        let mean = drawn.iter().map(|(_, z, w)| w * z).sum::<f64>() / total;
        let mode = drawn
            .iter()
            .copied()
            .reduce(|a, b| if b.2 > a.2 { b } else { a });
        if let Some((place, _, _)) = mode {
            list[place].2 = true;
        }
        (mode.map(|(_, depth, _)| [mean, depth]), list)
    };
    (0..camera.width * camera.height).map(of).collect()
}

fn by_hand(views: &[Vec<Pixel>], rule: Rule) -> BTreeSet<usize> {
    let differences: Vec<Vec<f64>> = views
        .iter()
        .map(|pixels| {
            let depths: Vec<f64> = pixels.iter().filter_map(|p| p.0).map(|p| p[0]).collect();
            let n = depths.len() as f64;
            let mean = depths.iter().sum::<f64>() / n;
            let variance = depths.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let least = depths.iter().copied().fold(f64::INFINITY, f64::min);
            let base = least.max(mean - 3.0 * variance.sqrt());
            let one = |p: &Pixel| p.0.map_or(0.0, |[d, m]| (d - m) / (d + base));
            pixels.iter().map(one).collect()
        })
        .collect();
    let positive = |all: &Vec<f64>| {
        let mut own: Vec<f64> = all.iter().copied().filter(|x| *x > 0.0).collect();
        own.sort_by(f64::total_cmp);
        own
    };
    let dips = differences.iter().map(|all| dip(&positive(all)));
    let mean_dip = dips.sum::<f64>() / views.len() as f64;
    let share = (rule.share * (-rule.falloff * mean_dip).exp()).max(rule.least);
    let mut gone = BTreeSet::new();
    for (pixels, all) in views.iter().zip(&differences) {
        let own = positive(all);
        let at = share * (own.len() - 1) as f64;
        let (low, high) = (own[at as usize], own[(at as usize + 1).min(own.len() - 1)]);
        let threshold = rule.slack * (low + (at - at.floor()) * (high - low));
        for ((_, list), _) in pixels.iter().zip(all).filter(|(_, x)| **x > threshold) {
            let mode = list.iter().position(|(_, _, is_mode)| *is_mode);
            let n = mode.map_or(0, |place| place + 1) + rule.beyond;
            let near = list.iter().take(n);
            let near = near.filter(|(_, exponent, _)| *exponent > rule.exponent);
            gone.extend(near.map(|(id, _, _)| *id));
        }
    }
    gone
}

/// A supervision by noise of some cameras.
fn supervision(cameras: &[TwinCamera]) -> Supervision {
    let mut all = noise_supervision(&cameras[0]);
    for camera in &cameras[1..] {
        all.real.extend(noise_supervision(camera).real);
    }
    all
}

fn config(iterations: u32, after: u32) -> Config {
    let mut config = specimens::config(iterations);
    config.model.sh_degree = 0;
    config.densify.enabled = false;
    config.coverage.prune = false;
    config.floaters.after = Some(after);
    config.validate().expect("allowed values");
    config
}

fn found(
    gaussians: &TwinGaussians,
    supervision: &Supervision,
    change: impl FnOnce(&mut Config),
) -> BTreeSet<usize> {
    let ctx = context();
    let mut config = config(3, 1);
    change(&mut config);
    let start = gaussians_of(gaussians, 0);
    let mut trainer =
        Trainer::new(&ctx.gpu, &ctx.kernels, &start, supervision, &config).expect("fits");
    let floats = trainer.floaters(0).expect("renders");
    assert_eq!(floats.len(), start.len());
    (0..floats.len()).filter(|i| floats[*i]).collect()
}

#[test]
fn floaters_are_those_of_the_rule_on_random_scenes() {
    for seed in [60, 61] {
        let mut case = random_scene(250, 0, seed);
        // All that is within the exponent's bound is drawn there.
        for logit in &mut case.gaussians.opacity_logit {
            *logit = logit.max(-1.0);
        }
        let cameras: Vec<TwinCamera> = case.cameras[..2]
            .iter()
            .map(|camera| TwinCamera {
                near: case.cameras[0].near,
                background: [0.0; 3],
                ..camera.clone()
            })
            .collect();
        let views: Vec<_> = cameras.iter().map(|c| pixel(&case.gaussians, c)).collect();
        let own = found(&case.gaussians, &supervision(&cameras), |_| ());
        let band = |sign: f64| Rule {
            slack: 1.0 + 1e-4 * sign,
            exponent: -4.0 + 1e-3 * sign,
            ..RULE
        };
        let [least, most] = [1.0, -1.0].map(|sign| by_hand(&views, band(sign)));
        println!("{} {} {}", least.len(), own.len(), most.len());
        assert!(least.is_subset(&own) && own.is_subset(&most), "{seed}");
        assert!(most.len() - least.len() <= 3 && least.len() > 20, "{seed}");
        assert!(own.len() < 200, "{seed}");
        // Each part of the rule decides.
        for fault in [
            Rule { share: 0.9, ..RULE },
            Rule {
                least: 0.6,
                falloff: 30.0,
                ..RULE
            },
            Rule {
                falloff: 0.0,
                ..RULE
            },
            Rule {
                exponent: -1.0,
                ..RULE
            },
            Rule { beyond: 1, ..RULE },
        ] {
            let other = by_hand(&views, fault);
            assert!(
                !(least.is_subset(&other) && other.is_subset(&most)),
                "{seed}"
            );
        }
        // The keys are heard.
        let keyed = found(&case.gaussians, &supervision(&cameras), |config| {
            config.floaters.share = 0.9;
            config.floaters.falloff = 0.0;
        });
        let fixed = Rule {
            share: 0.9,
            falloff: 0.0,
            ..RULE
        };
        let expected = by_hand(&views, fixed);
        assert!(keyed.symmetric_difference(&expected).count() <= 3);
        let none = found(&case.gaussians, &supervision(&cameras), |config| {
            config.floaters.share = 1.0;
            config.floaters.falloff = 0.0;
        });
        assert_eq!(none.len(), 0);
    }
}

const N_FLOATERS: usize = 9;

/// A wall of discs 4 before a camera, and nine balls 1.5 before it, which come first.
fn wall_and_floaters() -> (TwinGaussians, TwinCamera) {
    let camera = looking_at([0.0; 3], [0.0, 0.0, 1.0]);
    let mut all = TwinGaussians {
        means: Vec::new(),
        sh: Vec::new(),
        opacity_logit: Vec::new(),
        scale_log: Vec::new(),
        rotation_wxyz: Vec::new(),
        sh_degree: 0,
    };
    let mut add = |mean: [f64; 3], scale: [f64; 3], opacity: f64| {
        all.means.push(mean);
        all.scale_log.push(scale.map(f64::ln));
        all.opacity_logit.push((opacity / (1.0 - opacity)).ln());
        all.rotation_wxyz.push([1.0, 0.0, 0.0, 0.0]);
        all.sh.push([[0.0; 3]; 16]);
    };
    for i in 0..N_FLOATERS {
        let (x, y) = ((i % 3) as f64 - 1.0, (i / 3) as f64 - 1.0);
        add([0.45 * x, 0.3 * y, 1.5], [0.06; 3], 0.75);
    }
    for i in 0..64 * 44 {
        let (x, y) = ((i % 64) as f64 - 31.5, (i / 64) as f64 - 21.5);
        add([0.08 * x, 0.08 * y, 4.0], [0.06, 0.06, 0.005], 0.9);
    }
    (all, camera)
}

#[test]
fn floaters_before_a_wall_go_and_the_wall_stays() {
    let (gaussians, camera) = wall_and_floaters();
    let plain = supervision(std::slice::from_ref(&camera));
    let all: BTreeSet<usize> = (0..N_FLOATERS).collect();
    assert_eq!(found(&gaussians, &plain, |_| ()), all);
    // A rule that reaches behind the mode takes of the wall.
    let views = [pixel(&gaussians, &camera)];
    let broken = Rule { beyond: 1, ..RULE };
    assert!(by_hand(&views, broken).iter().any(|i| *i >= N_FLOATERS));
    // Without floaters there is no difference, and nothing goes.
    let mut bare = gaussians.clone();
    for opacity in &mut bare.opacity_logit[..N_FLOATERS] {
        *opacity = -100.0;
    }
    assert_eq!(found(&bare, &plain, |_| ()).len(), 0);
    // Those of the far shell stay: here all.
    let mut far = plain;
    let (count, radius) = (100, 1.5);
    // The least that there is to lie within.
    let mut nearest = gaussians_of(&gaussians, 0);
    nearest.means.fill(Vec3::ZERO);
    far.shell = Shell::around(&nearest, &ShellConfig { count, radius });
    let within = f64::from(far.frozen_beyond());
    assert!(within < 1.5, "{within}");
    assert_eq!(found(&gaussians, &far, |_| ()).len(), 0);
}

fn train(config: &Config, at: u32) -> (Trained, Keep) {
    let ctx = context();
    let (gaussians, camera) = wall_and_floaters();
    let supervision = supervision(&[camera]);
    let start = gaussians_of(&gaussians, 0);
    let mut keep = Keep::at(at);
    let trained = Trainer::new(&ctx.gpu, &ctx.kernels, &start, &supervision, config)
        .and_then(|mut trainer| trainer.run(&mut keep))
        .expect("trains");
    (trained, keep)
}

#[test]
fn floaters_go_once_in_training_and_a_resumed_one_is_the_same() {
    let mut config = config(9, 4);
    // Training has moved the wall's discs by now: a twentieth of the pixels before the mean are the floaters' alone.
    config.floaters.share = 0.95;
    config.floaters.falloff = 0.0;
    let config = config;
    let (whole, keep) = train(&config, 4);
    let gone: Vec<(u32, usize)> = whole
        .plans
        .iter()
        .map(|plan| (plan.iteration, plan.counts.pruned_floaters))
        .collect();
    let n_start = wall_and_floaters().0.n();
    let [(4, n)] = gone[..] else {
        panic!("{gone:?}");
    };
    assert!(n >= N_FLOATERS && n < n_start / 4, "{n}");
    assert_eq!(whole.gaussians.len(), n_start - n);

    let ctx = context();
    let (gaussians, camera) = wall_and_floaters();
    let supervision = supervision(&[camera]);
    let start = gaussians_of(&gaussians, 0);
    let (state, buffers) = keep.kept.expect("kept");
    let json = serde_json::to_string(&state).expect("JSON");
    let mut trainer =
        Trainer::new(&ctx.gpu, &ctx.kernels, &start, &supervision, &config).expect("fits");
    let state = serde_json::from_str(&json).expect("JSON");
    trainer.restore(state, &buffers.concat()).expect("fits");
    assert!(same(&whole, &trainer.run(&mut ()).expect("trains")));
    drop(trainer);
    drop(ctx);

    // Looking changes nothing, and after the last iteration nothing goes.
    let mut idle = config.clone();
    idle.floaters.share = 1.0;
    idle.floaters.falloff = 0.0;
    let mut off = config.clone();
    off.floaters.after = None;
    let off = train(&off, 0).0;
    assert!(train(&idle, 0).0.gaussians == off.gaussians);
    assert_eq!(off.gaussians.len(), n_start);
    let mut late = config;
    late.floaters.after = Some(9);
    assert!(same(&train(&late, 0).0, &off));
}
