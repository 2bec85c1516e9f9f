//! Tiny studies through the command.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use gspotential::camera::Camera;
use gspotential::dense::{CloudOptions, DepthMap, cloud};
use gspotential::field::Focus;
use gspotential::report::read_png;
use gspotential::scene::builtin::{self, BuiltinOptions};
use gspotential::scene::{Image, View, write_model};
use serde_json::Value;

use crate::kit::program::{Ended, run, succeed};
use crate::metrics::lpips_reference::{ALEX, generated};
use crate::scene::build::{Folder, GOOD_PLY};

fn study(folder: &Path, args: &str) -> Ended {
    run(folder, &format!("study {args}"))
}

/// What a study that must succeed printed: its report and its log.
#[track_caller]
fn succeeds(folder: &Path, args: &str) -> (String, String) {
    let Ended { stdout, log, .. } = succeed(folder, &format!("study {args}"));
    (stdout, log)
}

/// The error of a study that must fail.
#[track_caller]
fn fails(folder: &Path, args: &str, code: i32, parts: &[&str]) -> String {
    let output = study(folder, args);
    let log = output.log;
    assert_eq!(output.code, Some(code), "{args}: {log}");
    assert!(output.stdout.is_empty(), "{args}");
    let error = log.lines().find(|line| line.starts_with("error: "));
    let error = error.unwrap_or_else(|| panic!("{args}: {log}"));
    for part in parts {
        assert!(error.contains(part), "{args}: no `{part}` in: {error}");
    }
    log
}

/// Every file below a folder with its bytes.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = fs::read(&path).expect("a file");
                found.insert(path.display().to_string(), bytes);
            }
        }
    }
    found
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).expect("a file")).expect("JSON")
}

