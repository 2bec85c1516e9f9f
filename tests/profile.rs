//! `train --profile`: where the time goes is told, and nothing else changes.

use std::fs;
use std::path::Path;
use std::time::Instant;

use gspotential::pipeline::profile_tables;
use gspotential::run::{RunDir, RunProfile};

use crate::kit::program::{Ended, succeed};

/// Changes of the set of Gaussians and resets among its iterations.
const TRAIN: &str = "train --scene builtin:32 --preset paper --iterations 120 --set views.count=6 --max-points 200 \
                     --set scene.n_test=1 --set densify.start=20 --set densify.interval=20 \
                     --set densify.opacity_reset_interval=40 --log json";

fn train(folder: &Path, more: &str) -> Ended {
    let ended = succeed(folder, &format!("{TRAIN} {more}"));
    for line in ended.log.lines() {
        serde_json::from_str::<serde_json::Value>(line).unwrap_or_else(|e| panic!("{line}: {e}"));
    }
    ended
}

#[test]
fn a_profile_tells_kernels_and_stages_and_changes_no_bit() {
    let folder = tempfile::tempdir().unwrap();
    let at = |path: &str| folder.path().join(path);
    let plain = train(folder.path(), "--out plain");
    let clock = Instant::now();
    let timed = train(folder.path(), "--out timed --profile");
    let whole = clock.elapsed().as_secs_f64();
    let model = |run: &str| fs::read(at(run).join("point_cloud.ply")).unwrap();
    assert!(model("plain") == model("timed"), "the models differ");
    assert!(!at("plain/profile.json").exists());

    let run = RunDir::open(&at("timed")).unwrap();
    let profile = run.profile().unwrap();
    let text = timed.stdout;
    let tables = profile_tables(&profile);
    assert!(text.ends_with(&tables), "{text}");
    assert!(!plain.stdout.contains("kernel"));
    check_steps(&profile);
    check_stages(&profile, whole);
    assert_eq!(
        run.metrics().unwrap().seconds.to_first_iteration,
        profile.seconds.to_first_iteration
    );
    // Another run in its place takes the file away.
    train(folder.path(), "--out timed --overwrite");
    assert!(!at("timed/profile.json").exists());
}

/// Iterations 50, 100 and 120.
fn check_steps(profile: &RunProfile) {
    let step = &profile.step;
    assert_eq!((step.timed, step.iterations), (3, 120));
    let of = |name: &str| {
        let found = step.kernels.iter().find(|kernel| kernel.kernel == name);
        found.unwrap_or_else(|| panic!("no `{name}` in {step:?}"))
    };
    // Two views a step, one Adam step for both.
    assert_eq!(of("rasterize").dispatches, 2.0);
    assert_eq!(of("rasterize_backward").dispatches, 2.0);
    assert_eq!(of("adam_geometry").dispatches, 1.0);
    assert!(step.kernels.iter().all(|kernel| kernel.seconds > 0.0));
    assert!(step.kernels.is_sorted_by(|a, b| a.seconds >= b.seconds));
}

/// No second is counted twice, of the `whole` that the program took.
fn check_stages(profile: &RunProfile, whole: f64) {
    let s = profile.seconds;
    let before = [
        s.open,
        s.load,
        s.field,
        s.sample,
        s.splat,
        s.gaussians,
        s.files,
        s.compile,
        s.upload,
    ];
    let before: f64 = before.iter().map(|s| s.expect("measured")).sum();
    let to_first = s.to_first_iteration.expect("measured");
    assert!(before <= to_first, "{s:?}");
    let train = s.train.expect("measured");
    let parts = [s.first_iteration, s.densify, s.checkpoints].map(|s| s.expect("measured"));
    assert!(parts.iter().sum::<f64>() <= train, "{s:?}");
    assert!(parts.iter().all(|part| *part > 0.0), "{s:?}");
    assert!(profile.step.wall_s <= train / 120.0, "{s:?}");
    assert!(s.carve.is_none());
    let stages = [s.to_first_iteration, s.train, s.write, s.eval, s.report];
    let all: f64 = stages.iter().map(|s| s.expect("measured")).sum();
    assert!(all <= whole, "{all} of {whole}: {s:?}");
}

#[test]
fn without_timestamps_the_stages_remain() {
    let profile = RunProfile {
        adapter: String::new(),
        seconds: Default::default(),
        step: Default::default(),
    };
    let text = profile_tables(&profile);
    assert!(text.contains("no timestamp queries"), "{text}");
    assert!(text.contains("| stage"), "{text}");
    assert!(!text.contains("NaN"), "{text}");
}
