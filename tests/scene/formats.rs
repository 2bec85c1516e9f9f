//! The formats of other programs: detection, axes, splits, confidences, and training from each.

use std::process::Command;

use glam::{DVec2, DVec3};
use gspotential::camera::Camera;
use gspotential::run::PoseProtocol;
use gspotential::scene::{LoadOptions, Scene, View};
use serde_json::{Value, json};

use super::build::{Folder, GOOD_PLY, options, png, warns};
use super::fixtures::{
    blender, gaussianobject, instant_ngp, instantsplat, mast3r, matrix, nerfstudio, npy, npy_with,
    pinhole, ply, still_life, vggt, views, write_colmap, write_images,
};

const OPENGL: [f64; 3] = [1.0, -1.0, -1.0];

fn project(camera: &Camera, p: DVec3) -> DVec2 {
    let p = camera.rotation * p + camera.translation;
    DVec2::new(
        camera.fx * p.x / p.z + camera.cx,
        camera.fy * p.y / p.z + camera.cy,
    )
}

fn names(views: &[View]) -> Vec<&str> {
    views.iter().map(|v| v.camera.name.as_str()).collect()
}

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
fn opengl_cameras_look_along_minus_z_with_y_up() {
    let folder = Folder::empty();
    folder.write("images/a.png", png(12, 8));
    folder.write("points3D.ply", GOOD_PLY);
    let frame = json!({
        "file_path": "images/a.png",
        "transform_matrix": [[1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4]],
    });
    let file = json!({"fl_x": 10, "fl_y": 11, "cx": 6.5, "cy": 3.5, "frames": [frame]});
    folder.write("transforms.json", file.to_string());
    let camera = &folder.scene().train[0].camera;
    assert_eq!(camera.center(), DVec3::new(2.0, 3.0, 4.0));
    // 5 in front, 1 to the right and 2 above.
    let seen = project(camera, DVec3::new(3.0, 5.0, -1.0));
    assert!(
        (seen - DVec2::new(8.5, 3.5 - 11.0 * 0.4)).length() < 1e-12,
        "{seen}"
    );
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
fn blender_scenes_draw_their_views_from_both_files() {
    let folder = blender(&still_life());
    let few = LoadOptions {
        n_train: 2,
        n_test: 1,
        ..options()
    };
    let scene = folder.load_with(&few).expect("a scene");
    assert_eq!(
        names(&scene.train),
        ["train/train_00.png", "train/train_03.png"]
    );
    assert_eq!(names(&scene.test), ["test/test_00.png"]);
    folder.remove("transforms_test.json");
    folder.fails_with(&["transforms_test.json", "cannot read"]);
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
fn confidences_are_read_from_every_float_array_of_a_vector() {
    let written = still_life();
    let folder = instantsplat(&written);
    let place = "sparse_4/0/confidence_dsp.npy";
    let n = written.cloud.len();
    let values: Vec<f32> = (0..n).map(|i| 1.0 + i as f32).collect();
    let doubles: Vec<u8> = values
        .iter()
        .flat_map(|v| f64::from(*v).to_le_bytes())
        .collect();
    let mut version_2 = b"\x93NUMPY\x02\x00".to_vec();
    let header = format!("{{'shape': ({n},), 'fortran_order': True, 'descr': '<f8'}}");
    version_2.extend((header.len() as u32).to_le_bytes());
    version_2.extend(header.bytes());
    version_2.extend(&doubles);
    for bytes in [
        npy(&values, &format!("({n},)")),
        npy(&values, &format!("({n}, 1)")),
        npy(&values, &format!("(1, {n}, 1)")),
        version_2,
    ] {
        folder.write(place, bytes);
        assert_eq!(folder.scene().cloud.confidence.as_ref(), Some(&values));
    }
    let header = |descr: &str, shape: &str| {
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}")
    };
    let shape = format!("({n},)");
    let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    for (bytes, part) in [
        (b"".to_vec(), "byte 0: not an .npy"),
        (b"\x93NUMPY\x09\x00\x10\x00{}".to_vec(), "version 1 to 3"),
        (
            npy(&values, &shape)[..40].to_vec(),
            "ends within its header",
        ),
        (npy(&values[1..], &shape), "bytes follow the header"),
        (
            npy(&values[1..], &format!("({},)", n - 1)),
            "confidences for a cloud of",
        ),
        (npy(&values, "(2, 3)"), "[2, 3] is no vector"),
        (npy(&values, "(4294967296,)"), "counts below 2^32"),
        (
            npy(&values, "(4294967295,)"),
            "4294967295 values of 4 bytes",
        ),
        (npy(&values, "(-1,)"), "counts below 2^32"),
        (npy_with(&header("<i4", &shape), &data), "type is `<i4`"),
        (npy_with(&header("|O", &shape), &data), "type is `|O`"),
        (npy_with("{}", &data), "lacks `descr` or `shape`"),
        (npy_with("[]", &data), "is no dict"),
        (npy_with("{'a': 1, }", &data), "unknown keys"),
        (
            npy_with("{'descr': '<f4', 'shape': 7, }", &data),
            "no tuple",
        ),
        (npy_with("{'descr': '<f4', shape}", &data), "malformed"),
    ] {
        folder.write(place, bytes);
        folder.fails_with(&["confidence_dsp.npy", part]);
    }
    // Confidences that are not finite drop their points, as in a PLY.
    let mut values = values;
    values[3] = f32::NAN;
    folder.write(place, npy(&values, &shape));
    assert_eq!(folder.scene().cloud.len(), n - 1);
}

/// A good transforms.json of one view, and a change of it.
fn changed_transforms(change: impl Fn(&mut Value)) -> Folder {
    let folder = Folder::empty();
    folder.write("images/a.png", png(12, 8));
    folder.write("points3D.ply", GOOD_PLY);
    let frame = json!({
        "file_path": "images/a.png",
        "transform_matrix": [[1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1]],
    });
    let mut file = json!({"fl_x": 10, "w": 12, "h": 8, "frames": [frame]});
    change(&mut file);
    folder.write("transforms.json", file.to_string());
    folder
}

#[test]
fn intrinsics_of_a_frame_go_before_the_shared_ones() {
    let camera_of = |change: fn(&mut Value)| {
        let scene = changed_transforms(change).scene();
        scene.train[0].camera.clone()
    };
    let camera = camera_of(|_| {});
    assert_eq!(
        [camera.fx, camera.fy, camera.cx, camera.cy],
        [10.0, 10.0, 6.0, 4.0]
    );
    let camera = camera_of(|file| {
        file["cx"] = json!(5.0);
        file["fl_y"] = json!(13);
        file["frames"][0]["fl_x"] = json!(11.5);
        file["frames"][0]["fl_y"] = Value::Null;
    });
    assert_eq!(
        [camera.fx, camera.fy, camera.cx, camera.cy],
        [11.5, 13.0, 5.0, 4.0]
    );
    let camera = camera_of(|file| {
        file["fl_x"] = Value::Null;
        file["camera_angle_x"] = json!(std::f64::consts::FRAC_PI_2);
        file["camera_angle_y"] = json!(2.0 * (0.5f64).atan());
    });
    assert!((camera.fx - 6.0).abs() < 1e-12 && (camera.fy - 8.0).abs() < 1e-12);
    // Sizes that are not stated are those of the image.
    let camera = camera_of(|file| {
        file["w"] = Value::Null;
    });
    assert_eq!((camera.width, camera.height, camera.cx), (12, 8, 6.0));
    // A pose that scales is one all the same.
    let scene = changed_transforms(|file| {
        file["frames"][0]["transform_matrix"] =
            json!([[0, 2, 0, 2], [-2, 0, 0, 3], [0, 0, 2, 4], [0, 0, 0, 1]]);
    })
    .scene();
    warns(&scene, &["1 poses scale", "only 1"]);
    let camera = &scene.train[0].camera;
    assert!((camera.center() - DVec3::new(2.0, 3.0, 4.0)).length() < 1e-12);
    assert!((camera.up() - DVec3::X).length() < 1e-12, "{}", camera.up());
}

#[test]
fn faulty_transforms_are_refused_with_frame_and_key() {
    for (key, value, parts) in [
        (
            "frames",
            Value::Null,
            ["no list `frames`", "transforms.json"],
        ),
        ("frames", json!([]), ["no frame can be used", ""]),
        ("frames", json!([7]), ["frame 0", "not an object"]),
        ("fl_x", json!(0), ["frame 0", "focal length 0"]),
        ("fl_x", json!(-3.5), ["frame 0", "focal length -3.5"]),
        ("fl_x", json!("10"), ["frame 0", "`fl_x` is not a number"]),
        ("fl_x", Value::Null, ["frame 0", "neither `fl_x` nor"]),
        ("w", json!(12.5), ["frame 0", "image size 12.5x8"]),
        ("h", json!(-8), ["frame 0", "image size 12x-8"]),
        ("w", json!(1e300), ["frame 0", "is not within"]),
        ("cx", json!({}), ["frame 0", "`cx` is not a number"]),
        ("k1", json!(-40), ["frame 0", "folds the image"]),
        ("k3", json!(0.1), ["`k3` is not supported", "undistort"]),
        (
            "distortion_params",
            json!([0.1]),
            ["`distortion_params`", "not supported"],
        ),
        (
            "camera_model",
            json!("OPENCV_FISHEYE"),
            ["OPENCV_FISHEYE", "not supported"],
        ),
        (
            "camera_model",
            json!(3),
            ["camera model 3", "not supported"],
        ),
        ("is_fisheye", json!(true), ["`is_fisheye`", "not supported"]),
        ("camera_angle_y", json!(4), ["`camera_angle_y` is 4", "pi"]),
        (
            "train_filenames",
            json!("a"),
            ["`train_filenames`", "no list"],
        ),
        (
            "test_filenames",
            json!(["a.png"]),
            ["`train_filenames` is missing", ""],
        ),
        (
            "train_filenames",
            json!(["../a.png"]),
            ["`train_filenames`", "leaves"],
        ),
        (
            "train_filenames",
            json!(["images/b.png"]),
            ["`b.png` is not in the scene", "a.png"],
        ),
        (
            "ply_file_path",
            json!("../cloud.ply"),
            ["`ply_file_path`", "leaves the scene"],
        ),
        (
            "ply_file_path",
            json!("/tmp/cloud.ply"),
            ["`ply_file_path`", "leaves the scene"],
        ),
        (
            "ply_file_path",
            json!("C:\\cloud.ply"),
            ["`ply_file_path`", "leaves the scene"],
        ),
        (
            "ply_file_path",
            json!(".."),
            ["`ply_file_path`", "leaves the scene"],
        ),
        (
            "ply_file_path",
            json!("images"),
            ["`ply_file_path`", "no file"],
        ),
        (
            "ply_file_path",
            json!(1),
            ["`ply_file_path`", "not a file name"],
        ),
    ] {
        let changed = |file: &mut Value| {
            file[key] = value.clone();
        };
        changed_transforms(changed).fails_with(&parts);
    }
    let pose = |last: Value| json!([[1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4], last]);
    for (key, value, parts) in [
        ("file_path", Value::Null, ["frame 0", "no `file_path`"]),
        (
            "file_path",
            json!("../a.png"),
            ["frame 0", "leaves the scene"],
        ),
        (
            "file_path",
            json!("images/../../a.png"),
            ["frame 0", "leaves the scene"],
        ),
        (
            "file_path",
            json!("/etc/passwd"),
            ["frame 0", "leaves the scene"],
        ),
        (
            "file_path",
            json!("..\\a.png"),
            ["frame 0", "leaves the scene"],
        ),
        ("file_path", json!("./"), ["frame 0", "is empty"]),
        (
            "file_path",
            json!("a\nb.png"),
            ["frame 0", "control characters"],
        ),
        (
            "transform_matrix",
            Value::Null,
            ["frame 0", "rows of numbers"],
        ),
        (
            "transform_matrix",
            json!([[1, 2], [3, 4]]),
            ["frame 0", "4 columns"],
        ),
        (
            "transform_matrix",
            pose(json!([0, 0, 1, 1])),
            ["frame 0", "0 0 0 1"],
        ),
        (
            "transform_matrix",
            pose(json!(["NaN", 0, 0, 1])),
            ["frame 0", "rows of numbers"],
        ),
        (
            "transform_matrix",
            json!([[0, 0, 0, 2], [0, 0, 0, 3], [0, 0, 0, 4]]),
            ["frame 0", "no rigid motion"],
        ),
        (
            "transform_matrix",
            json!([[1, 0.1, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4]]),
            ["frame 0", "no rigid motion"],
        ),
        (
            "transform_matrix",
            json!([[1e308, 0, 0, 2], [0, 1e308, 0, 3], [0, 0, 1e308, 4]]),
            ["frame 0", "no rigid motion"],
        ),
    ] {
        let changed = |file: &mut Value| {
            file["frames"][0][key] = value.clone();
        };
        changed_transforms(changed).fails_with(&parts);
    }
    let folder = changed_transforms(|file| {
        let twice = file["frames"][0].clone();
        file["frames"] = json!([twice.clone(), twice]);
    });
    folder.fails_with(&["transforms.json", "`images/a.png` has two frames"]);
    // Python writes what JSON has no word for.
    folder.write("transforms.json", "{\"fl_x\": 10,\n \"k1\": NaN}");
    folder.fails_with(&["transforms.json", "line 2"]);
    let deep = format!("{{\"frames\": {}1{}}}", "[".repeat(9999), "]".repeat(9999));
    folder.write("transforms.json", deep);
    folder.fails_with(&["transforms.json", "recursion"]);
}

#[test]
fn frames_whose_images_are_missing_are_counted() {
    let written = still_life();
    let folder = blender(&written);
    folder.remove("train/train_01.png");
    let scene = folder.scene();
    assert_eq!(scene.train.len(), 3);
    warns(&scene, &["1 frames have no image"]);
    let folder = nerfstudio(&written, OPENGL);
    folder.remove("images/test_01.png");
    warns(
        &folder.scene(),
        &["1 poses have no image", "1 test views of `transforms.json`"],
    );
}

/// The format files of one fixture.
type Files = (fn(&Scene) -> Folder, &'static [&'static str]);

