//! What a run does not go on from.

use std::fs;
use std::path::Path;

use gspotential::config::{Config, Exp2Choice, RasterizerChoice};
use gspotential::error::ErrorKind;
use gspotential::eval::EvalOptions;
use gspotential::gpu::Gpu;
use gspotential::pipeline::{self, GoOn, TrainJob};
use gspotential::run::{RunDir, Stop};
use gspotential::scene::SceneSource;

use super::Outcome;
use crate::gpu::rig::context;
use crate::scene::build::{Folder, GOOD_PLY, png};

fn job(scene: &Folder) -> TrainJob {
    let mut config = Config::preset("3dgs").expect("a preset");
    config.iterations = 20;
    // As a run on this adapter has it.
    config.render.rasterizer = RasterizerChoice::Thread;
    config.render.exp2 = Exp2Choice::Polynomial;
    config.densify.enabled = false;
    let source = SceneSource::Folder(scene.path().to_owned());
    TrainJob::new(source, config).expect("a job")
}

fn scene() -> Folder {
    Folder::with_views(&["a.png", "b.png", "c.png", "d.png", "e.png"])
}

fn options() -> EvalOptions {
    EvalOptions::default()
}

/// A run that is stopped after its first iteration.
fn stopped(scene: &Folder, root: &Path) {
    let job = job(scene);
    let run = RunDir::create(root, &job.config, false).expect("a fresh folder");
    let stop = Stop::unheard();
    stop.ask();
    let gpu = Gpu::open().expect("an adapter");
    let loaded = job.load().expect("a scene");
    let error = pipeline::train(
        &gpu,
        &loaded,
        &job,
        Default::default(),
        &options(),
        &run,
        &stop,
    )
    .unwrap_err();
    assert_eq!(
        (error.kind(), error.exit_code()),
        (ErrorKind::Interrupted, 130)
    );
    assert!(
        error.to_string().starts_with("after iteration 1 of 20; "),
        "{error}"
    );
}

#[track_caller]
fn assert_refused(root: &Path, parts: &[&str]) {
    let before = fs::read(root.join("checkpoints/0000000001.ckpt")).expect("a checkpoint");
    let error = TrainJob::resume(root, GoOn::default(), &options())
        .err()
        .expect("a refusal");
    assert_eq!(error.exit_code(), 1);
    for part in parts {
        assert!(error.to_string().contains(part), "no `{part}` in: {error}");
    }
    let after = fs::read(root.join("checkpoints/0000000001.ckpt")).expect("a checkpoint");
    assert!(before == after && !root.join("metrics.json").exists());
}

#[test]
fn a_checkpoint_of_another_config_or_scene_is_refused_by_name_until_it_is_restored() {
    let _alone = context();
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene();
    let root = folder.path().join("run");
    stopped(&scene, &root);

    let config = fs::read_to_string(root.join("config.json")).expect("a config");
    let change = |from: &str, to: &str| {
        assert!(config.contains(from));
        fs::write(root.join("config.json"), config.replace(from, to)).expect("written");
    };
    change("\"iterations\": 20", "\"iterations\": 30");
    assert_refused(
        &root,
        &[
            "0000000001.ckpt",
            "config.json",
            "`iterations` is 30, was 20",
        ],
    );
    change("\"opacity_lr\": 0.05", "\"opacity_lr\": 0.06");
    assert_refused(&root, &["`optimizer.opacity_lr` is 0.06, was 0.05"]);
    fs::write(root.join("config.json"), &config).expect("written");

    let mut altered = image::load_from_memory(&png(12, 8))
        .expect("an image")
        .to_rgb8();
    altered.put_pixel(3, 3, image::Rgb([9, 9, 9]));
    let altered = |name: &str| altered.save(scene.path().join(name)).expect("written");
    altered("images/b.png");
    assert_refused(&root, &["the scene is not what it was: image of `b.png`;"]);
    scene.write("images/b.png", png(12, 8));
    let test_view = scene.scene().test[0].camera.name.clone();
    let test_image = format!("images/{test_view}");
    altered(&test_image);
    assert_refused(&root, &[&format!("test image of `{test_view}`")]);
    scene.remove(&test_image);
    assert_refused(&root, &["the scene is no longer as it was", &test_view]);
    scene.write(&test_image, png(12, 8));
    scene.write("sparse/0/points3D.ply", GOOD_PLY.replace("4 5 6", "4 5 7"));
    assert_refused(&root, &["the scene is not what it was: point cloud;"]);
    scene.write("sparse/0/points3D.ply", GOOD_PLY);

    let resumed = TrainJob::resume(&root, GoOn::default(), &options()).expect("as it was");
    assert!(resumed.evaluation.is_some());
    drop(resumed);
    let again = TrainJob::resume(&root, GoOn::default(), &options()).expect("finished");
    assert!(again.evaluation.is_none());
    let other = folder.path().join("other");
    job(&scene).run(&other, false, &options()).expect("trains");
    assert!(Outcome::of(&root) == Outcome::of(&other));
}
