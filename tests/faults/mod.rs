//! What goes wrong around a training: processes that are killed, disks that are full, devices that
//! are lost, a second process. Nothing that was written is lost, and nothing false is written.

mod counts;
mod disk;
mod gpu;
mod kills;
mod locks;
mod refusals;
mod state;
mod store;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use gspotential::config::Config;
use gspotential::pipeline::TrainJob;
use gspotential::scene::SceneSource;
use serde_json::Value;

use crate::kit::program::command;

/// A training in which Gaussians are split, pruned and reset within a second or two.
const SETTINGS: [&str; 27] = [
    "iterations=60",
    "scene.max_points=100",
    "scene.n_test=1",
    "field.n_candidates=128",
    "views.count=5",
    "model.sh_interval=10",
    "densify.start=5",
    "densify.end=55",
    "densify.interval=10",
    "densify.max_gaussians=400",
    "densify.opacity_reset_interval=30",
    "densify.opacity_reset_end=50",
    "coverage.start=20",
    "coverage.interval=20",
    "loss.fill_weight=0.3",
    "dropout.rate_end=0.3",
    "dropout.density_weight=0.5",
    "poses.refine=true",
    "shell.count=100",
    "optimizer.confidence_gain=99",
    "loss.far_weight=0.5",
    "densify.outlier_interval=20",
    "need.hold_out=5",
    "need.interval=7",
    "need.settle_share=0.2",
    "need.prune=true",
    "need.tolerance_db=0.5",
];
const CURVE: u32 = 25;

/// The training as a command into the folder `run`.
fn train(more: &str) -> String {
    let settings = SETTINGS.map(|s| format!("--set {s}")).join(" ");
    format!(
        "train --scene builtin:32 --preset paper --eval-every {CURVE} {settings} --out run {more}"
    )
}

/// One that does not end.
fn endless_train(more: &str) -> String {
    train(&format!("--iterations 1000000 {more}"))
}

/// The same training as a job.
pub(crate) fn job() -> TrainJob {
    let paper = Config::preset("paper").expect("a preset");
    let config = SETTINGS
        .iter()
        .try_fold(paper, |config, setting| config.set(setting));
    let source = SceneSource::Builtin { width: 32 };
    TrainJob {
        eval_every: Some(CURVE),
        ..TrainJob::new(source, config.expect("settings")).expect("a job")
    }
}

/// Longest time that a test waits for something.
const PATIENCE: Duration = Duration::from_secs(120);

/// A folder in which the command is run.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Place {
        Place(tempfile::tempdir().expect("a folder"))
    }

    fn at(&self, path: &str) -> PathBuf {
        self.0.path().join(path)
    }

    fn start(&self, args: &str) -> Child {
        command(self.0.path(), args)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts")
    }

    /// Runs to the end and asserts the exit code; returns stderr.
    #[track_caller]
    fn run(&self, args: &str, code: i32) -> String {
        ended(self.start(args), code)
    }

    /// The run's checkpoints, the oldest first.
    fn checkpoints(&self) -> Vec<PathBuf> {
        self.files("run/checkpoints", ".ckpt")
    }

    fn files(&self, folder: &str, suffix: &str) -> Vec<PathBuf> {
        let Ok(entries) = fs::read_dir(self.at(folder)) else {
            return Vec::new();
        };
        let paths = entries.map(|entry| entry.expect("an entry").path());
        let mut files: Vec<PathBuf> = paths
            .filter(|path| path.to_string_lossy().ends_with(suffix))
            .collect();
        files.sort();
        files
    }

    fn result(&self) -> Outcome {
        Outcome::of(&self.at("run"))
    }
}

#[track_caller]
fn ended(child: Child, code: i32) -> String {
    let Output { status, stderr, .. } = child.wait_with_output().expect("the command ends");
    let stderr = String::from_utf8(stderr).expect("text");
    assert_eq!(status.code(), Some(code), "{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    let is_error = |line: &&str| line.starts_with("error: ");
    let n_errors = stderr.lines().filter(is_error).count();
    assert_eq!(n_errors, usize::from(code == 1 || code == 2), "{stderr}");
    stderr
}

#[track_caller]
fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What a run has come to, without what may differ between equal ones.
#[derive(Debug, PartialEq)]
struct Outcome {
    point_cloud: Vec<u8>,
    metrics: Value,
    evaluation: Value,
}

impl Outcome {
    #[track_caller]
    fn of(run: &Path) -> Outcome {
        let read = |name: &str| fs::read(run.join(name)).expect("a result");
        let json = |name: &str| serde_json::from_slice(&read(name)).expect("JSON");
        let (mut metrics, mut evaluation): (Value, Value) =
            (json("metrics.json"), json("eval.json"));
        for key in ["seconds", "memory"] {
            metrics[key] = Value::Null;
        }
        evaluation["train_s"] = Value::Null;
        for point in metrics["curve"].as_array_mut().into_iter().flatten() {
            point["train_s"] = Value::Null;
        }
        Outcome {
            point_cloud: read("point_cloud.ply"),
            metrics,
            evaluation,
        }
    }
}
