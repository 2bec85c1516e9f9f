//! The three commands in a row, on a tiny scene: what the README promises of a run.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use gspotential::doctor::stage;
use gspotential::gpu::Rasterizer;
use gspotential::gpu::shader::{STAGES, compose};

use crate::kit::program::{command, ended, run, succeed};
use crate::metrics::lpips_reference::{ALEX, generated};

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
    let output = succeed(folder.path(), train);
    let table = output.stdout;
    assert!(table.contains("| **mean of 2** |"), "{table}");
    let log = output.log;
    assert!(log.contains("adapter: ") && log.contains("5/5 "), "{log}");

    let root = "runs/builtin-gspotential-seed3";
    assert_eq!(
        file_names(&at(root)),
        [
            ".lock",
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
    // Those of the far shell are in the file, too.
    assert_eq!(trained["n_gaussians"], 200 + 500);

    // What is measured again is what was measured: both start from the file.
    let image = fs::read(at(root).join("test/test_00.png")).unwrap();
    fs::remove_file(at(root).join("eval.json")).unwrap();
    let output = succeed(folder.path(), &["eval", root]);
    assert_eq!(output.stdout.trim(), table.trim());
    assert_eq!(json(&at(root).join("eval.json")), trained);

    let model = format!("{root}/point_cloud.ply");
    let cameras = format!("{root}/cameras.json");
    let render = |out: &str, rest: &[&str]| {
        let args = ["render", "--model", &model, "--out", out];
        succeed(folder.path(), &[&args[..], rest].concat()[..]);
        let mut names = file_names(&at(out));
        let n_files = names.len();
        names.retain(|name| name != "views.json");
        assert_eq!(names.len(), n_files - 1, "no list of the views");
        names
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
    // A Gaussian that is not a number is left out and counted.
    let mut bytes = fs::read(at(&model)).unwrap();
    let start = bytes
        .windows(11)
        .position(|w| w == b"end_header\n")
        .unwrap()
        + 11;
    bytes[start..start + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(at("nan.ply"), bytes).unwrap();
    let args = "render --model nan.ply --scene builtin:32 --views test_00.png --out e";
    let output = succeed(folder.path(), args);
    let log = output.log;
    assert!(log.contains("1 of 700 Gaussians are not finite"), "{log}");
    // A run's cameras are rendered from with the run's near plane.
    assert_eq!(fs::read(at("d").join("test_00.png")).unwrap(), image);
}

#[test]
fn a_run_with_every_switch_of_its_views_and_cloud_is_evaluated_again_alike() {
    let folder = tempfile::tempdir().unwrap();
    let train = "train --scene builtin:48 --iterations 2 --set views.count=6 \
                 --set scene.n_test=2 --set views.strategy=nearest_angle \
                 --set views.visibility.enabled=true --set field.kernel=von_mises_fisher \
                 --set carve.enabled=true --out run";
    let output = succeed(folder.path(), train);
    let log = output.log;
    assert!(log.contains("carved "), "{log}");
    let metrics = json(&folder.path().join("run/metrics.json"));
    assert!(metrics["seconds"]["carve"].is_number(), "{metrics}");
    let removed = metrics["scene"]["carved_points"]
        .as_array()
        .expect("a count for each round")
        .iter()
        .map(|n| n.as_u64().expect("a count"))
        .sum::<u64>();
    let n_points = metrics["scene"]["n_points"].as_u64().unwrap();
    assert!(
        removed > 0 && removed < n_points / 2,
        "{removed} of {n_points}"
    );
    assert!(
        log.contains(&format!("from {} points", n_points - removed)),
        "{log}"
    );

    // The bare splat beside it is that of the carved cloud, then and now.
    let eval = folder.path().join("run/eval.json");
    let trained = json(&eval);
    fs::remove_file(&eval).unwrap();
    succeed(folder.path(), &["eval", "run"]);
    assert_eq!(json(&eval)["point_splat"], trained["point_splat"]);
    assert_eq!(json(&eval)["views"], trained["views"]);
    // The covered pixels are those of the whole cloud, which has more of them.
    let coverage = |of: &str| trained[of]["coverage"].as_f64().unwrap();
    assert!(
        coverage("mean_covered") > coverage("point_splat"),
        "{trained}"
    );
    assert_ne!(trained["mean_covered"]["psnr"], trained["mean"]["psnr"]);
    assert_eq!(json(&eval)["mean"], trained["mean"]);
}

#[test]
fn a_run_on_another_cloud_and_split_is_evaluated_on_them_from_anywhere() {
    let folder = tempfile::tempdir().unwrap();
    let train = "train --scene builtin:24 --iterations 3 --preset 3dgs --set scene.n_test=3 \
                 --max-points 60 --cloud views:2 --train-views train_03.png,test_01.png \
                 --test-views test_02.png --eval-every 2 --out run";
    succeed(folder.path(), train);
    let at = |path: &str| json(&folder.path().join("run").join(path));
    let scene = at("metrics.json")["scene"].clone();
    assert_eq!(scene["cloud"], "views:2");
    assert_eq!(
        scene["train_views"],
        serde_json::json!(["train_03.png", "test_01.png"])
    );
    assert_eq!(scene["test_views"], serde_json::json!(["test_02.png"]));
    assert_eq!(
        at("metrics.json")["curve"].as_array().map(Vec::len),
        Some(3)
    );
    let trained = at("eval.json");
    assert!(trained["point_splat"]["psnr"].is_number(), "{trained}");
    // Nothing is carved, so that both clouds are the same.
    assert_eq!(
        trained["mean_covered"]["coverage"],
        trained["point_splat"]["coverage"]
    );
    fs::remove_file(folder.path().join("run/eval.json")).unwrap();
    let elsewhere = tempfile::tempdir().unwrap();
    let root = folder.path().join("run");
    succeed(elsewhere.path(), &["eval", root.to_str().unwrap()]);
    assert_eq!(at("eval.json"), trained);

    // A scene that has changed since is named, and it is no wrong usage.
    let metrics = fs::read_to_string(root.join("metrics.json")).unwrap();
    fs::write(
        root.join("metrics.json"),
        metrics.replace("test_02.png", "test_09.png"),
    )
    .unwrap();
    let output = run(folder.path(), "eval run --again");
    let line = output.log;
    assert_eq!(output.code, Some(1), "{line}");
    assert!(
        line.contains("`test_09.png`") && line.contains("no longer"),
        "{line}"
    );
}

#[test]
fn a_run_that_was_cut_short_is_no_run_to_evaluate() {
    let folder = tempfile::tempdir().unwrap();
    let args = "train --scene builtin:32 --iterations 1 --preset 3dgs --set scene.n_test=1 \
                --max-points 50 --out run";
    succeed(folder.path(), args);
    fs::remove_file(folder.path().join("run/metrics.json")).unwrap();
    let output = run(folder.path(), "eval run");
    assert_eq!(output.code, Some(1));
    let line = output.log;
    assert!(
        line.starts_with("error: ") && line.contains("metrics.json"),
        "{line}"
    );
}

#[test]
fn the_doctor_finds_every_stage_in_bounds_and_says_so_in_both_forms() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["doctor", "--rounds", "1", "--json", "doctor.json"];
    let output = succeed(folder.path(), &args);
    let table = output.stdout;
    let report = json(&folder.path().join("doctor.json"));
    assert_eq!(report["holds"], true, "{table}");
    let stages = report["stages"].as_array().expect("stages");
    assert_eq!(stages.len(), stage::ALL.len());
    for (stage, name) in stages.iter().zip(stage::ALL) {
        assert_eq!(stage["stage"], name);
        assert!(stage["seconds"].as_f64() > Some(0.0), "{stage}");
        assert!(stage["count"].as_u64() > Some(0), "{stage}");
        assert!(stage["worst"]["error"].as_f64() <= stage["worst"]["bound"].as_f64());
        let row = table
            .lines()
            .find(|line| line.starts_with(&format!("| {name} ")));
        assert!(
            row.is_some_and(|row| row.ends_with(" ok |")),
            "{name}: {table}"
        );
    }
    assert!(report["findings"].as_array().expect("findings").len() > 400);
    let rasterizers = report["rasterizers"].as_array().expect("rasterizers");
    assert_eq!(rasterizers.len(), Rasterizer::ALL.len());
    for rasterizer in rasterizers {
        let hashes = &rasterizer["repeat"]["hashes"];
        assert_eq!(hashes[0], hashes[1]);
        assert!(
            rasterizer["view_seconds"].as_f64() > Some(0.0),
            "{rasterizer}"
        );
    }
    assert!(table.contains("equal to the bit") && table.contains("storage buffers"));
}

/// No driver is asked, so none is found missing.
#[test]
fn the_doctor_writes_every_shader_as_the_driver_gets_it() {
    let folder = tempfile::tempdir().unwrap();
    let doctor = |args: &[&str]| {
        let args = [&["doctor", "--wgsl", "shaders"][..], args].concat();
        let mut command = command(folder.path(), &args[..]);
        command.env("VK_ICD_FILENAMES", "/nonexistent.json");
        command.env("VK_DRIVER_FILES", "/nonexistent.json");
        ended(&mut command)
    };
    let first = doctor(&[]);
    assert_eq!(first.code, Some(0), "{}", first.log);
    let files = || -> BTreeMap<String, String> {
        let entries = fs::read_dir(folder.path().join("shaders")).unwrap();
        let file = |entry: std::io::Result<fs::DirEntry>| {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            (name, fs::read_to_string(entry.path()).unwrap())
        };
        entries.map(file).collect()
    };
    let written = files();
    for (name, text) in &written {
        let (stage, degree) = match name.strip_suffix(".wgsl").unwrap().split_once("_degree_") {
            Some((stage, degree)) => (stage, degree.parse().unwrap()),
            None => (name.strip_suffix(".wgsl").unwrap(), 0),
        };
        assert!(*text == compose(stage, degree), "{name}");
    }
    for (stage, _) in STAGES {
        // One for every degree exactly where the degree makes a difference beyond its own constant.
        let own = |degree| {
            compose(stage, degree)
                .split_once('\n')
                .unwrap()
                .1
                .to_owned()
        };
        let constant = "const SH_DEGREE = 0u;";
        assert!(compose(stage, 0).starts_with(constant));
        let asks = own(0).contains("SH_DEGREE");
        for degree in 0..4 {
            let name = format!("{stage}_degree_{degree}.wgsl");
            assert_eq!(written.contains_key(&name), asks, "{name}");
        }
        assert_ne!(
            written.contains_key(&format!("{stage}.wgsl")),
            asks,
            "{stage}"
        );
    }
    // What is there stays until it is said otherwise.
    let altered = folder.path().join("shaders/bin.wgsl");
    fs::write(&altered, "mine").unwrap();
    let again = doctor(&[]);
    assert_eq!(again.code, Some(1), "{}", again.log);
    assert!(again.log.contains("--overwrite"), "{}", again.log);
    assert_eq!(fs::read_to_string(&altered).unwrap(), "mine");
    assert_eq!(doctor(&["--overwrite"]).code, Some(0));
    assert!(files() == written);
}

/// Trains a tiny scene into `out`.
fn train(folder: &Path, out: &str, rest: &str) {
    let args = format!(
        "train --scene builtin:48 --iterations 2 --set views.count=6 --set scene.n_test=2 \
         --max-points 60 --out {out} {rest}"
    );
    succeed(folder, &args);
}

fn eval(folder: &Path, args: &str) -> (String, String) {
    let args = format!("eval {args}");
    let output = succeed(folder, &args);
    (output.stdout, output.log)
}

#[test]
fn lpips_is_measured_where_there_are_weights_and_is_never_zero_without() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let weights = generated(ALEX).bytes();
    fs::write(folder.join("alex.safetensors"), weights).unwrap();
    train(folder, "run", "--lpips-weights alex.safetensors");
    let evaluation = json(&folder.join("run/eval.json"));
    assert_eq!(evaluation["measured"]["lpips"]["net"], "alex");
    assert_eq!(evaluation["measured"]["lpips"]["range"], "0,1");
    let unit = evaluation["mean"]["lpips"].as_f64().expect("a distance");
    assert!(unit > 0.01, "{unit}");

    // What was measured is shown, also where it is not asked for.
    let (table, log) = eval(folder, "run");
    assert!(
        table.contains("lpips(alex,[0,1])") && !table.contains("n/a"),
        "{table}"
    );
    assert!(!log.contains("measuring"), "{log}");
    // What was not is measured, and nothing else is lost.
    let signed = "run --lpips-weights alex.safetensors --lpips-range -1,1";
    let (table, log) = eval(folder, signed);
    assert!(
        table.contains("lpips(alex,[-1,1])") && log.contains("measuring run"),
        "{table}"
    );
    let measured = json(&folder.join("run/eval.json"));
    assert_ne!(measured["mean"]["lpips"].as_f64(), Some(unit));
    assert_eq!(measured["mean"]["psnr"], evaluation["mean"]["psnr"]);
    assert!(!eval(folder, signed).1.contains("measuring"));

    let (table, log) = eval(folder, "run --float-renders");
    assert!(
        log.contains("measuring run") && table.contains("not rounded"),
        "{table}"
    );
    assert!(
        table.contains(" n/a |") && table.contains("lpips.LPIPS(net='vgg')"),
        "{table}"
    );
    let floats = json(&folder.join("run/eval.json"));
    assert!(floats["mean"]["lpips"].is_null());
    assert_ne!(floats["mean"]["psnr"], evaluation["mean"]["psnr"]);
}

#[test]
fn runs_are_compared_in_one_table_and_measured_again_only_where_something_changed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    train(folder, "a", "");
    train(folder, "b", "--preset 3dgs --seed 1");
    let (table, log) = eval(folder, "a b --json runs.json --csv runs.csv");
    assert!(!log.contains("measuring"), "{log}");
    for part in [
        "builtin (48x32, 2 test views)",
        "| gspotential (views.count=6) |",
        "2 iterations",
    ] {
        assert!(table.contains(part), "no `{part}` in:\n{table}");
    }
    let runs = json(&folder.join("runs.json"));
    assert_eq!(runs["runs"][1]["preset"], "3dgs");
    assert_eq!(
        fs::read_to_string(folder.join("runs.csv"))
            .unwrap()
            .lines()
            .count(),
        3
    );
    // A second look is the same, and files are kept unless they may be replaced.
    assert_eq!(eval(folder, "a b --json runs.json --overwrite").0, table);

    assert!(eval(folder, "a --again").1.contains("measuring a"));
    type Edit = (&'static str, fn(&Path));
    let edits: [Edit; 4] = [
        ("point_cloud.ply", |path| {
            let mut bytes = fs::read(path).unwrap();
            *bytes.last_mut().unwrap() ^= 1;
            fs::write(path, bytes).unwrap();
        }),
        ("config.json", |path| {
            let text = fs::read_to_string(path).unwrap();
            fs::write(path, text.replace("\"near\": 0.01", "\"near\": 0.02") + " ").unwrap();
        }),
        ("eval.json", |path| fs::write(path, "{}").unwrap()),
        ("eval.json", |path| fs::remove_file(path).unwrap()),
    ];
    for (file, edit) in edits {
        edit(&folder.join("a").join(file));
        let (_, log) = eval(folder, "a b");
        assert!(
            log.contains("measuring a") && !log.contains("measuring b"),
            "{file}: {log}"
        );
        assert!(!eval(folder, "a b").1.contains("measuring"), "{file}");
    }
}

#[test]
fn masks_that_are_drawn_after_training_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_posed_scene(&folder.join("scene"));
    let args = "train --scene scene --preset 3dgs --iterations 2 --out run \
                --train-views view_0.png,view_1.png";
    succeed(folder, args);
    assert!(!eval(folder, "run").0.contains("masked"));
    let mask = image::GrayImage::from_fn(40, 32, |x, _| image::Luma([255 * u8::from(x < 20)]));
    fs::create_dir(folder.join("scene/masks")).unwrap();
    mask.save(folder.join("scene/masks/view_2.png.png"))
        .unwrap();
    let (table, log) = eval(folder, "run");
    assert!(log.contains("measuring run"), "{log}");
    assert!(
        table.contains("masked PSNR dB") && table.contains("1 of 2 views"),
        "{table}"
    );
    let evaluation = json(&folder.join("run/eval.json"));
    assert_eq!(evaluation["views"][0]["masked"]["coverage"], 0.5);
    assert!(evaluation["views"][1]["masked"].is_null());
    // A scene that is gone cannot be measured again, but what was is still there.
    fs::rename(folder.join("scene"), folder.join("elsewhere")).unwrap();
    assert_eq!(eval(folder, "run").0, table);
}