const TINY: &str = "--scene builtin:32 --iterations 3 --max-points 40 --set scene.n_test=6 \
                    --set field.n_candidates=1024 --set views.count=3";

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
        // Those three are there; the base, 6 with, 6 without, 3 set aside.
        ("parts", 3 + 6 + 1 + 6 + 3, 1 + 6 + 6 + 3),
        // With curves, so of their own.
        ("presets", 7, 7),
        // All systems that need no masks; three are there.
        ("systems", 11, 8),
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
        for part in [
            &format!("# {name}\n"),
            "3 iterations, seed 4, scene.n_test=6",
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

/// A report without the last column of its tables, which holds the seconds.
fn without_seconds(report: &str) -> Vec<&str> {
    let lines = report.lines();
    let cut = lines.map(|line| match line.strip_suffix('|') {
        Some(row) => row.rsplit_once('|').map_or(row, |(rest, _)| rest),
        None => line,
    });
    cut.collect()
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

#[test]
fn the_pilot_counts_every_viewpoint_once_and_pairs_neighbours() {
    let folder = tempfile::tempdir().unwrap();
    let (report, log) = succeeds(folder.path(), &format!("pilot {TINY} --seeds 0"));
    assert!(log.contains("stand in one place"), "{log}");
    assert!(
        report.contains("peaks: ") && report.contains("Valleys: "),
        "{report}"
    );
    let data = json(&folder.path().join("studies/pilot.json"));
    let rows = |i: usize| data["tables"][i]["rows"].as_array().expect("rows").clone();
    let total = |key: &str| -> f64 {
        rows(1)
            .iter()
            .map(|row| row[key]["mean"].as_f64().expect("a count"))
            .sum()
    };
    assert!(total("n_one") > 400.0 && total("n_one") == total("n_all"));
    // With four cameras on a ring nothing is as far from the nearest as with one.
    let far = &rows(1)[6];
    assert!(
        far["n_one"]["mean"].as_f64() > Some(0.0) && far["psnr_all"].is_null(),
        "{far}"
    );
    let scene = builtin::scene(&BuiltinOptions {
        width: 32,
        n_test: 6,
        ..Default::default()
    });
    let cameras: Vec<_> = scene.train.iter().map(|view| view.camera.clone()).collect();
    let focus = Focus::find(&cameras, &scene.cloud).expect("a focus").center;
    let towards = |i: usize| (cameras[i].center() - focus).normalize();
    // The ring in order of azimuth.
    let pairs = [(0, 1), (0, 3), (1, 2), (2, 3)];
    assert_eq!(rows(2).len(), pairs.len());
    for (row, (i, j)) in rows(2).iter().zip(pairs) {
        assert_eq!(row["pair"], format!("train_0{i}.png, train_0{j}.png"));
        let gap = towards(i).dot(towards(j)).acos().to_degrees();
        assert!(
            (row["gap"]["mean"].as_f64().expect("degrees") - gap).abs() < 1e-6,
            "{row}"
        );
    }
    // The maps' colours say the same: the scale's top, middle and bottom are written alike.
    let bar = |which: &str| -> Vec<String> {
        let name = format!("studies/pilot-builtin-{which}.svg");
        let svg = fs::read_to_string(folder.path().join(name)).expect("a map");
        let texts = svg.split("<text").filter_map(|text| text.split_once('>'));
        let texts = texts.filter_map(|(_, text)| text.split_once("</text>"));
        let texts = texts.map(|(text, _)| text.trim().to_owned());
        let after = texts.skip_while(|text| !text.starts_with("training ("));
        after.skip(1).take(3).collect()
    };
    assert!(
        bar("1-camera")
            .iter()
            .all(|text| text.parse::<f64>().is_ok())
    );
    assert_eq!(bar("1-camera").len(), 3);
    assert_eq!(bar("1-camera"), bar("all-cameras"));
}

#[test]
fn what_is_left_of_a_study_is_done_and_what_another_left_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let args = format!("potential {TINY} --seeds 0,1");
    let (listed, _) = succeeds(folder.path(), &format!("{args} --list"));
    assert_eq!(listed.matches("to train").count(), 6, "{listed}");
    assert!(!folder.path().join("studies").exists());
    let (report, _) = succeeds(folder.path(), &args);

    let runs = folder.path().join("studies/runs");
    fs::remove_file(runs.join("builtin-3dgs-seed1/metrics.json")).unwrap();
    fs::remove_file(runs.join("builtin-paper-seed0/eval.json")).unwrap();
    let (listed, _) = succeeds(folder.path(), &format!("{args} --list"));
    let state = |run: &str| {
        listed
            .lines()
            .find(|l| l.contains(run))
            .expect("the run")
            .to_owned()
    };
    assert!(state("builtin-3dgs-seed1").contains("to train"), "{listed}");
    assert!(
        state("builtin-paper-seed0").contains("to measure"),
        "{listed}"
    );
    assert_eq!(listed.matches(" done ").count(), 4, "{listed}");
    let (again, log) = succeeds(folder.path(), &args);
    assert_eq!(without_seconds(&again), without_seconds(&report));
    assert!(log.contains("6 runs, 4 of them done already"), "{log}");

    // Another config, another scene under the same name, and what is no run.
    let longer = args.replace("--iterations 3", "--iterations 4");
    let parts = ["builtin-3dgs-seed0", "`iterations` is 3, not 4", "--out"];
    fails(folder.path(), &longer, 1, &parts);
    let larger = args.replace("builtin:32", "builtin:24");
    fails(folder.path(), &larger, 1, &["its scene is builtin:32"]);
    fs::remove_dir_all(runs.join("builtin-paper-seed1")).unwrap();
    fs::create_dir(runs.join("builtin-paper-seed1")).unwrap();
    fs::write(runs.join("builtin-paper-seed1/notes.txt"), "mine").unwrap();
    let log = fails(
        folder.path(),
        &args,
        1,
        &["builtin-paper-seed1", "is not empty"],
    );
    assert!(!log.contains("adapter: "), "{log}");
}

#[test]
fn a_run_that_fails_keeps_no_other_from_being_done() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["a.png", "b.png", "c.png", "d.png", "e.png", "f.png"];
    let scene = Folder::with_views(&names);
    scene.write(
        "sparse/0/points3D_bad.ply",
        &GOOD_PLY[..GOOD_PLY.len() - 10],
    );
    let dir = scene.path().to_str().expect("UTF-8");
    let args = format!("cloud --scene {dir} --iterations 2 --set views.count=2 --seeds 0");
    let log = fails(
        folder.path(),
        &args,
        1,
        &["2 of 12 runs failed", "points3D_bad", "the same command"],
    );
    // Three points for six small photographs: told what makes more of them.
    let told = format!("the cloud is sparse, 3 points; `gspotential scene --cameras {dir} ");
    assert!(log.contains(&told), "{log}");
    assert_eq!(log.matches(" failed: ").count(), 2, "{log}");
    let out = folder.path().join("studies");
    assert!(!out.join("cloud.md").exists());
    assert_eq!(fs::read_dir(out.join("runs")).unwrap().count(), 10);

    scene.write("sparse/0/points3D_bad.ply", GOOD_PLY);
    let (report, log) = succeeds(folder.path(), &args);
    // The others are measured again, as the scene's files have changed, but not trained.
    assert_eq!(log.matches("adapter: ").count(), 2, "{log}");
    assert!(report.contains("points3D_bad"), "{report}");
}

