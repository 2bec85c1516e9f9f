//! The command itself: help, usage errors, exit codes.

use std::path::Path;

use gspotential::config::Config;
use gspotential::run::{Memory, Metrics, RunDir, SceneRecord, Seconds};
use gspotential::scene::PoseProtocol;

use crate::kit::program::{command, ended, run, succeed};
use crate::metrics::lpips_reference::{ALEX, generated};
use crate::scene::build::{Folder, GOOD_PLY};

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
    let stderr = &output.log;
    assert_eq!(output.code, Some(code), "{args:?}: {stderr}");
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
                "--test-views",
                "--cloud",
                "--eval-every",
                "--overwrite",
                "--lpips-weights",
                "--lpips-range",
                "--float-renders",
                "[default: builtin]",
            ],
        ),
        (
            &["eval", "--help"],
            &[
                "<RUN>...",
                "eval.json",
                "--lpips-weights",
                "--lpips-range",
                "[default: 0,1]",
                "--float-renders",
                "--again",
                "--json",
                "--csv",
                "--overwrite",
                "lpips.LPIPS(net='vgg')",
            ],
        ),
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
        let text = succeed(folder.path(), args).stdout;
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
        &["eval", "a", "--lpips-range", "-1,1"],
        &["eval", "a", "--lpips-weights", "b", "--lpips-range", "0,2"],
        &["train", "--lpips-range", "0,1"],
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
    let output = run(Path::new("."), "");
    assert_eq!(output.code, Some(2));
    assert!(output.log.contains("Usage:"));
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
    assert_fails(
        &["train", "--test-views", "b,b"],
        2,
        &["--test-views", "`b`"],
    );
    assert_fails(&["train", "--cloud", "views:9"], 2, &["1 to 8"]);
    assert_fails(&["train", "--eval-every", "0"], 2, &["--eval-every"]);

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
    assert_fails(&["train", "--cloud", "no.ply"], 1, &["no.ply"]);
    assert_fails(&["eval", "no/run"], 1, &["no/run", "config.json"]);
    let args = [
        "render", "--model", "a.ply", "--scene", "no/scene", "--out", "b",
    ];
    assert_fails(&args, 1, &["no/scene"]);
}

#[test]
fn eval_refuses_before_it_renders() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let config = Config::preset("paper").unwrap();
    for (name, protocol) in [
        ("a", PoseProtocol::SharedFrame),
        ("b", PoseProtocol::SharedFrame),
        ("fitted", PoseProtocol::TestPoseFit),
    ] {
        let run = RunDir::create(&at(name), &config, false).unwrap();
        run.write_metrics(&metrics(protocol)).unwrap();
        std::fs::write(run.point_cloud(), "").unwrap();
    }
    std::fs::write(at("there.json"), "precious").unwrap();
    std::fs::create_dir(at("folder")).unwrap();
    for (args, code, parts) in [
        ("a a", 2, &["a: is named twice"][..]),
        ("a ./a", 2, &["named twice"]),
        ("a fitted", 1, &["`a`", "`fitted`", "table of their own"]),
        ("fitted", 1, &["fitted: ", "cannot do again"]),
        ("a --json there.json", 1, &["there.json", "--overwrite"]),
        ("a --csv there.json", 1, &["there.json", "--overwrite"]),
        ("a --json folder", 2, &["folder: is a folder"]),
        ("a --json none/x.json", 1, &["none/x.json"]),
        ("a --json x --csv x", 2, &["the same file"]),
        (
            "a --lpips-weights no.safetensors",
            1,
            &["no.safetensors: cannot read"],
        ),
        (
            "a --lpips-weights there.json",
            1,
            &["there.json", "safetensors file", "lpips.LPIPS"],
        ),
    ] {
        let args: Vec<&str> = ["eval"].into_iter().chain(args.split(' ')).collect();
        assert_fails_in(folder.path(), &args, code, parts);
    }
    assert_eq!(
        std::fs::read_to_string(at("there.json")).unwrap(),
        "precious"
    );
    assert!(!at("x").exists());
}

fn metrics(pose_protocol: PoseProtocol) -> Metrics {
    Metrics {
        version: "1".into(),
        commit: None,
        adapter: "none".into(),
        rasterizer: None,
        seed: 0,
        iterations: 1,
        scene: SceneRecord {
            source: "builtin:16".into(),
            cloud: None,
            name: "builtin".into(),
            train_views: Vec::new(),
            test_views: Vec::new(),
            n_test_trained: 0,
            n_points: 0,
            cloud_crc32: None,
            thumbnails: None,
            virtual_images: None,
            carved_points: None,
            pose_protocol,
        },
        seconds: Seconds::default(),
        memory: Memory::default(),
        loss: Vec::new(),
        model_size: Vec::new(),
        refined_poses: Vec::new(),
        curve: Vec::new(),
        signal: Vec::new(),
        trims: Vec::new(),
        lowering: None,
        energy_j: None,
        chosen: Vec::new(),
    }
}

