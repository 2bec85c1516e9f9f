//! Every study once, from end to end.

use std::fs;
use std::path::Path;

use gspotential::report::read_png;
use serde_json::Value;

use super::kit::{TINY, files, json, succeeds};
use crate::kit::program::succeed;

#[test]
fn every_study_reports_in_text_numbers_and_pictures_and_trains_nothing_twice() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("studies");
    // Rows of the first table, and how many runs none before has trained.
    for (name, n_rows, n_new) in [
        ("ablation", 7, 7),
        ("sampling", 6, 5),
        // 3, 4, 5, 6 and 9 of the 10 views, with either preset.
        ("views", 10, 10),
        ("cloud", 8, 6 + 8),
        ("kernel", 4, 0),
        // One camera; all are there.
        ("pilot", 2, 1),
        // 5 lambdas, of which the method has one.
        ("parameters", 5, 4),
        // 4 predictors of 3 presets, of which the default one is new.
        ("potential", 12, 1),
        // Those three are there; the base, 7 with, 7 without, 3 set aside.
        ("parts", 3 + 7 + 1 + 7 + 3, 1 + 7 + 7 + 3),
        // With curves, so of their own.
        ("presets", 7, 7),
        // All systems that need no masks; the presets' are there.
        ("systems", 11, 5),
        // All; 3 degrees, 5 caps, 4 counts, 3 lengths and a half of 32 px; 8 pairs and the chosen one.
        ("need", 1 + 3 + 5 + 4 + 3 + 1 + 9, 3 + 5 + 4 + 3 + 1 + 9),
        // Three presets are there; an exact cloud and all photographs are new.
        ("ceiling", 5, 2),
    ] {
        let args = format!("{name} {TINY} --seeds 4");
        let (report, log) = succeeds(folder.path(), &args);
        let begun = log.lines().filter(|line| line.starts_with("run ")).count();
        assert_eq!(begun, n_new, "{name}: {log}");
        let markdown = fs::read_to_string(out.join(format!("{name}.md"))).unwrap();
        assert_eq!(report, markdown, "{name}");
        let page = fs::read_to_string(out.join(format!("{name}.html"))).unwrap();
        let runs = json(&out.join(format!("{name}.json")))["runs"].clone();
        for run in runs.as_array().unwrap() {
            assert!(page.contains(run.as_str().unwrap()), "{name}: {run}");
        }
        // Parts of them, and the default, which ends by itself.
        let iterations = if name == "need" { "1 to 700" } else { "3" };
        for part in [
            &format!("# {name}\n"),
            &format!("{iterations} iterations, seed 4, scene.n_test=6"),
            "at most 40 points",
            "test views of builtin",
            "One seed",
        ] {
            assert!(report.contains(part), "{name}: no `{part}` in {report}");
        }
        let data = json(&out.join(format!("{name}.json")));
        let rows = data["tables"][0]["rows"].as_array().expect("rows");
        assert_eq!(rows.len(), n_rows, "{name}");
        let measure = ["psnr", "spearman"]
            .into_iter()
            .find(|key| rows[0].get(key).is_some());
        let measure = measure.expect("a measure");
        for row in rows {
            assert!(row[measure]["mean"].is_number(), "{name}: {row}");
        }
        let csv = fs::read_to_string(out.join(format!("{name}.csv"))).unwrap();
        assert_eq!(csv.lines().count(), 1 + n_rows, "{name}");
        let pictures: Vec<&str> = report
            .lines()
            .filter_map(|l| l.strip_prefix("!["))
            .collect();
        assert!(!pictures.is_empty(), "{name}");
        for picture in pictures {
            let file = picture.split(['(', ')']).nth(1).expect("a link");
            if file == format!("{name}-renders.png") {
                read_png(&out.join(file)).expect("a picture");
                continue;
            }
            let svg = fs::read_to_string(out.join(file)).unwrap();
            assert!(
                svg.starts_with("<svg") && svg.contains("<circle"),
                "{name}: {file}"
            );
        }

        let of_methods = [
            "ablation",
            "sampling",
            "presets",
            "systems",
            "parameters",
            "ceiling",
        ];
        assert_eq!(
            report.contains(&format!("![renders]({name}-renders.png)")),
            of_methods.contains(&name),
            "{name}"
        );
        check_seconds(&out, &data["tables"][0]);
        let before = files(folder.path());
        let (_, log) = succeeds(folder.path(), &args);
        assert!(!log.contains("adapter: "), "{name} trains again: {log}");
        assert!(before == files(folder.path()), "{name}: files change");
    }
    // Every run is one that the other commands take.
    let run = "studies/runs/builtin-ablation-info-seed4";
    assert_eq!(
        json(&folder.path().join(run).join("config.json"))["preset"],
        "ablation-info"
    );
    // Presets that have fewer iterations of their own take as many as are stated, no share of them.
    for preset in ["curve-fast", "gspotential"] {
        let config = format!("studies/runs/builtin-{preset}-seed4/config.json");
        let config = json(&folder.path().join(config));
        assert_eq!(config["iterations"], 3, "{preset}");
    }
    // Stages that the run would end before begin as much sooner.
    let stage = |system: &str, pointer: &str| {
        let config = format!("studies/runs/builtin-curve-{system}-seed4/config.json");
        let config = json(&folder.path().join(config));
        config.pointer(pointer).expect("a stage").clone()
    };
    assert_eq!(stage("sparsegs", "/floaters/after"), 20000 * 3 / 30000);
    assert_eq!(stage("paper", "/coverage/start"), 0);
    assert_eq!(stage("3dgs", "/coverage/start"), 1000);
    check_ceiling(folder.path());
}

