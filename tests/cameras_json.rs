//! Cameras on disk.

use glam::{DVec3, dvec3};
use gspotential::camera::Camera;
use gspotential::camera::json::{read_cameras, write_cameras};

use crate::geometry::{camera, ring, scratch};

#[test]
fn cameras_json_round_trip_keeps_the_cameras() {
    let (_folder, path) = scratch("cameras.json");
    let mut cameras = ring(5, dvec3(100.0, 2.0, 3.0));
    cameras.push(Camera {
        cx: 3.25,
        cy: 40.0,
        name: "left/00.jpg".into(),
        ..camera(DVec3::ZERO, DVec3::Y)
    });
    write_cameras(&path, &cameras, DVec3::ZERO).unwrap();
    let back = read_cameras(&path).unwrap();
    assert_eq!(back.len(), cameras.len());
    for (a, b) in back.iter().zip(&cameras) {
        assert!(a.translation.distance(b.translation) < 1e-11);
        let rest = Camera {
            translation: b.translation,
            ..a.clone()
        };
        assert_eq!(&rest, b);
    }
}

#[test]
fn cameras_json_holds_centre_and_transposed_rotation() {
    let (_folder, path) = scratch("cameras.json");
    let eye = dvec3(3.0, -1.0, 2.0);
    let target = dvec3(0.5, 0.25, 0.0);
    write_cameras(&path, &[camera(eye, target)], DVec3::ZERO).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let forward = (target - eye).normalize();
    for i in 0..3 {
        assert!((number(&json[0]["position"][i]) - eye[i]).abs() < 1e-12);
        // The last column of the camera-to-world rotation is the viewing direction.
        assert!((number(&json[0]["rotation"][i][2]) - forward[i]).abs() < 1e-12);
    }
}

#[test]
fn cameras_json_without_principal_point_centres_it() {
    let (_folder, path) = scratch("cameras.json");
    let entry = r#"[{"id": 7, "img_name": "00", "width": 101, "height": 50, "fx": 9.5, "fy": 9,
        "position": [1, 2, 3], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "extra": null}]"#;
    std::fs::write(&path, entry).unwrap();
    let camera = &read_cameras(&path).unwrap()[0];
    assert_eq!((camera.cx, camera.cy), (50.5, 25.0));
    assert_eq!(camera.translation, dvec3(-1.0, -2.0, -3.0));
}

#[test]
fn rotations_of_few_digits_become_orthonormal() {
    let (_folder, path) = scratch("cameras.json");
    let entry = r#"[{"id": 7, "img_name": "00", "width": 101, "height": 50, "fx": 9.5, "fy": 9,
        "position": [1, 2, 3], "rotation": [[0.8, -0.6, 0], [0.6, 0.8003, 0], [0, 0, 1.0002]]}]"#;
    std::fs::write(&path, entry).unwrap();
    let rotation = read_cameras(&path).unwrap()[0].rotation;
    let error = rotation.transpose() * rotation - glam::DMat3::IDENTITY;
    assert!(error.to_cols_array().iter().all(|v| v.abs() < 1e-12));
    assert!((rotation.row(0) - dvec3(0.8, 0.6, 0.0)).length() < 1e-3);
}

#[test]
fn bad_cameras_json_names_file_and_entry() {
    let (_folder, path) = scratch("cameras.json");
    write_cameras(&path, &ring(3, DVec3::ZERO), DVec3::ZERO).unwrap();
    let good: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let error = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let text = read_cameras(&path).unwrap_err().to_string();
        assert!(text.starts_with(&path.display().to_string()), "{text}");
        text
    };
    for (key, value, expected) in [
        ("fx", serde_json::Value::Null, "entry 1: "),
        ("fy", 0.0.into(), "fy is 0"),
        ("fx", 1e300.into(), "fx is 1e300 pixels"),
        ("cx", (-1e10).into(), "cx is -1e10 pixels"),
        ("width", 0.into(), "image size is 0x48"),
        ("width", (-3).into(), "entry 1: "),
        ("height", 5_000_000_000u64.into(), "entry 1: "),
        (
            "img_name",
            "../../etc/passwd".into(),
            "not a plain relative file name",
        ),
        (
            "img_name",
            "/tmp/x".into(),
            "not a plain relative file name",
        ),
        ("img_name", "".into(), "not a plain relative file name"),
        ("position", serde_json::json!([1, 2]), "entry 1: "),
        (
            "position",
            serde_json::json!([1.7e308, 1.7e308, 1.7e308]),
            "too large",
        ),
        (
            "rotation",
            serde_json::json!([[1, 0, 0], [0, 1, 0], [0, 0, 2]]),
            "not a rotation",
        ),
        (
            "rotation",
            serde_json::json!([[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
            "not a rotation",
        ),
        ("img_name", good[0]["img_name"].clone(), "was used before"),
    ] {
        let mut bad = good.clone();
        bad[1][key] = value;
        let text = error(&bad.to_string());
        assert!(
            text.contains("entry 1") && text.contains(expected),
            "{key}: {text}"
        );
    }
    let mut bad = good.clone();
    bad[2].as_object_mut().unwrap().remove("rotation");
    assert!(error(&bad.to_string()).contains("entry 2: missing field `rotation`"));
    assert!(error("[{]").contains("line 1 column"));
    assert!(error("{}").contains("not a JSON list"));
}
