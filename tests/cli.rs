//! The command itself: help, usage errors, exit codes.

use std::path::Path;
use std::process::{Command, Output};

fn run(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gspotential"))
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Asserts the exit code, and that a one-line error mentions all of `parts`.
#[track_caller]
fn assert_fails(args: &[&str], code: i32, parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    assert_fails_in(folder.path(), args, code, parts);
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        0,
        "left something behind"
    );
}

#[track_caller]
fn assert_fails_in(folder: &Path, args: &[&str], code: i32, parts: &[&str]) {
    let output = run(folder, args);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
    assert!(output.stdout.is_empty(), "{args:?} wrote to stdout");
    for part in parts {
        assert!(stderr.contains(part), "{args:?}: no `{part}` in: {stderr}");
    }
    assert_eq!(
        stderr.lines().filter(|l| l.starts_with("error: ")).count(),
        1,
        "{stderr}"
    );
    assert!(!stderr.contains("panicked"), "{stderr}");
}

#[test]
fn every_help_explains_its_options_and_gives_examples() {
    let folder = tempfile::tempdir().unwrap();
    for (args, parts) in [
        (
            &["--help"][..],
            &["train", "eval", "render", "Exit codes"][..],
        ),
        (
            &["train", "--help"],
            &[
                "--scene",
                "--out",
                "--preset",
                "--config",
                "--set",
                "--iterations",
                "--max-size",
                "--max-points",
                "--seed",
                "--train-views",
                "--overwrite",
                "[default: builtin]",
            ],
        ),
        (&["eval", "--help"], &["<RUN>...", "eval.json"]),
        (
            &["render", "--help"],
            &[
                "--model",
                "--scene",
                "--cameras",
                "--views",
                "--out",
                "--format",
                "[default: png]",
            ],
        ),
    ] {
        let output = run(folder.path(), args);
        assert!(output.status.success());
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.contains("Examples:"), "{args:?}");
        for part in parts {
            assert!(text.contains(part), "{args:?}: no `{part}`");
        }
    }
}

#[test]
fn usage_errors_exit_with_2() {
    for args in [
        &["fly"][..],
        &["train", "--iterations", "many"],
        &["train", "--iterations", "-1"],
        &["train", "--preset", "paper", "--config", "a.json"],
        &["train", "--scene", ""],
        &["train", "--scene", "builtin:wide"],
        &["train", "--scene", "builtin:0"],
        &["eval"],
        &["render", "--model", "a.ply", "--out", "b"],
        &[
            "render",
            "--model",
            "a.ply",
            "--out",
            "b",
            "--scene",
            "c",
            "--cameras",
            "d",
        ],
        &[
            "render", "--model", "a.ply", "--out", "b", "--scene", "c", "--format", "gif",
        ],
    ] {
        assert_fails(args, 2, &[]);
    }
    // Without a command there is only help.
    let output = run(Path::new("."), &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("Usage:"));
}

#[test]
fn config_errors_exit_with_2_and_suggest() {
    assert_fails(
        &["train", "--preset", "papr"],
        2,
        &["did you mean `paper`?"],
    );
    assert_fails(
        &["train", "--set", "loss.ssim_wieght=1"],
        2,
        &[
            "--set loss.ssim_wieght=1",
            "did you mean `loss.ssim_weight`?",
        ],
    );
    assert_fails(&["train", "--set", "seed=x"], 2, &["`seed`"]);
    assert_fails(&["train", "--iterations", "0"], 2, &["`iterations` is 0"]);
    assert_fails(
        &["train", "--max-size", "0"],
        2,
        &["`scene.max_size_px` is 0"],
    );
    assert_fails(
        &["train", "--max-points", "0"],
        2,
        &["`scene.max_points` is 0"],
    );
    assert_fails(&["train", "--train-views", "a,b,a"], 2, &["`a` twice"]);
    assert_fails(&["train", "--train-views", "a,,b"], 2, &["empty name"]);

    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.json"), r#"{"sede": 1}"#).unwrap();
    let args = ["train", "--config", "c.json"];
    assert_fails_in(folder.path(), &args, 2, &["c.json", "did you mean `seed`?"]);
}

#[test]
fn missing_files_exit_with_1_and_are_named() {
    assert_fails(&["train", "--config", "no.json"], 1, &["no.json"]);
    assert_fails(
        &["train", "--scene", "no/scene"],
        1,
        &["no/scene", "builtin"],
    );
    assert_fails(&["eval", "no/run"], 1, &["no/run", "config.json"]);
    let args = [
        "render", "--model", "a.ply", "--scene", "no/scene", "--out", "b",
    ];
    assert_fails(&args, 1, &["no/scene"]);
}

#[test]
fn existing_run_is_refused_with_1_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let default = folder.path().join("runs/builtin-3dgs-seed5");
    std::fs::create_dir_all(&default).unwrap();
    std::fs::write(default.join("notes.txt"), "mine").unwrap();
    let args = ["train", "--preset", "3dgs", "--seed", "5"];
    assert_fails_in(
        folder.path(),
        &args,
        1,
        &["runs/builtin-3dgs-seed5", "--overwrite"],
    );
    let args = ["train", "--preset", "3dgs", "--seed", "5", "--overwrite"];
    assert_fails_in(folder.path(), &args, 1, &["holds no run"]);
    assert_eq!(std::fs::read_dir(&default).unwrap().count(), 1);
}

#[test]
fn output_below_a_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("file"), "x").unwrap();
    assert_fails_in(
        folder.path(),
        &["train", "--out", "file/run"],
        1,
        &["file/run"],
    );
}
