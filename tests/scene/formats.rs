//! The formats of other programs: detection, axes, splits, confidences, and training from each.

use glam::DVec3;
use gspotential::scene::PoseProtocol;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{LoadOptions, Scene};
use serde_json::Value;

use super::build::{GOOD_PLY, options, warns};
use super::fixtures::{
    OPENGL, blender, gaussianobject, instant_ngp, instantsplat, mast3r, matrix, names, nerfstudio,
    pinhole, ply, project, still_life, vggt, views, write_colmap,
};
use crate::kit::program::succeed;

/// The greatest distance, in pixels, between where cloud points fall in the loaded views and
/// where they fall in the views that were written; names may have gained a folder.
fn greatest_shift(loaded: &Scene, written: &Scene) -> f64 {
    let mut greatest: f64 = 0.0;
    for view in views(written) {
        let name = &view.camera.name;
        let same = views(loaded)
            .find(|v| v.camera.name.ends_with(name.as_str()))
            .unwrap_or_else(|| panic!("no {name}"));
        assert_eq!(same.image, view.image, "{name}");
        for p in written.cloud.positions.iter().step_by(7) {
            let (a, b) = (project(&view.camera, *p), project(&same.camera, *p));
            greatest = greatest.max((a - b).length());
        }
    }
    greatest
}

#[test]
fn every_format_gives_the_scene_that_was_written() {
    let written = still_life();
    for (folder, source) in [
        (vggt(&written), "sparse (text), cloud sparse/points.ply"),
        (
            instantsplat(&written),
            "InstantSplat's sparse_4 (text), cloud sparse_4/0/points3D.ply, \
             confidence sparse_4/0/confidence_dsp.npy",
        ),
        (
            gaussianobject(&written),
            "GaussianObject's dust3r_4.json, cloud dust3r_4.ply",
        ),
        (
            nerfstudio(&written, OPENGL),
            "transforms.json, cloud sparse_pc.ply",
        ),
        (
            blender(&written),
            "transforms_train.json, cloud points3D.ply",
        ),
    ] {
        let loaded = folder.scene();
        assert_eq!(loaded.source, source);
        let shift = greatest_shift(&loaded, &written);
        assert!(shift < 1e-6, "{source}: {shift} px");
        assert_eq!(loaded.cloud.len(), written.cloud.len(), "{source}");
        assert_eq!(loaded.cloud.colors, written.cloud.colors, "{source}");
    }
}

