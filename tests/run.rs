//! The run directory and what is written there.

use std::fs;

use gspotential::config::Config;
use gspotential::metrics::{CoveredScore, MaskedScore, ViewScore};
use gspotential::run::{
    CurvePoint, EnergyMeter, Evaluation, Memory, Metrics, ModelSize, RunDir, SceneRecord, Seconds,
    file_names, peak_host_bytes,
};
use gspotential::scene::PoseProtocol;
use gspotential::train::{ImageLoss, LossSample, SignalPoint, Trim};
use serde_json::Value;

fn config() -> Config {
    Config::preset("paper").unwrap().set("seed=7").unwrap()
}

fn view(name: &str, psnr: f64, ssim: f64) -> ViewScore {
    ViewScore {
        name: name.into(),
        psnr: Some(psnr),
        ssim: Some(ssim),
        lpips: None,
        fitted_psnr: Some(psnr + 1.0),
        masked: None,
        covered: None,
    }
}

#[test]
fn new_run_holds_its_config_and_folders() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("runs/a");
    let run = RunDir::create(&root, &config(), false).unwrap();
    assert_eq!(RunDir::open(&root).unwrap().config().unwrap(), config());
    assert!(run.test_views().is_dir() && run.virtual_sheet().parent().unwrap().is_dir());
    assert_eq!(
        RunDir::default_path("garden", &config()),
        std::path::Path::new("runs/garden-paper-seed7")
    );
}

#[test]
fn existing_run_is_refused_unless_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let run = RunDir::create(root, &config(), false).unwrap();
    let error = RunDir::create(root, &config(), false).unwrap_err();
    assert_eq!(error.exit_code(), 1);
    assert!(error.to_string().contains("--overwrite"), "{error}");

    // What an older run left must not stand beside the new one's; a user's notes may.
    for name in ["eval.json", "point_cloud.ply", "test/old.png", "notes.txt"] {
        fs::write(root.join(name), "old").unwrap();
    }
    // Two at work on one folder are refused.
    drop(run);
    let run = RunDir::create(root, &config(), true).unwrap();
    assert!(!root.join("eval.json").exists() && !run.point_cloud().exists());
    assert!(!root.join("test/old.png").exists());
    assert_eq!(fs::read_to_string(root.join("notes.txt")).unwrap(), "old");
}

#[test]
fn folder_that_is_no_run_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("test")).unwrap();
    fs::write(folder.path().join("test/precious.txt"), "x").unwrap();
    // Not even beside somebody else's config.json.
    for other in [None, Some("{\"preset\": 1}")] {
        if let Some(text) = other {
            fs::write(folder.path().join("config.json"), text).unwrap();
        }
        let error = RunDir::create(folder.path(), &config(), true).unwrap_err();
        assert!(error.to_string().contains("no run"), "{error}");
        assert!(folder.path().join("test/precious.txt").exists());
    }
}

#[test]
fn unwritable_output_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "x").unwrap();
    for root in [file.clone(), file.join("run")] {
        let error = RunDir::create(&root, &config(), false).unwrap_err();
        assert_eq!(error.exit_code(), 1);
        assert!(
            error.to_string().contains(&*root.to_string_lossy()),
            "{error}"
        );
    }
}

#[test]
fn folder_without_config_is_no_run() {
    let folder = tempfile::tempdir().unwrap();
    let error = RunDir::open(folder.path()).unwrap_err();
    assert!(error.to_string().contains("no config.json"), "{error}");
}

#[test]
fn evaluation_has_the_mean_of_the_views_values_and_null_for_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let run = RunDir::create(folder.path(), &config(), false).unwrap();
    let views = vec![view("a", 10.0, 0.25), view("b", 20.0, 0.75)];
    let evaluation = Evaluation::new(views, 42, Some(1.5));
    run.write_evaluation(&evaluation).unwrap();
    assert_eq!(run.evaluation().unwrap(), evaluation);

    let text = fs::read_to_string(folder.path().join("eval.json")).unwrap();
    let tree: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        tree,
        serde_json::json!({
            "mean": {"psnr": 15.0, "ssim": 0.5, "lpips": null},
            "views": [
                {"name": "a", "psnr": 10.0, "ssim": 0.25, "lpips": null, "fitted_psnr": 11.0,
                 "masked": null, "covered": null},
                {"name": "b", "psnr": 20.0, "ssim": 0.75, "lpips": null, "fitted_psnr": 21.0,
                 "masked": null, "covered": null},
            ],
            "n_gaussians": 42,
            "train_s": 1.5,
            "point_splat": null,
            "mean_masked": null,
            "mean_fitted_psnr": 16.0,
            "mean_covered": null,
            "measured": null,
        })
    );
    assert!(Evaluation::new(Vec::new(), 1, None).mean.psnr.is_none());
}

