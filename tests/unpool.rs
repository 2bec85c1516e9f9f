//! Unpooling: new Gaussians half-way to neighbours that are far away.

use glam::Vec3;
use gspotential::config::{Config, UnpoolConfig};
use gspotential::doctor::twin::random::Random;
use gspotential::gaussians::Gaussians;
use gspotential::pipeline::{Prepared, prepare};
use gspotential::run::Seconds;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::train::policy::Gathered;
use gspotential::train::unpool::{Pair, pairs};
use gspotential::train::{State, Trained, Trainer};

use crate::gpu::rig::context;
use crate::kit::keep::{Keep, same};

/// Gaussians at random places, dense in one half and sparse in the other, of many sizes.
fn gathered(n: usize) -> Gathered {
    let mut random = Random::new(11);
    let mut draw = |low: f64, high: f64| random.uniform(low, high) as f32;
    let mut set = Gathered::default();
    for i in 0..n {
        let side = if i % 2 == 0 { 0.2 } else { 4.0 };
        let mean = Vec3::new(draw(0.0, side), draw(0.0, side), draw(0.0, side));
        set.means.push(mean + side as f32 * Vec3::X);
        let scale = Vec3::new(draw(-5.0, 0.0), draw(-5.0, 0.0), draw(-5.0, 0.0));
        set.scales_log.push(scale);
    }
    set
}

/// The rule in words, one by one: the `k` nearest others of what is large and has them far away.
fn by_hand(set: &Gathered, k: usize, distance: f64, scale: f64) -> Vec<Pair> {
    let means: Vec<_> = set.means.iter().map(|m| m.as_dvec3()).collect();
    let mut found = Vec::new();
    for (i, own) in means.iter().enumerate() {
        let mut others: Vec<usize> = (0..means.len()).filter(|j| *j != i).collect();
        others.sort_by(|a, b| own.distance(means[*a]).total_cmp(&own.distance(means[*b])));
        others.truncate(k);
        let mean = others.iter().map(|j| own.distance(means[*j])).sum::<f64>() / k as f64;
        if mean > distance && set.scales_log[i].as_dvec3().exp().max_element() > scale {
            let pair = |neighbor: usize| Pair { of: i, neighbor };
            found.extend(others.into_iter().map(pair));
        }
    }
    found
}

/// Thresholds of 0.6 and 0.3 at the extent 2.
const EXTENT: f64 = 2.0;

fn rule() -> UnpoolConfig {
    UnpoolConfig {
        until: Some(1),
        distance: 0.3,
        scale: 0.15,
    }
}

#[test]
fn large_ones_far_from_their_three_nearest_unpool_to_them() {
    let set = gathered(300);
    let found = pairs(&set, &rule(), (EXTENT, f32::INFINITY), 10_000);
    assert_eq!(found, by_hand(&set, 3, 0.6, 0.3));
    assert!((60..600).contains(&found.len()), "{}", found.len());
    // Each part of the rule decides.
    for (k, distance, scale) in [
        (2, 0.6, 0.3),
        (4, 0.6, 0.3),
        (3, 0.6, 0.25),
        (3, 0.5, 0.3),
        // Squares, and lengths that are not in extents.
        (3, 0.6f64.sqrt(), 0.3),
        (3, 0.3, 0.15),
    ] {
        assert_ne!(found, by_hand(&set, k, distance, scale), "{k} {distance}");
    }
    // Few have fewer neighbours, and what is alone has none.
    let mut few = gathered(3);
    few.means = vec![Vec3::ZERO, 9.0 * Vec3::X, 9.0 * Vec3::Y];
    few.scales_log = vec![Vec3::ZERO; 3];
    assert_eq!(pairs(&few, &rule(), (EXTENT, f32::INFINITY), 99).len(), 6);
    few.means[1] = Vec3::NAN;
    assert_eq!(pairs(&few, &rule(), (EXTENT, f32::INFINITY), 99).len(), 2);
    few.means[2] = Vec3::ONE * f32::INFINITY;
    assert_eq!(pairs(&few, &rule(), (EXTENT, f32::INFINITY), 99), []);
}

