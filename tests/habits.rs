//! Commands around training: the field alone, presets, completions, adapters, logs, a dry run,
//! exports.

use std::path::Path;
use std::process::Command;

use gspotential::config::{Config, PRESETS, keys, summary};
use gspotential::version::{COMMIT, WITH_COMMIT};

use crate::kit::program::{run, succeed};

fn stdout(folder: &Path, line: &str) -> String {
    succeed(folder, line).stdout
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[test]
fn the_field_is_shown_with_advice() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(folder.path(), "field --scene builtin:32 --out f");
    for part in [
        "train_00.png",
        "uncovered on average",
        "One more photograph",
        "walk",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let report = json(&folder.path().join("f/field.json"));
    assert_eq!(report["training"].as_array().unwrap().len(), 4);
    let advice = &report["advice"];
    let (before, after) = (&report["uncovered"]["mean"], &advice["mean_uncovered"]);
    assert!(after.as_f64().unwrap() < before.as_f64().unwrap());
    // The route leads from the nearest training view to the advised place.
    let nearest = report["training"]
        .as_array()
        .unwrap()
        .iter()
        .find(|view| view["name"] == advice["place"]["nearest"])
        .unwrap();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let turn = number(&nearest["azimuth"]) + number(&advice["to_the_right"]);
    let off = turn - number(&advice["place"]["azimuth"]);
    let off = (off + 180.0).rem_euclid(360.0) - 180.0;
    assert!(off.abs() < 1e-6, "{report}");
    for svg in ["f/field.svg", "f/gaps.svg"] {
        let svg = std::fs::read_to_string(folder.path().join(svg)).unwrap();
        assert!(svg.starts_with("<svg"));
    }
}

#[test]
fn every_key_is_documented_and_in_every_preset() {
    let keys = keys().unwrap();
    let undocumented: Vec<&str> = keys
        .iter()
        .filter(|key| key.doc.is_empty())
        .map(|key| key.key.as_str())
        .collect();
    assert!(undocumented.is_empty(), "{undocumented:?}");
    for (i, (name, _)) in PRESETS.iter().enumerate() {
        assert!(!summary(name).is_empty(), "{name}");
        let config = Config::preset(name).unwrap();
        let tree: serde_json::Value = serde_json::from_str(&config.to_json().unwrap()).unwrap();
        assert_eq!(keys.len(), n_leaves(&tree), "{name}");
        for key in &keys {
            let pointer = format!("/{}", key.key.replace('.', "/"));
            assert_eq!(tree.pointer(&pointer), Some(&key.values[i]), "{}", key.key);
        }
    }
}

fn n_leaves(tree: &serde_json::Value) -> usize {
    match tree {
        serde_json::Value::Object(section) => section.values().map(n_leaves).sum(),
        _ => 1,
    }
}

#[test]
fn presets_are_listed_with_their_differences() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(folder.path(), "presets");
    assert!(
        text.contains("| views.count") && !text.contains("field.sigma"),
        "{text}"
    );
    let text = stdout(folder.path(), "presets --keys");
    assert!(text.contains("- `loss.ssim_weight` = 0.2"), "{text}");
}

#[test]
fn completions_and_adapters_are_printed() {
    let folder = tempfile::tempdir().unwrap();
    for (shell, part) in [
        ("bash", "complete -F"),
        ("zsh", "#compdef"),
        ("fish", "complete -c"),
    ] {
        let script = stdout(folder.path(), &format!("completions {shell}"));
        assert!(
            script.contains(part) && script.contains("max-points"),
            "{shell}"
        );
    }
    let adapters = stdout(folder.path(), "list-adapters");
    assert!(adapters.lines().count() >= 3, "{adapters}");
}