/// Four photographs of the built-in scene with their poses and cloud.
fn write_posed_scene(dir: &Path) {
    let scene = gspotential::scene::builtin::scene(&gspotential::scene::builtin::BuiltinOptions {
        width: 48,
        n_test: 0,
        pixel_step: 4,
        ..Default::default()
    });
    fs::create_dir_all(dir.join("images")).unwrap();
    fs::create_dir_all(dir.join("sparse/0")).unwrap();
    let mut cameras = String::new();
    let mut images = String::new();
    for (i, view) in scene.train.iter().enumerate() {
        let camera = view.camera.resized(40, 32);
        cameras += &format!(
            "{} PINHOLE 40 32 {} {} {} {}\n",
            i + 1,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy
        );
        let q = glam::DQuat::from_mat3(&camera.rotation);
        let t = camera.translation;
        images += &format!(
            "{} {} {} {} {} {} {} {} {} view_{i}.png\n\n",
            i + 1,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z,
            i + 1
        );
        let picture: image::RgbImage =
            image::ImageBuffer::from_raw(48, 32, view.image.rgb.clone()).unwrap();
        let picture =
            image::imageops::resize(&picture, 40, 32, image::imageops::FilterType::Triangle);
        picture
            .save(dir.join(format!("images/view_{i}.png")))
            .unwrap();
    }
    fs::write(dir.join("sparse/0/cameras.txt"), cameras).unwrap();
    fs::write(dir.join("sparse/0/images.txt"), images).unwrap();
    let points = scene.cloud.positions.iter().zip(&scene.cloud.colors);
    let points: String = points
        .map(|(p, c)| format!("{} {} {} {} {} {}\n", p.x, p.y, p.z, c[0], c[1], c[2]))
        .collect();
    let header = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         end_header\n",
        scene.cloud.len()
    );
    fs::write(dir.join("sparse/0/points3D.ply"), header + &points).unwrap();
}