#[test]
fn a_flipped_axis_is_no_scene_that_was_written() {
    let written = still_life();
    for axes in [[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
        let loaded = nerfstudio(&written, axes).scene();
        let shift = greatest_shift(&loaded, &written);
        assert!(shift > 5.0, "{axes:?}: {shift} px");
    }
    // One flip alone mirrors, and is seen for what it is.
    nerfstudio(&written, [1.0, -1.0, 1.0]).fails_with(&["transforms.json: frame 0", "mirrors"]);
}

#[test]
fn splits_and_confidences_of_the_formats_are_kept() {
    let written = still_life();
    for folder in [
        instantsplat(&written),
        gaussianobject(&written),
        nerfstudio(&written, OPENGL),
    ] {
        let loaded = folder.scene();
        assert_eq!(names(&loaded.train), names(&written.train));
        assert_eq!(names(&loaded.test), names(&written.test));
        // What the user says goes first.
        folder.write(
            "split.json",
            r#"{"train": ["test_00.png", "train_02.png"], "test": ["train_00.png"]}"#,
        );
        let loaded = folder.scene();
        assert_eq!(names(&loaded.train), ["test_00.png", "train_02.png"]);
        assert_eq!(names(&loaded.test), ["train_00.png"]);
    }
    let loaded = instantsplat(&written).scene();
    assert_eq!(loaded.cloud.confidence, written.cloud.confidence);
    assert_eq!(loaded.pose_protocol, PoseProtocol::Interpolated);
    warns(&loaded, &["2 views have poses that were only interpolated"]);
    // Trained on alone, the poses are all the model's own.
    let folder = instantsplat(&written);
    folder.write(
        "split.json",
        r#"{"train": ["train_01.png", "train_02.png"], "test": []}"#,
    );
    assert_eq!(folder.scene().pose_protocol, PoseProtocol::SharedFrame);
}

#[test]
fn the_first_format_is_taken_and_the_others_are_named() {
    let written = still_life();
    let folder = instantsplat(&written);
    folder.write("transforms.json", "{broken");
    write_colmap(
        &folder,
        "sparse_3/0",
        written.train.iter(),
        "PINHOLE",
        pinhole,
    );
    let taken = "InstantSplat's sparse_4 (text)";
    assert!(folder.scene().source.starts_with(taken));
    warns(
        &folder.scene(),
        &[
            "`sparse_4` is taken; also here and not used: `transforms.json`",
            "interpolated",
        ],
    );
    let six = LoadOptions {
        n_train: 6,
        ..options()
    };
    let error = folder
        .load_with(&six)
        .expect_err("an ambiguity")
        .to_string();
    assert!(
        error.contains("`sparse_3`, `sparse_4` are here") && error.contains("6 training views"),
        "{error}"
    );
    write_colmap(&folder, "sparse/0", views(&written), "PINHOLE", pinhole);
    folder.write("points3D.ply", GOOD_PLY);
    let scene = folder.scene();
    assert!(
        scene.source.starts_with("sparse/0 (text)"),
        "{}",
        scene.source
    );
    warns(
        &scene,
        &["`sparse/0` is taken; also here and not used: `sparse_4`, `transforms.json`"],
    );
}

#[test]
fn what_a_format_lacks_is_named() {
    let written = still_life();
    let folder = instantsplat(&written);
    folder.remove("sparse_4/0/points3D.ply");
    folder.fails_with(&["sparse_4/0", "no point cloud", "init_geo.py"]);
    folder.write("sparse_4/0/points3D.ply", ply(&written.cloud, false));
    write_colmap(
        &folder,
        "sparse_4/1",
        written.train.iter(),
        "PINHOLE",
        pinhole,
    );
    folder.fails_with(&[
        "sparse_4/1",
        "`train_00.png` is a test view here and a training view",
    ]);

    let folder = gaussianobject(&written);
    folder.remove("dust3r_4.ply");
    folder.fails_with(&["dust3r_4.ply", "missing", "pred_poses.py"]);
    folder.write("dust3r_4.json", "[]");
    folder.fails_with(&["dust3r_4.json", "no camera"]);

    let folder = nerfstudio(&written, OPENGL);
    folder.remove("sparse_pc.ply");
    folder.fails_with(&[
        "transforms.json: `ply_file_path`",
        "no file `sparse_pc.ply`",
    ]);
    let folder = instant_ngp(&written);
    folder.remove("points3D.ply");
    folder.fails_with(&["transforms.json", "no point cloud", "`ply_file_path`"]);
}

#[test]
fn every_format_trains_from_the_command_line() {
    let written = still_life();
    for (folder, source) in [
        (vggt(&written), "sparse (text), "),
        (
            mast3r(&written),
            "reconstruction/0 (text), 6 images undistorted, ",
        ),
        (instantsplat(&written), "InstantSplat's sparse_4 "),
        (gaussianobject(&written), "GaussianObject's dust3r_4.json, "),
        (nerfstudio(&written, OPENGL), "transforms.json, cloud "),
        (
            instant_ngp(&written),
            "transforms.json, 6 images undistorted, ",
        ),
        (blender(&written), "transforms_train.json, "),
    ] {
        let runs = tempfile::tempdir().expect("a folder");
        let out = runs.path().join("run");
        let train = "train --iterations 3 --set views.count=2 --set field.n_candidates=64 \
                     --max-points 100";
        let [scene, out] = [folder.path(), &out].map(|p| p.to_str().expect("UTF-8"));
        let places = ["--scene", scene, "--out", out];
        let args: Vec<&str> = train.split_whitespace().chain(places).collect();
        let log = succeed(runs.path(), &args[..]).log;
        assert!(log.contains(&format!("scene: {source}")), "{source}: {log}");
        // The run's record is enough to find the scene again.
        std::fs::remove_file(runs.path().join("run/eval.json")).expect("an evaluation");
        succeed(runs.path(), &["eval", out]);
        let metrics = std::fs::read(runs.path().join("run/metrics.json")).expect("metrics");
        let metrics: Value = serde_json::from_slice(&metrics).expect("JSON");
        let protocol = if source.starts_with("Instant") {
            "interpolated"
        } else {
            "shared_frame"
        };
        assert_eq!(metrics["scene"]["pose_protocol"], protocol, "{source}");
        let loss = metrics["loss"][0]["loss"].as_f64().expect("a loss");
        assert!(loss > 0.0 && loss < 2.0, "{source}: {loss}");
    }
}

#[test]
fn matrices_written_for_these_tests_are_camera_to_world() {
    let camera = &still_life().train[1].camera;
    let rows: [[f64; 4]; 4] = serde_json::from_value(matrix(camera, OPENGL)).expect("a matrix");
    let back = DVec3::new(rows[0][2], rows[1][2], rows[2][2]);
    assert!((back + camera.forward()).length() < 1e-12);
    let up = DVec3::new(rows[0][1], rows[1][1], rows[2][1]);
    assert!((up - camera.up()).length() < 1e-12);
}

#[test]
fn poses_that_were_written_the_wrong_way_round_are_turned() {
    let written = scene(&BuiltinOptions {
        width: 120,
        n_test: 2,
        pixel_step: 1,
        ..BuiltinOptions::default()
    });
    let mut inverted = written.clone();
    for view in inverted.train.iter_mut().chain(&mut inverted.test) {
        let center = view.camera.center();
        view.camera.rotation = view.camera.rotation.transpose();
        view.camera.translation = center;
    }
    let plain = vggt(&written).scene();
    let turned = vggt(&inverted).scene();
    assert!(!plain.warnings.iter().any(|w| w.contains("camera-to-world")));
    assert!(
        turned
            .warnings
            .iter()
            .any(|w| w.contains("camera-to-world")),
        "{:?}",
        turned.warnings
    );
    for (a, b) in plain.train.iter().zip(&turned.train) {
        assert!(a.camera.center().distance(b.camera.center()) < 1e-9);
        assert!(a.camera.rotation.abs_diff_eq(b.camera.rotation, 1e-9));
    }
    assert_eq!(plain.cloud, turned.cloud);
    // A cloud that fits neither way turns nothing.
    let mut other = written.clone();
    other.cloud.colors.reverse();
    let shifted = vggt(&other).scene();
    assert!(
        !shifted
            .warnings
            .iter()
            .any(|w| w.contains("camera-to-world"))
    );
}