#[test]
fn an_evaluation_of_an_older_version_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let run = RunDir::create(folder.path(), &config(), false).unwrap();
    let text = r#"{"mean": {"psnr": 15.0, "ssim": 0.5, "lpips": null},
        "views": [{"name": "a", "psnr": 15.0, "ssim": 0.5, "lpips": null}],
        "n_gaussians": 42, "train_s": 1.5, "point_splat": null}"#;
    fs::write(folder.path().join("eval.json"), text).unwrap();
    let evaluation = run.evaluation().unwrap();
    assert_eq!(evaluation.mean.psnr, Some(15.0));
    assert!(evaluation.measured.is_none() && evaluation.views[0].masked.is_none());
    assert!(evaluation.mean_fitted_psnr.is_none());
}

#[test]
fn an_infinite_psnr_is_infinite_again_when_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let run = RunDir::create(folder.path(), &config(), false).unwrap();
    let mut views = vec![view("a", f64::INFINITY, 1.0), view("b", 20.0, 0.75)];
    views[1].masked = Some(MaskedScore {
        psnr: Some(f64::INFINITY),
        ssim: Some(1.0),
        lpips: None,
        coverage: 0.5,
    });
    let covered = |psnr, coverage| Some(CoveredScore { psnr, coverage });
    views[0].covered = covered(Some(f64::INFINITY), 0.5);
    // Nothing is covered: a null that stays one.
    views[1].covered = covered(None, 0.0);
    let evaluation = Evaluation::new(views, 42, None);
    run.write_evaluation(&evaluation).unwrap();
    assert_eq!(run.evaluation().unwrap(), evaluation);
}

#[test]
fn covered_means_are_over_the_views_of_which_something_is_covered() {
    let mut views = vec![view("a", 10.0, 0.5), view("b", 20.0, 0.5)];
    let score = |psnr, coverage| Some(CoveredScore { psnr, coverage });
    views[0].covered = score(Some(12.0), 0.5);
    views[1].covered = score(None, 0.0);
    let evaluation = Evaluation::new(views.clone(), 1, None);
    assert_eq!(evaluation.mean_covered, score(Some(12.0), 0.25));
    views[1].covered = score(Some(16.0), 1.0);
    let evaluation = Evaluation::new(views, 1, None);
    assert_eq!(evaluation.mean_covered, score(Some(14.0), 0.75));
}

#[test]
fn masked_means_are_over_the_views_that_have_a_mask() {
    let mut views = vec![
        view("a", 10.0, 0.5),
        view("b", 20.0, 0.75),
        view("c", 30.0, 1.0),
    ];
    for (i, psnr) in [(0, 12.0), (2, 16.0)] {
        views[i].masked = Some(MaskedScore {
            psnr: Some(psnr),
            ssim: Some(0.25),
            lpips: (i == 0).then_some(0.5),
            coverage: 0.5,
        });
    }
    let masked = Evaluation::new(views, 1, None).mean_masked.unwrap();
    assert_eq!((masked.n_views, masked.mean.psnr), (2, Some(14.0)));
    // One of them lacks it.
    assert_eq!(masked.mean.lpips, None);
    assert!(
        Evaluation::new(vec![view("a", 1.0, 1.0)], 1, None)
            .mean_masked
            .is_none()
    );
}

#[test]
fn time_to_the_model_is_from_loading_to_writing_without_evaluation() {
    // Powers of two: the sum tells what is in it.
    let power = |k: i32| Some(2f64.powi(k));
    let seconds = Seconds {
        load: power(0),
        field: power(1),
        carve: power(2),
        sample: power(3),
        splat: power(4),
        gaussians: power(5),
        files: power(6),
        compile: power(7),
        upload: power(8),
        train: power(9),
        write: power(10),
        // Before loading, sums and parts of the above, and after the model.
        open: power(11),
        to_first_iteration: power(12),
        first_iteration: power(13),
        densify: power(14),
        signal: power(18),
        checkpoints: power(15),
        eval: power(16),
        report: power(17),
    };
    assert_eq!(seconds.to_model(), Some(2047.0));
    let reloaded = Seconds {
        carve: None,
        ..seconds
    };
    assert_eq!(reloaded.to_model(), Some(2043.0));
    assert_eq!(Seconds::default().to_model(), None);
}

#[test]
fn infinite_psnr_is_null_in_json() {
    let evaluation = Evaluation::new(vec![view("a", f64::INFINITY, 1.0)], 1, None);
    let tree = serde_json::to_value(&evaluation).unwrap();
    assert!(tree["views"][0]["psnr"].is_null() && tree["mean"]["psnr"].is_null());
    assert_eq!(tree["mean"]["ssim"], 1.0);
}