/// A scene as it is made of photographs, exact depths in the network's place: the built-in one's, each point
/// of which knows its view.
fn scene_of_depths(dir: &Path) {
    let options = BuiltinOptions {
        width: 32,
        n_test: 2,
        ..BuiltinOptions::default()
    };
    let scene = builtin::scene(&options);
    let views = scene.train.iter().chain(&scene.test);
    let map = |view: &View| DepthMap {
        depth: builtin::trace(&view.camera)
            .depth
            .iter()
            .map(|d| *d as f32)
            .collect(),
        confidence: vec![1.0; view.image.rgb.len() / 3],
        colors: view.image.rgb.as_chunks().0.to_vec(),
        camera: view.camera.clone(),
    };
    let maps: Vec<DepthMap> = views.clone().map(map).collect();
    let made = cloud(&maps, CloudOptions { share: 1.0 });
    let cameras: Vec<Camera> = maps.into_iter().map(|map| map.camera).collect();
    write_model(dir, &cameras, &made.points, &made.views).expect("writes");
    fs::create_dir(dir.join("images")).expect("a folder");
    for View { camera, image, .. } in views {
        let (path, Image { width, height, rgb }) = (dir.join("images").join(&camera.name), image);
        image::save_buffer(path, rgb, *width, *height, image::ColorType::Rgb8).expect("writes");
    }
}

#[test]
fn a_scene_of_photographs_has_clouds_of_fewer_views_once_it_has_test_views() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("mine");
    scene_of_depths(&dir);
    let args = "cloud --scene mine --iterations 3 --max-points 40 --set views.count=3 --seeds 0";
    // All photographs are trained on, as `scene` leaves it.
    fails(
        folder.path(),
        args,
        2,
        &["`mine` has no test views", "split.json"],
    );
    assert!(!folder.path().join("studies").exists());
    let split = json(&dir.join("split.json"));
    let names = split["train"].as_array().expect("names");
    let split = serde_json::json!({ "train": names[..4], "test": names[4..] });
    fs::write(dir.join("split.json"), split.to_string()).unwrap();
    let (report, log) = succeeds(folder.path(), args);
    assert!(log.contains("come from the depth of test views"), "{log}");
    assert!(!log.contains("the cloud is sparse"), "{log}");
    let data = json(&folder.path().join("studies/cloud.json"));
    let rows = data["tables"][0]["rows"].as_array().expect("rows");
    let clouds: Vec<&str> = rows
        .iter()
        .filter_map(|row| row["cloud"].as_str())
        .collect();
    let own = "the scene's own";
    assert_eq!(
        clouds,
        [own, own, "1 view", "1 view", "2 views", "2 views"],
        "{report}"
    );
    for row in rows {
        assert!(row["psnr"]["mean"].is_number(), "{row}");
    }
}

