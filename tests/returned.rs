//! Images that come back from outside as the targets of virtual views.

use std::fs;
use std::path::Path;

use gspotential::camera::json::read_cameras;
use gspotential::config::Config;
use gspotential::eval::EvalOptions;
use gspotential::gpu::Gpu;
use gspotential::pipeline::{self, GoOn, Prepared, TrainJob, prepare};
use gspotential::run::{RunDir, Seconds, Stop, VirtualImages};
use gspotential::scene::SceneSource;
use gspotential::train::TrainingView;
use image::RgbImage;

use crate::kit::program::{run, succeed};

const SETTINGS: [&str; 6] = [
    "iterations=20",
    "scene.max_points=200",
    "scene.n_test=2",
    "field.n_candidates=128",
    "views.count=6",
    "need.hold_out=3",
];

fn train(more: &str) -> String {
    let settings = SETTINGS.map(|s| format!("--set {s}")).join(" ");
    format!("train --scene builtin:32 --preset paper {settings} {more}")
}

fn job(images: Option<VirtualImages>) -> TrainJob {
    let paper = Config::preset("paper").expect("a preset");
    let set = |config: Config, setting: &&str| config.set(setting);
    let config = SETTINGS.iter().try_fold(paper, set).expect("settings");
    let job = TrainJob::new(SceneSource::Builtin { width: 32 }, config).expect("a job");
    TrainJob {
        virtual_images: images,
        ..job
    }
}

fn images(folder: &Path, weight: f64) -> Option<VirtualImages> {
    Some(VirtualImages {
        folder: folder.display().to_string(),
        weight,
    })
}

fn prepared(images: Option<VirtualImages>) -> Prepared {
    let job = job(images);
    let scene = job.load().expect("a scene");
    let mut prepared = prepare(&scene, &job.config, &mut Seconds::default()).expect("a sphere");
    if let Some(images) = &job.virtual_images {
        prepared.take_images(&scene, images).expect("images");
    }
    prepared
}

/// What a network might do.
fn repaired(from: &Path, to: &Path) -> RgbImage {
    let image = image::open(from).expect("an image").to_rgb8();
    let blurred = image::imageops::blur(&image, 1.0);
    blurred.save(to).expect("written");
    blurred
}

fn texels(image: &RgbImage) -> Vec<u32> {
    let pixels = image.pixels();
    pixels
        .map(|p| u32::from_le_bytes([p[0], p[1], p[2], 255]))
        .collect()
}

fn find<'a>(views: &'a [TrainingView], name: &str) -> Option<&'a TrainingView> {
    views.iter().find(|view| view.camera.name == name)
}

