//! Dropout of Gaussians: which, how many, and the render and its gradient against the reference.

use glam::Vec3;
use gspotential::config::Config;
use gspotential::doctor::twin::cases::random_scene;
use gspotential::doctor::twin::dropout::{TwinDropout, TwinGuide, pcg};
use gspotential::doctor::view::{dropout_case, examine, guided_dropout_case};
use gspotential::train::guide::density_scores;
use gspotential::train::schedule;

use super::rig::context;
use super::views::{hold, print, table_head};

#[test]
fn the_references_hash_has_the_values_worked_out_with_big_integers() {
    let expected = [129_708_002, 2_831_084_092, 2_055_130_248];
    assert_eq!([0, 1, 2].map(pcg), expected);
}

#[test]
fn renders_under_dropout_and_their_gradients_match_the_reference() {
    let case = random_scene(400, 1, 47);
    let mut table = table_head();
    for (percent, key) in [(20, 1), (60, 0xdead_beef)] {
        table += &hold(&dropout_case(&case, percent, key));
        table += &hold(&guided_dropout_case(&case, percent, key));
    }
    print(&table);
}

#[test]
fn dropout_guided_by_other_weights_does_not_match_the_reference() {
    let mut case = guided_dropout_case(&random_scene(400, 1, 47), 60, 1);
    let dropout = case.camera.dropout.as_mut().expect("dropout");
    dropout.guide.as_mut().expect("a guide").weights = [0.4, 0.6];
    let (findings, _) = examine(&context(), &case).expect("renders");
    assert!(findings.list.iter().any(|f| !f.holds()));
}

#[test]
fn near_and_crowded_gaussians_are_left_out_more_often() {
    const N: usize = 30_000;
    let at = |i: usize| [0.0, 0.0, 1.0 + i as f64 / N as f64];
    let means: Vec<[f64; 3]> = (0..N).map(at).collect();
    // Crowded every other one.
    let densities = (0..N).map(|i| (i % 2) as f64).collect();
    let dropout = TwinDropout {
        threshold: u32::MAX,
        key: 5,
        guide: Some(TwinGuide::new([0.5, 0.5], densities, &means, &[0.0; 3])),
    };
    let dropped = |of: &dyn Fn(usize) -> bool| -> f64 {
        let chosen: Vec<usize> = (0..N).filter(|i| of(*i)).collect();
        let dropped = chosen.iter().filter(|i| dropout.factor(**i) == 0.0).count();
        dropped as f64 / chosen.len() as f64
    };
    // The mean depth score of each third is 5/6, 3/6 and 1/6; within four standard deviations.
    for (third, layer) in [1.0, 0.7, 0.3].into_iter().enumerate() {
        let nearness = (5 - 2 * third) as f64 / 6.0;
        for crowded in [0, 1] {
            let expected = layer * 0.5 * (nearness + crowded as f64);
            let own = dropped(&|i| 3 * i / N == third && i % 2 == crowded);
            assert!(
                (own - expected).abs() < 0.03,
                "{third} {crowded}: {own}, not {expected}"
            );
        }
    }
}

#[test]
fn density_scores_fall_from_the_most_crowded_to_the_loneliest() {
    let cloud: Vec<Vec3> = (0..300u32)
        .map(|i| Vec3::from_array([0, 1, 2].map(|k| pcg(3 * i + k) as f32 / u32::MAX as f32)))
        .collect();
    let spacing = |p: &Vec3| {
        let others = cloud.iter().map(|q| f64::from(p.distance(*q)));
        let mut others: Vec<f64> = others.collect();
        others.sort_by(f64::total_cmp);
        others[1..7].iter().sum::<f64>() / 6.0
    };
    let spacings: Vec<f64> = cloud.iter().map(spacing).collect();
    let least = spacings.iter().copied().fold(f64::INFINITY, f64::min);
    let most = spacings.iter().copied().fold(0.0, f64::max);
    for (score, spacing) in density_scores(&cloud).into_iter().zip(spacings) {
        let expected = (most - spacing) / (most - least);
        assert!((f64::from(score) - expected).abs() < 1e-5);
    }
    assert_eq!(density_scores(&cloud[..1]), [0.0]);
    assert!(density_scores(&[]).is_empty());
}

#[test]
fn a_share_is_dropped_and_another_key_drops_others() {
    const N: usize = 4000;
    let kept = |key| -> Vec<bool> {
        let dropout = TwinDropout {
            threshold: 1 << 30,
            key,
            guide: None,
        };
        (0..N).map(|i| dropout.factor(i) > 0.0).collect()
    };
    // Under independence 3/4 are kept, 9/16 with both keys; within four standard deviations.
    let share = |set: &[bool]| set.iter().filter(|k| **k).count() as f64 / N as f64;
    let (a, b) = (kept(3), kept(4));
    let both: Vec<bool> = a.iter().zip(&b).map(|(a, b)| a & b).collect();
    for (set, expected) in [(&a, 0.75), (&b, 0.75), (&both, 0.5625)] {
        assert!((share(set) - expected).abs() < 0.032, "{}", share(set));
    }
}

#[test]
fn the_rate_rises_from_zero_and_seed_and_iteration_decide_the_key() {
    let mut config = Config::preset("paper").expect("a preset");
    assert_eq!(schedule::dropout(&config, 5000).rate, 0.0);
    config.dropout.rate_end = 0.2;
    let rate = |iteration| schedule::dropout(&config, iteration).rate;
    assert_eq!([rate(0), rate(5000), rate(10_000)], [0.0, 0.1, 0.2]);
    let mut rising = config.clone();
    rising.dropout.rate_start = 0.1;
    let rate = |iteration| schedule::dropout(&rising, iteration).rate;
    assert_eq!([rate(0), rate(10_000)], [0.1, 0.2]);
    let key = |seed: u64, iteration| {
        let config = Config {
            seed,
            ..config.clone()
        };
        schedule::dropout(&config, iteration).key
    };
    assert_eq!(key(0, 7), key(0, 7));
    assert_ne!(key(0, 7), key(0, 8));
    assert_ne!(key(0, 7), key(1, 7));
}