#[test]
fn metrics_read_back_and_keep_what_may_vary_apart() {
    let folder = tempfile::tempdir().unwrap();
    let run = RunDir::create(folder.path(), &config(), false).unwrap();
    let metrics = Metrics {
        version: "1".into(),
        commit: None,
        adapter: "none".into(),
        rasterizer: None,
        seed: 7,
        iterations: 10,
        scene: SceneRecord {
            source: "builtin:64".into(),
            cloud: Some("random".into()),
            name: "builtin".into(),
            train_views: vec!["a".into()],
            test_views: vec!["b".into()],
            n_test_trained: 0,
            n_points: 3,
            cloud_crc32: None,
            thumbnails: None,
            virtual_images: None,
            carved_points: None,
            pose_protocol: PoseProtocol::SharedFrame,
        },
        seconds: Seconds {
            train: Some(0.5),
            ..Seconds::default()
        },
        memory: Memory {
            host_peak_bytes: peak_host_bytes(),
            gpu_peak_bytes: Some(1),
        },
        loss: vec![LossSample {
            iteration: 1,
            loss: 0.1,
            real: ImageLoss {
                l1: 0.05,
                ssim: 0.7,
            },
            virt: None,
            depths: None,
        }],
        model_size: vec![ModelSize {
            iteration: 0,
            n_gaussians: 3,
            plan: None,
        }],
        refined_poses: Vec::new(),
        curve: vec![CurvePoint {
            iteration: 5,
            n_gaussians: 3,
            train_s: Some(0.5),
            psnr: Some(20.5),
            ssim: None,
        }],
        signal: vec![SignalPoint {
            iteration: 5,
            n_gaussians: 3,
            held_out: 21.5,
            photographs: None,
        }],
        trims: vec![Trim {
            iteration: 5,
            n_before: 4,
            n_after: 3,
            allowed_db: 0.05,
            over_budget: 0,
            cost_db: -0.01,
            contribution: 0.125,
        }],
        lowering: None,
        energy_j: None,
        chosen: vec!["3 Gaussians of 4".into()],
    };
    run.write_metrics(&metrics).unwrap();
    assert_eq!(run.metrics().unwrap(), metrics);
    let tree = serde_json::to_value(&metrics).unwrap();
    assert_eq!(tree["scene"]["pose_protocol"], "shared_frame");
    assert!(tree["seconds"]["load"].is_null());
    for stage in ["load", "field", "sample", "splat", "train", "eval"] {
        assert!(tree["seconds"].get(stage).is_some(), "no `{stage}`");
    }

    fs::write(folder.path().join("metrics.json"), "{").unwrap();
    let error = run.metrics().unwrap_err().to_string();
    assert!(error.contains("metrics.json"), "{error}");
}

#[test]
#[cfg(target_os = "linux")]
fn peak_memory_covers_what_was_touched() {
    let block = vec![1u8; 64 << 20];
    let peak = peak_host_bytes().unwrap();
    assert!((64 << 20..1 << 40).contains(&peak), "{peak}");
    assert_eq!(std::hint::black_box(&block)[77], 1);
}

#[test]
fn view_names_become_file_names_that_stay_in_their_folder_and_differ() {
    assert_eq!(
        file_names(
            &["DSC001.JPG", "virtual_000", "left/1.png", "right/1.png"],
            "png"
        ),
        ["DSC001.png", "virtual_000.png", "left_1.png", "right_1.png"]
    );
    assert_eq!(
        file_names(&["1.jpg", "1.png", "A.jpg", "a.png"], "exr"),
        ["1.jpg.exr", "1.png.exr", "A.jpg.exr", "a.png.exr"]
    );
    // Alike even with their extensions.
    assert_eq!(
        file_names(&["a/b.png", "a_b.png"], "png"),
        ["a_b.png.png", "a_b.png_2.png"]
    );
    assert_eq!(
        file_names(&["contact_sheet.jpg"], "png"),
        ["contact_sheet_2.png"]
    );
    for name in file_names(
        &[
            "../../etc/passwd",
            "/root/x.png",
            "..",
            "",
            "a\\..\\b",
            "a\0b\n.png",
            "C:x",
        ],
        "png",
    ) {
        assert!(!name.contains(['/', '\\', ':', '\0', '\n']), "{name}");
        assert!(!name.starts_with('.'), "{name}");
    }
}

#[test]
fn the_energy_of_all_packages_is_read_past_the_counters_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |path: &str, text: &str| {
        let path = folder.path().join(path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(path, text).expect("written");
    };
    assert!(EnergyMeter::start(folder.path()).is_none());
    assert!(EnergyMeter::start(&folder.path().join("none")).is_none());
    for (zone, name) in [
        ("rapl:0", "package-0"),
        ("rapl:1", "package-1"),
        ("rapl:0:0", "core"),
    ] {
        write(&format!("{zone}/name"), &format!("{name}\n"));
        write(&format!("{zone}/energy_uj"), "9000000\n");
        write(&format!("{zone}/max_energy_range_uj"), "10000000\n");
    }
    let meter = EnergyMeter::start(folder.path()).expect("two packages");
    assert_eq!(meter.joules(), Some(0.0));
    write("rapl:0/energy_uj", "9500000\n");
    write("rapl:1/energy_uj", "250000\n");
    // A part of a package is in the package.
    write("rapl:0:0/energy_uj", "9999999\n");
    assert_eq!(meter.joules(), Some(0.5 + 1.25));
    write("rapl:1/energy_uj", "cut");
    assert_eq!(meter.joules(), None);
}
