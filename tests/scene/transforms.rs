//! `transforms.json`: axes, intrinsics, and what is refused.

use glam::{DVec2, DVec3};
use gspotential::scene::LoadOptions;
use serde_json::{Value, json};

use super::build::{Folder, GOOD_PLY, options, png, warns};
use super::fixtures::{OPENGL, blender, names, nerfstudio, project, still_life};

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
        ("fl_x", json!(0), ["frame 0", "is 0e0 pixels"]),
        ("fl_x", json!(-3.5), ["frame 0", "is -3.5e0 pixels"]),
        ("fl_x", json!("10"), ["frame 0", "`fl_x` is not a number"]),
        ("fl_x", Value::Null, ["frame 0", "neither `fl_x` nor"]),
        ("w", json!(12.5), ["frame 0", "image size 12.5x8"]),
        ("h", json!(-8), ["frame 0", "image size 12x-8"]),
        ("w", json!(1e300), ["frame 0", "is not within"]),
        ("cx", json!({}), ["frame 0", "`cx` is not a number"]),
        ("k1", json!(-40), ["images/a.png", "folds the image"]),
        ("k4", json!(0.1), ["`k4` is not supported", "undistort"]),
        (
            "distortion_params",
            json!([0.1]),
            ["`distortion_params`", "not supported"],
        ),
        (
            "camera_model",
            json!("EQUIRECTANGULAR"),
            ["EQUIRECTANGULAR", "not supported"],
        ),
        (
            "camera_model",
            json!(3),
            ["camera model 3", "not supported"],
        ),
        ("is_fisheye", json!(1), ["`is_fisheye`", "not supported"]),
        ("camera_angle_y", json!(4), ["`camera_angle_y` is 4", "pi"]),
        (
            "train_filenames",
            json!("a"),
            ["`train_filenames`", "is not a list"],
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
            ["no frame can be used", "1 no pose"],
        ),
        (
            "transform_matrix",
            pose(json!(["x", 0, 0, 1])),
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
            ["no frame can be used", "1 no pose"],
        ),
        (
            "transform_matrix",
            json!([[0, 0, 0, 2], [0, 0, 0, 3], [0, 0, 0, 4]]),
            ["frame 0", "not a rigid motion"],
        ),
        (
            "transform_matrix",
            json!([[1, 0.1, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4]]),
            ["frame 0", "not a rigid motion"],
        ),
        (
            "transform_matrix",
            json!([[1e308, 0, 0, 2], [0, 1e308, 0, 3], [0, 0, 1e308, 4]]),
            ["frame 0", "not a rigid motion"],
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
    folder.write("transforms.json", "{\"fl_x\": 10,\n \"k1\": nan}");
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

#[test]
fn what_python_writes_for_no_number_harms_nothing_else() {
    let folder = nerfstudio(&still_life(), OPENGL);
    let path = folder.path().join("transforms.json");
    let plain = std::fs::read_to_string(&path).expect("a file");
    let whole = folder.scene();
    // Beside what is read, and in a string, nothing changes.
    let beside = plain.replacen(
        '{',
        "{\"sharpness\": NaN, \"NaN \\\" Infinity\": -Infinity,",
        1,
    );
    folder.write("transforms.json", format!("\u{feff}{beside}"));
    let scene = folder.scene();
    assert_eq!(names(&scene.train), names(&whole.train));
    warns(&scene, &[]);
    // A lens that is none is refused, a pose that is none left out.
    let lens = |value: &str| plain.replacen("\"k1\":0.0", &format!("\"k1\":{value}"), 1);
    assert_ne!(lens("NaN"), plain);
    folder.write("transforms.json", lens("NaN"));
    folder.fails_with(&["transforms.json: frame 0", "`k1` is not a number"]);
    let row = plain.find("[0.0,0.0,0.0,1.0]").expect("a last row");
    let mut pose = plain.clone();
    pose.replace_range(row..row + 17, "[0.0,0.0,0.0,NaN]");
    folder.write("transforms.json", pose);
    folder.fails_with(&["training view", "image but no pose"]);
    let unlisted = plain
        .replace("train_filenames", "x")
        .replace("test_filenames", "y");
    let unlisted = unlisted.replacen("val_filenames", "z", 1);
    let row = unlisted.find("[0.0,0.0,0.0,1.0]").expect("a last row");
    let mut pose = unlisted;
    pose.replace_range(row..row + 17, "[0.0,0.0,0.0,-Infinity]");
    folder.write("transforms.json", pose);
    warns(
        &folder.scene(),
        &["1 frames have no pose", "1 images have no pose"],
    );
}

#[test]
fn a_last_row_may_be_off_by_rounding_and_no_more() {
    let last = |row: Value| {
        changed_transforms(move |file| {
            file["frames"][0]["transform_matrix"][3] = row.clone();
        })
    };
    last(json!([0, 1e-9, 0, 0.9999999])).scene();
    last(json!([0, 1e-3, 0, 1])).fails_with(&["0 0 0 1"]);
    last(json!([0, 0, 0, 0.999])).fails_with(&["0 0 0 1"]);
}

#[test]
fn masks_that_frames_name_are_those_of_the_masks_folder() {
    let mask = |x: u32| image::Luma([if x < 6 { 255 } else { 0 }]);
    let mask = image::GrayImage::from_fn(12, 8, |x, _| mask(x));
    let mut bytes = std::io::Cursor::new(Vec::new());
    mask.write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a PNG");
    let bytes = bytes.into_inner();
    let named = changed_transforms(|file| {
        file["frames"][0]["mask_path"] = json!("./mattes\\a.png");
    });
    named.fails_with(&["frame 0", "`mask_path`", "no file `mattes/a.png`"]);
    named.write("mattes/a.png", &bytes);
    let folder = changed_transforms(|_| {});
    folder.write("masks/a.png", &bytes);
    let (named, by_folder) = (named.scene(), folder.scene());
    assert!(by_folder.train[0].mask.is_some());
    assert_eq!(named.train[0].mask, by_folder.train[0].mask);
}

#[test]
fn frames_without_suffix_or_size_are_completed_from_the_files() {
    let folder = changed_transforms(|file| {
        file["frames"][0]["file_path"] = json!("images/a");
        file["w"] = Value::Null;
    });
    folder.remove("images/a.png");
    // By its content, whatever its suffix says.
    folder.write("images/a.JPG", png(12, 8));
    let scene = folder.scene();
    assert_eq!(scene.train[0].camera.name, "a.JPG");
    assert_eq!(scene.train[0].camera.width, 12);
    warns(&scene, &["only 1"]);
}