#[test]
fn damaged_files_of_any_format_are_errors_of_one_line() {
    let written = still_life();
    let fixtures: [Files; 5] = [
        (
            instantsplat,
            &["sparse_4/0/confidence_dsp.npy", "sparse_4/1/images.txt"],
        ),
        (mast3r, &["reconstruction/0/cameras.txt"]),
        (gaussianobject, &["dust3r_4.json", "dust3r_4.ply"]),
        (instant_ngp, &["transforms.json"]),
        (blender, &["transforms_train.json"]),
    ];
    let mut random = crate::geometry::Random::new(5);
    let (mut n_loaded, mut n_refused) = (0, 0);
    for (make, files) in fixtures {
        let folder = make(&written);
        for file in files {
            let good = std::fs::read(folder.path().join(file)).expect("a file");
            for round in 0..40 {
                let mut bytes = good.clone();
                if round % 4 == 0 {
                    bytes.truncate(random.index(bytes.len()));
                } else {
                    for _ in 0..round {
                        let at = random.index(bytes.len());
                        bytes[at] = random.index(256) as u8;
                    }
                }
                folder.write(file, bytes);
                match folder.load() {
                    Ok(_) => n_loaded += 1,
                    Err(e) => {
                        let text = e.to_string();
                        assert!(!text.contains('\n') && text.len() < 2000, "{text}");
                        n_refused += 1;
                    }
                }
            }
            folder.write(file, good);
        }
        assert!(folder.load().is_ok());
    }
    assert!(n_loaded > 5 && n_refused > 100, "{n_loaded} {n_refused}");
}

