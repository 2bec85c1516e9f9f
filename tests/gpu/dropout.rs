//! Dropout of Gaussians: which, how many, and the render and its gradient against the reference.

use gspotential::config::Config;
use gspotential::doctor::view::dropout_case;
use gspotential::reference::cases::random_scene;
use gspotential::reference::dropout::{TwinDropout, pcg};
use gspotential::train::schedule;

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
    }
    print(&table);
}

#[test]
fn a_share_is_dropped_and_another_key_drops_others() {
    const N: usize = 4000;
    let kept = |key| -> Vec<bool> {
        let dropout = TwinDropout {
            threshold: 1 << 30,
            key,
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