#[test]
fn the_manual_has_a_page_for_every_command() {
    let folder = tempfile::tempdir().unwrap();
    succeed(folder.path(), "man pages/man1");
    let page = |name: &str| std::fs::read_to_string(folder.path().join("pages/man1").join(name));
    assert!(
        page("gspotential.1")
            .unwrap()
            .contains("gspotential\\-train(1)")
    );
    let train = page("gspotential-train.1").unwrap();
    assert!(
        train.starts_with(".ie") && train.contains("max\\-points"),
        "{train}"
    );
    let help = stdout(folder.path(), "--help");
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let commands = commands.take_while(|line| !line.is_empty());
    let commands: Vec<&str> = commands
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    assert!(commands.len() > 10, "{help}");
    for command in commands.into_iter().filter(|command| *command != "help") {
        assert!(
            page(&format!("gspotential-{command}.1")).is_ok(),
            "{command}"
        );
    }
    let refused = run(folder.path(), "man pages/man1/gspotential.1");
    assert_eq!(refused.code, Some(1), "{}", refused.log);
}

#[test]
fn the_version_names_the_commit_where_there_is_one() {
    let folder = tempfile::tempdir().unwrap();
    let version = stdout(folder.path(), "--version");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let asked = Command::new("git")
        .args(["rev-parse", "HEAD"])
        .current_dir(root)
        .output();
    // Neither in a package nor without git.
    let head = asked.ok().filter(|_| root.join(".git").exists());
    let head = head.filter(|output| output.status.success());
    let commit = head.map(|output| String::from_utf8(output.stdout).unwrap()[..12].to_owned());
    let expected = match &commit {
        Some(commit) => format!("gspotential {} ({commit})\n", env!("CARGO_PKG_VERSION")),
        None => format!("gspotential {}\n", env!("CARGO_PKG_VERSION")),
    };
    assert_eq!(version, expected);
    assert_eq!(commit.as_deref(), COMMIT);
    assert_eq!(
        version.trim_start_matches("gspotential ").trim(),
        WITH_COMMIT
    );
}

#[test]
fn an_adapter_that_is_not_there_is_a_usage_error_that_lists_those_that_are() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(
        folder.path(),
        "train --scene builtin:32 --adapter unheard-of",
    );
    assert_eq!(output.code, Some(2));
    let log = output.log;
    assert!(
        log.contains("`unheard-of`") && log.contains("there are"),
        "{log}"
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

const TINY: &str = "train --scene builtin:32 --iterations 5 --set views.count=6 \
                    --set scene.n_test=2 --max-points 200 --out run";

#[test]
fn a_dry_run_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(folder.path(), &format!("{TINY} --dry-run"));
    for part in [
        "| training views",
        "4 of 32x",
        "| virtual views",
        "5 iterations",
        "| Adam's moments ",
        "| target images of the virtual views ",
        " ms",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn logs_are_quiet_or_json_and_a_run_is_exported() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &format!("{TINY} --quiet --threads 1"));
    assert_eq!(output.code, Some(0));
    assert_eq!(output.log, "");

    let output = run(folder.path(), &format!("{TINY} --overwrite --log json"));
    assert_eq!(output.code, Some(0));
    let log = output.log;
    let lines: Vec<serde_json::Value> = log
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}")))
        .collect();
    let has = |level: &str, stage: &str| {
        let is = |line: &&serde_json::Value| line["level"] == level && line["stage"] == stage;
        lines.iter().any(|line| is(&line))
    };
    assert!(
        has("progress", "training") && has("progress", "evaluation"),
        "{log}"
    );
    assert!(lines.iter().any(|line| line["level"] == "info"), "{log}");
    let output = run(folder.path(), &format!("{TINY} --log json"));
    let log = output.log;
    let line: serde_json::Value = serde_json::from_str(log.trim()).unwrap();
    assert_eq!(line["level"], "error");

    stdout(folder.path(), "export run --out run.splat");
    let n = json(&folder.path().join("run/eval.json"))["n_gaussians"]
        .as_u64()
        .unwrap();
    let n_bytes = std::fs::metadata(folder.path().join("run.splat"))
        .unwrap()
        .len();
    assert_eq!(n_bytes, 32 * n);
    stdout(folder.path(), "export run --out run.spz");
    let is_smaller = std::fs::metadata(folder.path().join("run.spz"))
        .unwrap()
        .len()
        < n_bytes;
    assert!(is_smaller);
    let output = run(folder.path(), "export run --out run.obj");
    assert_eq!(output.code, Some(2));

    // A page that is gone is made again, and one over all runs where it is asked for.
    std::fs::remove_file(folder.path().join("run/report.html")).unwrap();
    stdout(folder.path(), "eval run --html runs.html");
    assert!(folder.path().join("run/report.html").is_file());
    let page = std::fs::read_to_string(folder.path().join("runs.html")).unwrap();
    assert!(
        page.contains("<h1>1 run</h1>") && page.contains("builtin"),
        "{page}"
    );
    let output = run(folder.path(), "eval run --html runs.html");
    assert_eq!(output.code, Some(1), "it is there already");
}