#[cfg(unix)]
#[test]
fn pipes_are_refused_and_links_are_followed() {
    let written = still_life();
    let folder = vggt(&written);
    for file in ["sparse/images.txt", "split.json"] {
        let path = folder.path().join(file);
        let _ = std::fs::remove_file(&path);
        let made = Command::new("mkfifo").arg(&path).status().expect("mkfifo");
        assert!(made.success());
        folder.fails_with(&[file, "not a regular file"]);
        std::fs::remove_file(&path).expect("the pipe");
        write_colmap(&folder, "sparse", views(&written), "PINHOLE", pinhole);
    }
    let elsewhere = Folder::empty();
    write_images(&elsewhere, "photographs", views(&written));
    std::fs::remove_dir_all(folder.path().join("images")).expect("the images");
    let link = folder.path().join("images");
    std::os::unix::fs::symlink(elsewhere.path().join("photographs"), link).expect("a link");
    assert_eq!(folder.scene().train.len(), 4);
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
                     --set model.confidence_opacity=true --set splat.min_confidence=0.5 \
                     --max-points 100";
        let run = |args: &mut dyn Iterator<Item = &str>| {
            let output = Command::new(env!("CARGO_BIN_EXE_gspotential"))
                .args(args)
                .output()
                .expect("the command starts");
            let log = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(output.status.success(), "{source}: {log}");
            log
        };
        let [scene, out] = [folder.path(), &out].map(|p| p.to_str().expect("UTF-8"));
        let places = ["--scene", scene, "--out", out];
        let log = run(&mut train.split_whitespace().chain(places));
        assert!(log.contains(&format!("scene: {source}")), "{source}: {log}");
        // The run's record is enough to find the scene again.
        run(&mut ["eval", out].into_iter());
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
