//! The three commands in a row, on a tiny scene: what the README promises of a run.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(folder: &Path, args: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_gspotential"))
        .args(args)
        .current_dir(folder)
        .output()
        .expect("the command starts");
    assert!(
        output.status.success(),
        "{args:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).expect("a file")).expect("JSON")
}

fn file_names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_run_holds_what_the_readme_says_and_can_be_evaluated_and_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let at = |path: &str| folder.path().join(path);
    let train = "train --scene builtin:32 --iterations 5 --seed 3 --set views.count=6 \
                 --set scene.n_test=2 --max-points 200";
    let train: Vec<&str> = train.split_whitespace().collect();
    let output = run(folder.path(), &train);
    let table = String::from_utf8(output.stdout).unwrap();
    assert!(table.contains("| **mean of 2** |"), "{table}");
    let log = String::from_utf8(output.stderr).unwrap();
    assert!(log.contains("adapter: ") && log.contains("5/5 "), "{log}");

    let root = "runs/builtin-paper-seed3";
    assert_eq!(
        file_names(&at(root)),
        [
            "cameras.json",
            "config.json",
            "eval.json",
            "metrics.json",
            "point_cloud.ply",
            "report.html",
            "test",
            "virtual"
        ]
    );
    assert_eq!(
        file_names(&at(root).join("test")),
        ["contact_sheet.png", "test_00.png", "test_01.png"]
    );
    let metrics = json(&at(root).join("metrics.json"));
    for stage in ["load", "field", "sample", "splat", "train", "eval"] {
        assert!(metrics["seconds"][stage].is_number(), "{stage}: {metrics}");
    }
    let trained = json(&at(root).join("eval.json"));
    let psnr = trained["mean"]["psnr"].as_f64().expect("a PSNR");
    assert!(
        psnr > 5.0 && trained["mean"]["lpips"].is_null(),
        "{trained}"
    );
    assert_eq!(trained["n_gaussians"], 200);

    // What is measured again is what was measured: both start from the file.
    let image = fs::read(at(root).join("test/test_00.png")).unwrap();
    fs::remove_file(at(root).join("eval.json")).unwrap();
    let output = run(folder.path(), &["eval", root]);
    assert_eq!(
        String::from_utf8(output.stdout).unwrap().trim(),
        table.trim()
    );
    assert_eq!(json(&at(root).join("eval.json")), trained);

    let model = format!("{root}/point_cloud.ply");
    let cameras = format!("{root}/cameras.json");
    let render = |out: &str, rest: &[&str]| {
        let args = ["render", "--model", &model, "--out", out];
        run(folder.path(), &[&args[..], rest].concat());
        file_names(&at(out))
    };
    let virtual_views: Vec<String> = (0..6).map(|i| format!("virtual_00{i}.exr")).collect();
    let from_file = [
        "--cameras",
        &cameras,
        "--views",
        "virtual",
        "--format",
        "exr",
    ];
    assert_eq!(render("a", &from_file), virtual_views);
    assert_eq!(render("b", &["--cameras", &cameras]).len(), 4 + 2 + 6);
    let train_views: Vec<String> = (0..4).map(|i| format!("train_0{i}.png")).collect();
    let from_scene = ["--scene", "builtin:32", "--views", "train"];
    assert_eq!(render("c", &from_scene), train_views);
    let named = ["--cameras", &cameras, "--views", "test_00.png,train_02.png"];
    assert_eq!(render("d", &named), ["test_00.png", "train_02.png"]);
    // The frame that a camera file's own cameras span sets the near plane alone.
    assert_eq!(fs::read(at("d").join("test_00.png")).unwrap(), image);
}

#[test]
fn a_run_that_was_cut_short_is_no_run_to_evaluate() {
    let folder = tempfile::tempdir().unwrap();
    let args = "train --scene builtin:32 --iterations 1 --preset 3dgs --set scene.n_test=1 \
                --max-points 50 --out run";
    run(folder.path(), &args.split_whitespace().collect::<Vec<_>>());
    fs::remove_file(folder.path().join("run/metrics.json")).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_gspotential"))
        .args(["eval", "run"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let line = String::from_utf8(output.stderr).unwrap();
    assert!(
        line.starts_with("error: ") && line.contains("metrics.json"),
        "{line}"
    );
}