/// An opaque ball of Gaussians seen from a distance of 2, in a scene of another unit.
#[test]
fn depth_opacity_and_an_orbit_are_rendered() {
    use glam::{DMat3, DVec3, Vec3};
    use gspotential::camera::{Camera, Frame};
    let folder = tempfile::tempdir().unwrap();
    let any = Camera {
        name: String::new(),
        width: 33,
        height: 33,
        fx: 40.0,
        fy: 40.0,
        cx: 16.5,
        cy: 16.5,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let looking = |name: &str, eye| any.looking_at(name.to_owned(), eye, DVec3::ZERO, DVec3::Z);
    let cameras = [
        looking("a", DVec3::new(2.0, 0.0, 0.0)),
        looking("b", DVec3::new(0.0, 3.0, 0.0)),
    ];
    gspotential::camera::json::write_cameras(&folder.path().join("c.json"), &cameras, DVec3::ZERO)
        .unwrap();
    let ball = gspotential::gaussians::Gaussians {
        means: vec![Vec3::ZERO],
        scales_log: vec![Vec3::splat(0.1f32.ln())],
        rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![4.0],
        sh: vec![1.0, 0.0, 0.0],
        sh_degree: 0,
    };
    let model = folder.path().join("m.ply");
    gspotential::gaussians::ply::write_ply(&model, &ball, &Frame::IDENTITY).unwrap();
    stdout(
        folder.path(),
        "render --model m.ply --cameras c.json --out v --depth --alpha --orbit 4",
    );
    let at = |name: &str| folder.path().join("v").join(name);
    // At their median distance, the upper one of two.
    let depth = image::open(at("orbit_001_depth.exr"))
        .unwrap()
        .into_rgb32f();
    assert!(
        (depth.get_pixel(16, 16).0[0] - 3.0).abs() < 1e-4,
        "{:?}",
        depth.get_pixel(16, 16)
    );
    assert_eq!(depth.get_pixel(0, 0).0, [0.0; 3]);
    let alpha = image::open(at("orbit_001_alpha.png"))
        .unwrap()
        .into_luma16();
    let expected = 65535.0 / (1.0 + (-4.0f64).exp());
    assert!((f64::from(alpha.get_pixel(16, 16).0[0]) - expected).abs() < 66.0);
    assert_eq!(alpha.get_pixel(0, 0).0, [0]);
    let animation = std::fs::read(at("orbit.png")).unwrap();
    let decoder = png::Decoder::new(std::io::Cursor::new(&animation))
        .read_info()
        .unwrap();
    assert_eq!(decoder.info().animation_control().unwrap().num_frames, 4);
    let still = image::open(at("orbit_000.png")).unwrap().into_rgb8();
    assert_eq!(
        image::load_from_memory(&animation).unwrap().into_rgb8(),
        still
    );
}