#[test]
fn views_are_rendered_repaired_and_trained_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |path: &str| folder.path().join(path);
    succeed(folder.path(), &train("--out first"));
    succeed(folder.path(), "render first --views virtual --out views");
    let listed = read_cameras(&at("views/views.json")).expect("cameras");
    assert_eq!(listed.len(), 6);
    let text = fs::read_to_string(at("views/views.json")).expect("text");
    let entries: Vec<serde_json::Value> = serde_json::from_str(&text).expect("JSON");
    for (entry, camera) in entries.iter().zip(&listed) {
        assert!(at("views").join(&camera.name).is_file(), "{}", camera.name);
        let reference = entry["reference"].as_str().expect("a reference");
        assert!(reference.starts_with("train_"), "{reference}");
    }
    fs::create_dir(at("repaired")).expect("a folder");
    fs::copy(at("views/views.json"), at("repaired/views.json")).expect("copied");
    // All but the second.
    let before = prepared(None).supervision;
    let mut shown = Vec::new();
    for camera in listed
        .iter()
        .enumerate()
        .filter(|(i, _)| *i != 1)
        .map(|(_, c)| c)
    {
        let [from, to] = ["views", "repaired"].map(|dir| at(dir).join(&camera.name));
        shown.push((
            camera.name.trim_end_matches(".png").to_owned(),
            repaired(&from, &to),
        ));
    }
    let after = prepared(images(&at("repaired"), 0.5)).supervision;
    assert_eq!(after.held_out.len(), 2);
    assert_eq!(after.virtual_views.len(), 4);
    for (name, image) in &shown {
        let own = |s: &gspotential::train::Supervision| {
            find(&s.virtual_views, name)
                .or(find(&s.held_out, name))
                .expect("a view")
                .clone()
        };
        let (before, after) = (own(&before), own(&after));
        assert_eq!(after.goal.texels(), texels(image), "{name}");
        assert_eq!(after.weight, 0.5 * before.weight);
        assert_eq!(after.camera, before.camera);
        assert!(!after.masked && after.total_weight == f64::from(image.width() * image.height()));
        assert_ne!(after.goal, before.goal);
    }
    let second = listed[1].name.trim_end_matches(".png");
    let own = |views: &[TrainingView]| find(views, second).map(|view| view.goal.clone());
    assert_eq!(own(&after.virtual_views), own(&before.virtual_views));
    assert_eq!(own(&after.held_out), own(&before.held_out));

    let images = "--virtual-images repaired --virtual-images-weight 0.5";
    succeed(folder.path(), &train(&format!("--out second {images}")));
    let model = |run: &str| fs::read(at(run).join("point_cloud.ply")).expect("a model");
    assert!(model("second") != model("first"));
    let metrics = fs::read_to_string(at("second/metrics.json")).expect("metrics");
    let metrics: serde_json::Value = serde_json::from_str(&metrics).expect("JSON");
    assert_eq!(metrics["scene"]["virtual_images"]["weight"], 0.5);
    // Measured again without the folder, which evaluation does not need.
    fs::rename(at("repaired"), at("elsewhere")).expect("renamed");
    succeed(folder.path(), "eval second");
}

#[test]
fn a_path_between_photographs_becomes_views_of_its_own() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |path: &str| folder.path().join(path);
    succeed(folder.path(), &train("--out first"));
    succeed(folder.path(), "render first --path 3 --out path");
    let listed = read_cameras(&at("path/views.json")).expect("cameras");
    assert_eq!(listed[1].name, "path_001.png");
    let prepared = prepared(images(&at("path"), 0.25));
    assert_eq!(prepared.supervision.virtual_views.len(), 4 + 3);
    let view = find(&prepared.supervision.virtual_views, "virtual_path_001").expect("a view");
    assert_eq!(view.weight, 0.25);
    let back = prepared.frame.camera_to_world(&view.camera);
    let motion = back.difference(&listed[1]);
    // An angle of nothing is the arccosine of 1, of half the digits.
    assert!(motion.turn < 1e-7 && motion.shift < 1e-9, "{motion:?}");
    let image = image::open(at("path/path_001.png"))
        .expect("an image")
        .to_rgb8();
    assert_eq!(view.goal.texels(), texels(&image));
    // Without drawn views, too, and once more from the views of that run.
    let bare = "--set views.count=0 --set need.hold_out=0 --virtual-images path";
    succeed(folder.path(), &train(&format!("--out bare {bare}")));
    let cameras = read_cameras(&at("bare/cameras.json")).expect("cameras");
    assert_eq!(
        cameras
            .iter()
            .filter(|c| c.name.starts_with("virtual_path_"))
            .count(),
        3
    );
    succeed(folder.path(), "render bare --views virtual --out again");
    let again = "--set views.count=0 --set need.hold_out=0 --virtual-images again";
    succeed(folder.path(), &train(&format!("--out more {again}")));
}

