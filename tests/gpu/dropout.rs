//! Dropout of Gaussians: which, how many, and the render and its gradient against the twins.

use gspotential::config::Config;
use gspotential::train::schedule;

use super::project::decode;
use super::render::{ORDINARY, hold_case};
use super::rig::{Rig, context, gaussians_of, view_of};
use crate::twins::cases::random_scene;
use crate::twins::dropout::{TwinDropout, pcg};

#[test]
fn the_twins_hash_has_the_values_worked_out_with_big_integers() {
    let expected = [129_708_002, 2_831_084_092, 2_055_130_248];
    assert_eq!([0, 1, 2].map(pcg), expected);
}

#[test]
fn renders_under_dropout_and_their_gradients_match_the_twins() {
    for (percent, key) in [(20, 1), (60, 0xdead_beef)] {
        let mut case = random_scene(400, 1, 47);
        for camera in &mut case.cameras {
            let threshold = (u64::from(u32::MAX) * percent / 100) as u32;
            camera.dropout = Some(TwinDropout { threshold, key });
        }
        hold_case(&format!("dropout {percent}%"), &case, &[(61, 47)], ORDINARY);
    }
}

#[test]
fn the_twin_and_the_gpu_drop_the_same_and_another_key_drops_others() {
    let ctx = context();
    let case = random_scene(1000, 0, 48);
    let drawn = |dropout: Option<TwinDropout>| -> Vec<bool> {
        let mut camera = case.cameras[0].clone();
        camera.dropout = dropout;
        let gaussians = gaussians_of(&case.gaussians, 0);
        let mut rig = Rig::new(&ctx, &gaussians, view_of(&camera), 0);
        rig.forward(&ctx);
        decode(&ctx, &rig).iter().map(Option::is_some).collect()
    };
    let all = drawn(None);
    let mut sets = Vec::new();
    for key in [3, 4] {
        let dropout = TwinDropout {
            threshold: 1 << 30,
            key,
        };
        let set = drawn(Some(dropout));
        for (i, (kept, visible)) in set.iter().zip(&all).enumerate() {
            assert_eq!(*kept, *visible && dropout.factor(i) > 0.0, "Gaussian {i}");
        }
        let share =
            set.iter().filter(|k| **k).count() as f64 / all.iter().filter(|v| **v).count() as f64;
        // 0.75 within four standard deviations.
        assert!((share - 0.75).abs() < 0.055, "{share}");
        sets.push(set);
    }
    assert_ne!(sets[0], sets[1]);
}

#[test]
fn the_rate_rises_from_zero_and_seed_and_iteration_decide_the_key() {
    let mut config = Config::preset("paper").expect("a preset");
    assert_eq!(schedule::dropout(&config, 5000).0, 0.0);
    config.dropout.rate_end = 0.2;
    let rate = |iteration| schedule::dropout(&config, iteration).0;
    assert_eq!([rate(0), rate(5000), rate(10_000)], [0.0, 0.1, 0.2]);
    let key = |seed: u64, iteration| {
        let config = Config {
            seed,
            ..config.clone()
        };
        schedule::dropout(&config, iteration).1
    };
    assert_eq!(key(0, 7), key(0, 7));
    assert_ne!(key(0, 7), key(0, 8));
    assert_ne!(key(0, 7), key(1, 7));
}