#[test]
fn figures_are_means_over_scenes_and_seeds() {
    let folder = tempfile::tempdir().unwrap();
    let args = format!("sampling {TINY} --seeds 3,5").replace("builtin:32", "builtin:24 copy");
    // The same views, but as files.
    let names: Vec<String> = (0..6).map(|i| format!("{i}.png")).collect();
    let scene = Folder::with_views(&names.iter().map(String::as_str).collect::<Vec<_>>());
    std::os::unix::fs::symlink(scene.path(), folder.path().join("copy")).unwrap();
    let (report, _) = succeeds(folder.path(), &args);
    assert!(report.contains("seeds 3, 5"), "{report}");
    let data = json(&folder.path().join("studies/sampling.json"));
    let rows = data["tables"][0]["rows"].as_array().expect("rows").clone();
    assert_eq!(rows.len(), 18);
    let scene_name = rows[6]["scene"].as_str().expect("a name").to_owned();
    let psnr = |scene: &str, seed: u64| -> f64 {
        let run = format!("studies/runs/{scene}-paper-sphere-uniform-seed{seed}/eval.json");
        json(&folder.path().join(run))["mean"]["psnr"]
            .as_f64()
            .expect("a PSNR")
    };
    let row = |scene: &str| {
        let mut of = rows.iter().filter(|row| row["scene"] == scene);
        of.find(|row| row["strategy"] == "uniform sphere")
            .expect("a row")
            .clone()
    };
    let check = |row: Value, [a, b]: [f64; 2]| {
        let figure = |key: &str| row["psnr"][key].as_f64().expect("a number");
        assert!((figure("mean") - 0.5 * (a + b)).abs() < 1e-12, "{row}");
        let spread = (a - b).abs() / 2f64.sqrt();
        assert!((figure("deviation") - spread).abs() < 1e-12, "{row}");
    };
    let own = |scene: &str| [psnr(scene, 3), psnr(scene, 5)];
    check(row("builtin"), own("builtin"));
    check(row(&scene_name), own(&scene_name));
    let both = [3, 5].map(|seed| 0.5 * (psnr("builtin", seed) + psnr(&scene_name, seed)));
    check(row("mean of 2"), both);
}

#[test]
fn lpips_that_is_asked_for_later_is_measured_without_training() {
    let folder = tempfile::tempdir().unwrap();
    let args = format!("sampling {TINY} --seeds 0").replace("builtin:32", "builtin:48");
    let (report, _) = succeeds(folder.path(), &args);
    assert_eq!(report.matches("n/a").count(), 6, "{report}");
    let weights = generated(ALEX).bytes();
    fs::write(folder.path().join("alex.safetensors"), weights).unwrap();
    let args = args + " --lpips-weights alex.safetensors";
    let (report, log) = succeeds(folder.path(), &args);
    assert!(!log.contains("adapter: "), "trains again: {log}");
    assert!(report.contains("LPIPS is lpips(alex,[0,1])"), "{report}");
    let data = json(&folder.path().join("studies/sampling.json"));
    for row in data["tables"][0]["rows"].as_array().expect("rows") {
        assert!(row["lpips"]["mean"].as_f64() > Some(0.0), "{row}");
    }
}

#[test]
fn slips_on_the_command_line_are_told_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    for (args, code, part) in [
        ("", 2, ""),
        ("flight", 2, "ablation"),
        ("ablation --seeds 1,1", 2, "names 1 twice"),
        ("ablation --seeds", 2, "--seeds"),
        ("ablation --scene builtin builtin:64", 2, "`builtin`"),
        (
            "ablation --set views.cuont=3",
            2,
            "did you mean `views.count`?",
        ),
        ("ablation --iterations 0", 2, "`iterations` is 0"),
        ("need --set field.n_candidates=512", 2, "1024"),
        ("ablation --scene no/scene", 1, "no/scene"),
    ] {
        let output = study(folder.path(), args);
        let log = output.log;
        assert_eq!(output.code, Some(code), "{args}: {log}");
        assert!(log.contains(part), "{args}: {log}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{args}");
    }
    let output = study(folder.path(), "--help");
    let help = output.stdout;
    for name in [
        "ablation",
        "cloud",
        "sampling",
        "views",
        "pilot",
        "kernel",
        "parameters",
        "potential",
        "need",
        "ceiling",
    ] {
        assert!(help.contains(name), "no `{name}` in {help}");
    }
}
