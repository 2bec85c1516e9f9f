//! Tiny studies through the command.

use std::fs;
use std::path::Path;

use gspotential::camera::Camera;
use gspotential::dense::{CloudOptions, DepthMap, cloud};
use gspotential::field::Focus;
use gspotential::scene::builtin::{self, BuiltinOptions};
use gspotential::scene::{Image, View, write_model};
use serde_json::Value;

use super::kit::{TINY, fails, json, study, succeeds};
use crate::metrics::lpips_reference::{ALEX, generated};
use crate::scene::build::{Folder, GOOD_PLY};

/// A report without the last column of its tables, which holds the seconds.
fn without_seconds(report: &str) -> Vec<&str> {
    let lines = report.lines();
    let cut = lines.map(|line| match line.strip_suffix('|') {
        Some(row) => row.rsplit_once('|').map_or(row, |(rest, _)| rest),
        None => line,
    });
    cut.collect()
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
    let args = format!("sampling {TINY} --seeds 0 --set coverage.start=900");
    let args = args.replace("builtin:32", "builtin:48");
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
    // A stage that was stated begins when it says, even if the run ends before.
    let config = json(
        &folder
            .path()
            .join("studies/runs/builtin-paper-seed0/config.json"),
    );
    assert_eq!(config["coverage"]["start"], 900);
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