#[test]
fn the_most_distant_unpool_where_not_all_can_and_the_far_shell_never_does() {
    let set = gathered(300);
    let lengths = (EXTENT, f32::INFINITY);
    let all = pairs(&set, &rule(), lengths, 10_000);
    let n = all.len();
    assert_eq!(pairs(&set, &rule(), lengths, n), all);
    let distance = |of: usize| -> f64 {
        let own = all.iter().filter(|pair| pair.of == of);
        own.map(|p| {
            set.means[of]
                .as_dvec3()
                .distance(set.means[p.neighbor].as_dvec3())
        })
        .sum()
    };
    // Room for all but two of the pairs: the one with the nearest neighbours stays as it is.
    let fewer = pairs(&set, &rule(), lengths, n - 2);
    assert_eq!(fewer.len(), n - 3);
    let left = all.iter().find(|pair| !fewer.contains(pair));
    let left = distance(left.expect("one stays").of);
    assert!(fewer.iter().all(|pair| distance(pair.of) >= left));
    assert_eq!(pairs(&set, &rule(), lengths, 2), []);
    // Beyond 6.5 nothing has part, neither as the one nor as the other.
    let near = pairs(&set, &rule(), (EXTENT, 6.5), 10_000);
    let is_near = |i: usize| set.means[i].length() <= 6.5;
    assert!(near.iter().all(|p| is_near(p.of) && is_near(p.neighbor)));
    assert!(!near.is_empty() && !all.iter().all(|p| is_near(p.of) && is_near(p.neighbor)));
}

/// Few points, of which none grows but by unpooling, after 20 and 40 iterations.
fn config(until: Option<u32>) -> Config {
    let mut config = Config::preset("3dgs").expect("a preset");
    config.iterations = 55;
    config.scene.max_points = Some(120);
    config.model.sh_interval = 10;
    config.densify.start = 10;
    config.densify.interval = 20;
    config.densify.end = 60;
    config.densify.gradient_threshold = 1e9;
    config.densify.min_opacity = 0.0;
    config.unpool.until = until;
    config.unpool.distance = 0.05;
    config.unpool.scale = 0.02;
    config.validate().expect("allowed values");
    config
}

fn prepared(config: &Config) -> Prepared {
    let scene = scene(&BuiltinOptions {
        width: 48,
        n_test: 1,
        ..BuiltinOptions::default()
    });
    prepare(&scene, config, &mut Seconds::default()).expect("prepares")
}

/// A state with its buffers.
type Kept = (State, Vec<Vec<u8>>);

/// A training, and what it was after `at` iterations.
fn trained(config: &Config, at: u32) -> (Trained, Option<Kept>) {
    let ctx = context();
    let Prepared {
        start, supervision, ..
    } = prepared(config);
    let mut keep = Keep::at(at);
    let trained = Trainer::new(&ctx.gpu, &ctx.kernels, &start, &supervision, config)
        .and_then(|mut trainer| trainer.run(&mut keep))
        .expect("trains");
    (trained, keep.kept)
}

/// The Gaussians of a state and, for each, whether Adam remembers something.
fn gaussians_of(config: &Config, (state, buffers): &Kept) -> (Gaussians, Vec<bool>) {
    let ctx = context();
    let Prepared {
        start, supervision, ..
    } = prepared(config);
    let mut config = config.clone();
    config.iterations = state.done;
    let trainer = Trainer::new(&ctx.gpu, &ctx.kernels, &start, &supervision, &config);
    let mut trainer = trainer.expect("fits");
    trainer
        .restore(state.clone(), &buffers.concat())
        .expect("fits");
    let n_blocks = (buffers.len() - 1) / 3;
    let moments: Vec<&[f32]> = buffers[n_blocks..3 * n_blocks]
        .iter()
        .map(|bytes| bytemuck::cast_slice(bytes))
        .collect();
    let remembers = |i: usize| {
        let of_block = |block: &&[f32]| {
            let planes = block.chunks_exact(4 * state.stride);
            planes.clone().any(|plane| plane[4 * i..][..4] != [0.0; 4])
        };
        moments.iter().any(of_block)
    };
    let remembered = (0..state.n_gaussians).map(remembers).collect();
    let gaussians = trainer.run(&mut ()).expect("nothing is left").gaussians;
    (gaussians, remembered)
}