#[test]
fn images_of_no_view_of_another_size_or_place_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |path: &str| folder.path().join(path);
    succeed(folder.path(), &train("--out first"));
    succeed(folder.path(), "render first --views virtual --out views");
    let refused = |more: &str, code: i32, parts: &[&str]| {
        let ended = run(folder.path(), &train(more));
        assert_eq!(ended.code, Some(code), "{}", ended.log);
        for part in parts {
            assert!(ended.log.contains(part), "no `{part}` in: {}", ended.log);
        }
        assert!(!at("second").join("metrics.json").exists());
        let _ = fs::remove_dir_all(at("second"));
    };
    let images = "--out second --virtual-images views";
    // Other places: another seed draws them.
    refused(
        &format!("{images} --seed 5"),
        1,
        &["virtual_", "another camera"],
    );
    fs::copy(at("views/virtual_000.png"), at("views/mine.png")).expect("copied");
    refused(
        images,
        1,
        &[
            "1 images are of no virtual view: `mine.png`",
            "6 virtual ones",
        ],
    );
    fs::remove_file(at("views/mine.png")).expect("removed");
    let image = image::open(at("views/virtual_002.png")).expect("an image");
    let small = image.resize_exact(16, 11, image::imageops::FilterType::Nearest);
    small.save(at("views/virtual_002.png")).expect("written");
    let parts = [
        "virtual_002.png",
        "the image is 16x11 pixels but its view is 32x22",
    ];
    refused(images, 1, &parts);
    fs::write(at("views/virtual_002.png"), b"not an image").expect("written");
    refused(images, 1, &["virtual_002.png", "neither a PNG nor a JPEG"]);
    succeed(folder.path(), "render first --views test --out tests");
    refused(
        "--out second --virtual-images tests",
        1,
        &["is the name of a photograph"],
    );
    refused(
        "--out second --virtual-images nowhere",
        1,
        &["nowhere", "cannot open the images"],
    );
    refused(
        "--out second --virtual-images first/cameras.json",
        2,
        &["is not a folder"],
    );
    let weight = format!("{images} --virtual-images-weight=-1");
    refused(&weight, 2, &["--virtual-images-weight is -1"]);
    refused(
        "--out second --virtual-images-weight 1",
        2,
        &["--virtual-images <DIR>"],
    );
}

#[test]
fn a_run_goes_on_with_the_images_that_it_was_begun_with_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |path: &str| folder.path().join(path);
    succeed(folder.path(), &train("--out first"));
    succeed(folder.path(), "render first --views virtual --out views");
    let job = job(images(&at("views"), 1.0));
    let options = EvalOptions::default();
    let trained = |root: &Path, asks: bool| {
        let gpu = Gpu::open().expect("an adapter");
        let mut job = job.clone();
        let rasterizer = gspotential::gpu::Rasterizer::of(job.config.render.rasterizer, &gpu);
        job.config.render.rasterizer = rasterizer.choice();
        let run = RunDir::create(root, &job.config, false).expect("a fresh folder");
        let stop = Stop::unheard();
        if asks {
            stop.ask();
        }
        let scene = job.load().expect("a scene");
        pipeline::train(
            &gpu,
            &scene,
            &job,
            Default::default(),
            &options,
            &run,
            &stop,
        )
        .is_ok()
    };
    assert!(trained(&at("whole"), false));
    assert!(!trained(&at("stopped"), true));
    let stopped = at("stopped");
    let resumed = || TrainJob::resume(&stopped, GoOn::default(), &options);
    let image = at("views/virtual_003.png");
    let kept = fs::read(&image).expect("a file");
    repaired(&image, &image);
    let error = resumed().err().expect("a refusal").to_string();
    assert!(error.contains("image of `virtual_003`"), "{error}");
    fs::remove_file(&image).expect("removed");
    let error = resumed().err().expect("a refusal").to_string();
    assert!(error.contains("image of `virtual_003`"), "{error}");
    fs::write(&image, kept).expect("written");
    resumed().expect("goes on");
    let model = |run: &str| fs::read(at(run).join("point_cloud.ply")).expect("a model");
    assert!(model("stopped") == model("whole"));
}