/// The ceiling's run is trained on all photographs and measured at the test views, and the report's
/// shares are of a whole.
fn check_ceiling(folder: &Path) {
    let root = |variant: &str| format!("studies/runs/builtin-gspotential{variant}-seed4");
    let scene = |variant: &str| {
        let metrics = folder.join(root(variant)).join("metrics.json");
        json(&metrics)["scene"].clone()
    };
    let names = |views: &Value| -> Vec<String> {
        let views = views.as_array().expect("views").iter();
        let name = |view: &Value| view["name"].as_str().or(view.as_str()).map(str::to_owned);
        views.map(|view| name(view).expect("a name")).collect()
    };
    let (own, ceiling) = (scene(""), scene("-all-photographs"));
    let (train, test) = (names(&own["train_views"]), names(&own["test_views"]));
    assert_eq!((train.len(), test.len()), (4, 6));
    assert_eq!(
        names(&ceiling["train_views"]),
        [train, test.clone()].concat()
    );
    assert_eq!(names(&ceiling["test_views"]), test);
    assert_eq!(
        (&own["n_test_trained"], &ceiling["n_test_trained"]),
        (&0.into(), &6.into())
    );
    let exact = scene("-exact-cloud");
    assert_eq!(
        (&exact["cloud"], &exact["n_test_trained"]),
        (&"exact".into(), &0.into())
    );
    // What is measured again is the same, and says what it was trained on.
    let eval = folder.join(root("-all-photographs")).join("eval.json");
    let before = json(&eval);
    assert_eq!(names(&before["views"]), test);
    fs::remove_file(&eval).unwrap();
    let again = succeed(
        folder,
        &format!("eval {} {}", root("-all-photographs"), root("")),
    );
    assert!(
        again.stdout.contains("trained on its test views, too"),
        "{}",
        again.stdout
    );
    assert_eq!(json(&eval), before);
    let page = fs::read_to_string(folder.join(root("-all-photographs")).join("report.html"));
    assert!(
        page.unwrap()
            .contains(" 6 of the test views were trained on.")
    );

    let data = json(&folder.join("studies/ceiling.json"));
    let rows = |i: usize| data["tables"][i]["rows"].as_array().expect("rows").clone();
    let value = |row: &Value, key: &str| -> f64 {
        let figure = row[key]["mean"].as_f64().or(row[key].as_f64());
        figure.unwrap_or_else(|| panic!("no {key} in {row}"))
    };
    let is_whole = |sum: f64| assert!((sum - 100.0).abs() < 1e-6, "{sum}");
    let [reach, by_pixels, remedies, by_angle] = [rows(1), rows(2), rows(3), rows(4)];
    assert_eq!(
        (reach.len(), by_pixels.len(), remedies.len()),
        (2, 5 * 4, 5 * 4)
    );
    for row in &reach {
        is_whole(
            ["geometry", "colour", "nobodys"]
                .iter()
                .map(|key| value(row, key))
                .sum(),
        );
        assert!(value(row, "cloud") < 100.0, "{row}");
    }
    for method in by_pixels.chunks(4) {
        is_whole(method.iter().map(|row| value(row, "pixel_share")).sum());
        is_whole(method.iter().map(|row| value(row, "error_share")).sum());
    }
    // A larger window and a freer fit take away more.
    for method in remedies.chunks(4) {
        let gone: Vec<f64> = method.iter().map(|row| value(row, "error_share")).collect();
        assert!(
            0.0 <= gone[0] && gone[0] <= gone[1] && gone[1] < 100.0,
            "{gone:?}"
        );
        assert!(
            0.0 < gone[2] && gone[2] < gone[3] && gone[3] < 100.0,
            "{gone:?}"
        );
        assert!(
            method.iter().all(|row| value(row, "db") >= 0.0),
            "{method:?}"
        );
    }
    let of_bins = |key: &str| by_angle.iter().map(|row| value(row, key)).sum::<f64>();
    assert_eq!(of_bins("n_views"), 6.0);
    for method in ["default", "ceiling", "3dgs"] {
        is_whole(of_bins(&format!("share_{method}")));
    }
    let notes = data["notes"].as_array().expect("notes");
    let last = notes.last().and_then(Value::as_str).expect("a sentence");
    assert!(
        last.starts_with("builtin: ") && last.contains("of the default's squared error"),
        "{last}"
    );
}

/// Every row has the time of one of the runs, from loading to the written model.
fn check_seconds(out: &Path, table: &Value) {
    let runs = fs::read_dir(out.join("runs")).expect("runs");
    let of_run = |run: fs::DirEntry| {
        let seconds = json(&run.path().join("metrics.json"))["seconds"].clone();
        let stages = [
            "load",
            "field",
            "carve",
            "sample",
            "splat",
            "gaussians",
            "files",
            "compile",
            "upload",
            "train",
            "write",
        ];
        stages
            .iter()
            .filter_map(|stage| seconds[stage].as_f64())
            .sum::<f64>()
    };
    let times: Vec<f64> = runs.map(|run| of_run(run.expect("a run"))).collect();
    for row in table["rows"].as_array().expect("rows") {
        let time = row["to_model_s"]["mean"].as_f64().expect("seconds");
        assert!(times.iter().any(|t| (t - time).abs() < 1e-9), "{row}");
    }
}