#[test]
fn new_ones_lie_half_way_unturned_and_grey_with_their_neighbours_scales_and_opacity() {
    let config = config(Some(30));
    let (whole, kept) = trained(&config, 20);
    let counts: Vec<(u32, usize)> = whole
        .plans
        .iter()
        .filter(|plan| plan.counts.unpooled > 0)
        .map(|plan| (plan.iteration, plan.counts.unpooled))
        .collect();
    let [(20, n_new)] = counts[..] else {
        panic!("{counts:?}");
    };
    assert_eq!(whole.gaussians.len(), 120 + n_new);
    assert!(n_new > 30, "{n_new}");
    let (after, remembered) = gaussians_of(&config, &kept.expect("kept"));
    assert_eq!(after.len(), 120 + n_new);
    let n_sh = after.sh.len() / after.len();
    for (i, remembers) in remembered.into_iter().enumerate() {
        let sh = &after.sh[i * n_sh..][..n_sh];
        let is_new = i >= 120;
        assert_eq!(remembers, !is_new, "{i}");
        assert_eq!(sh.iter().all(|c| *c == 0.0), is_new, "{i}");
        assert_eq!(
            after.rotations_wxyz[i] == [1.0, 0.0, 0.0, 0.0],
            is_new,
            "{i}"
        );
        if !is_new {
            continue;
        }
        let is_neighbor = |j: &usize| {
            (after.scales_log[*j], after.opacity_logits[*j])
                == (after.scales_log[i], after.opacity_logits[i])
        };
        let neighbor = (0..120).find(is_neighbor).expect("a neighbour");
        let of = 2.0 * after.means[i] - after.means[neighbor];
        let least = (0..120).map(|j| after.means[j].distance(of));
        let least = least.fold(f32::INFINITY, f32::min);
        assert!(least < 1e-6, "{i}: {least}");
        assert!(after.means[i].distance(after.means[neighbor]) > 1e-3);
    }
}

#[test]
fn a_resumed_training_is_the_same_and_thresholds_that_nothing_reaches_change_no_bit() {
    let config = config(Some(60));
    // After the first of two.
    let (whole, kept) = trained(&config, 31);
    let n_times = whole.plans.iter().filter(|p| p.counts.unpooled > 0).count();
    assert_eq!(n_times, 2);
    let ctx = context();
    let Prepared {
        start, supervision, ..
    } = prepared(&config);
    let mut trainer =
        Trainer::new(&ctx.gpu, &ctx.kernels, &start, &supervision, &config).expect("fits");
    let (state, buffers) = kept.expect("kept");
    let json = serde_json::to_string(&state).expect("JSON");
    let state = serde_json::from_str(&json).expect("JSON");
    trainer.restore(state, &buffers.concat()).expect("fits");
    let resumed = trainer.run(&mut ()).expect("trains");
    assert!(same(&whole, &resumed));
    drop(trainer);
    drop(ctx);

    let mut idle = config.clone();
    idle.unpool.distance = 1e9;
    let off = Config {
        unpool: UnpoolConfig::default(),
        ..idle.clone()
    };
    let (idle, off) = (trained(&idle, 0).0, trained(&off, 0).0);
    assert!(same(&idle, &off));
    assert_eq!(off.gaussians.len(), 120);
    // The cap holds for it, too.
    let mut capped = config;
    capped.densify.max_gaussians = 130;
    let n = trained(&capped, 0).0.gaussians.len();
    assert!((124..=130).contains(&n), "{n}");
}