#[test]
fn images_too_small_for_lpips_are_refused_before_training() {
    let folder = tempfile::tempdir().unwrap();
    let weights = generated(ALEX).bytes();
    std::fs::write(folder.path().join("w.safetensors"), weights).unwrap();
    let args = [
        "train",
        "--scene",
        "builtin:40",
        "--lpips-weights",
        "w.safetensors",
    ];
    assert_fails_in(
        folder.path(),
        &args,
        1,
        &["test view", "40x27", "31 pixels a side"],
    );
    // Else the same command with larger images would be refused.
    assert!(!folder.path().join("runs").exists());
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

#[test]
fn a_single_training_view_is_refused_with_the_paper_preset() {
    let scene = Folder::with_views(&["a.png", "b.png", "c.png"]);
    let folder = scene.path().to_str().expect("a path in UTF-8");
    let args = ["train", "--scene", folder, "--train-views", "a.png"];
    assert_fails(
        &args,
        1,
        &["2 training views, there are 1", "--preset 3dgs"],
    );
}

#[test]
fn a_scene_that_cannot_be_loaded_leaves_no_run() {
    let scene = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
    scene.write("sparse/0/points3D.ply", &GOOD_PLY[..GOOD_PLY.len() - 10]);
    let folder = scene.path().to_str().expect("a path in UTF-8");
    assert_fails(&["train", "--scene", folder], 1, &["points3D.ply"]);
}

/// Vulkan is the only backend there: a list of drivers that names none hides every adapter.
#[cfg(target_os = "linux")]
#[test]
fn a_missing_adapter_names_the_package_and_leaves_nothing() {
    for args in [
        &["train", "--scene", "builtin:16"][..],
        &["doctor", "--json", "doctor.json"],
    ] {
        let folder = tempfile::tempdir().unwrap();
        let mut hidden = command(folder.path(), args);
        hidden
            .env("VK_ICD_FILENAMES", "/nonexistent.json")
            .env("VK_DRIVER_FILES", "/nonexistent.json");
        let output = ended(&mut hidden);
        let stderr = &output.log;
        assert_eq!(output.code, Some(1), "{stderr}");
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
        assert!(stderr.contains("mesa-vulkan-drivers"), "{stderr}");
        // Else the same command would be refused once the driver is there.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

#[test]
fn render_refuses_what_is_no_model_and_no_camera() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("empty.ply", "");
    let header = GOOD_PLY.replace("ascii", "binary_little_endian");
    write("points.ply", &header);
    write("config.json", r#"{"preset": "paper"}"#);
    for (model, cameras, views, code, parts) in [
        ("no.ply", "no.json", None, 1, &["no.ply"][..]),
        ("empty.ply", "no.json", None, 1, &["empty.ply", "not a PLY"]),
        ("points.ply", "no.json", None, 1, &["points.ply", "f_dc_0"]),
        ("gaussian.ply", "no.json", None, 1, &["no.json"]),
        ("gaussian.ply", "empty.ply", None, 1, &["empty.ply", "JSON"]),
        (
            "gaussian.ply",
            "config.json",
            None,
            1,
            &["config.json", "list of cameras"],
        ),
        (
            "gaussian.ply",
            "many.json",
            Some("view_0"),
            2,
            &["`view_0`", "300 views", "view_1, "],
        ),
        ("gaussian.ply", "many.json", Some("train"), 2, &["--scene"]),
        (
            "gaussian.ply",
            "many.json",
            Some("virtual"),
            1,
            &["no camera"],
        ),
    ] {
        let mut args = vec![
            "render",
            "--model",
            model,
            "--cameras",
            cameras,
            "--out",
            "views",
        ];
        args.extend(views.iter().flat_map(|which| ["--views", which]));
        write("gaussian.ply", &gaussian_ply());
        write("many.json", &many_cameras());
        assert_fails_in(folder.path(), &args, code, parts);
        assert!(!folder.path().join("views").exists(), "{args:?}");
    }
    let args = [
        "render",
        "--model",
        "gaussian.ply",
        "--cameras",
        "many.json",
        "--out",
        "v",
    ];
    let output = run(
        folder.path(),
        &[&args[..], &["--views", "nobody"]].concat()[..],
    );
    let line = &output.log;
    assert!(line.len() < 300, "lists all of them: {line}");
}

/// A model of no Gaussians: enough to get to the cameras.
fn gaussian_ply() -> String {
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String = names
        .split(' ')
        .map(|name| format!("property float {name}\n"))
        .collect();
    format!("ply\nformat binary_little_endian 1.0\nelement vertex 0\n{properties}end_header\n")
}

/// 300 cameras, from `view_1` on.
fn many_cameras() -> String {
    let camera = |i: usize| {
        format!(
            r#"{{"img_name": "view_{i}", "width": 8, "height": 8, "fx": 8, "fy": 8,
            "position": [0, 0, {i}], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}}"#
        )
    };
    format!("[{}]", (1..=300).map(camera).collect::<Vec<_>>().join(","))
}
