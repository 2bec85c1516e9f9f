//! Cameras and poses that no photograph can have.

use super::*;

#[test]
fn unsupported_camera_models_name_the_way_out() {
    let mut model = good();
    for (id, name, n) in [
        (7, "FOV", 5),
        (11, "RAD_TAN_THIN_PRISM_FISHEYE", 16),
        (13, "DIVISION", 5),
    ] {
        model.cameras[1] = (-9, name, id, vec![1.0; n]);
        let what = format!("`{name}` is not supported");
        model.fails_with(
            "cameras.txt: line 2",
            "cameras.bin: byte 64",
            &[&what, "colmap image_undistorter"],
        );
    }
    model.cameras[1].2 = 77;
    model
        .folder("0", true)
        .fails_with(&["`id 77` is not supported"]);
    model.cameras[1].2 = -1;
    model
        .folder("0", true)
        .fails_with(&["`id -1` is not supported"]);
}

#[test]
fn impossible_intrinsics_are_refused() {
    let place = ("cameras.txt: line 1", "cameras.bin: byte 8");
    for (at, value, what) in [
        (0, 0.0, "focal length"),
        (0, -10.0, "focal length"),
        // Scaled to a smaller image it would be 0.
        (0, 5e-324, "focal length"),
        (3, -1e12, "principal point"),
    ] {
        let mut model = good();
        model.cameras[0].3[at] = value;
        model.fails_with(place.0, place.1, &["camera 4", what]);
    }
    let mut model = good();
    model.cameras[1].0 = 4;
    model.fails_with(
        "cameras.txt: line 2",
        "cameras.bin: byte 64",
        &["camera 4 appears twice"],
    );
    let mut model = good();
    model.images.retain(|image| image.2 == 4);
    let folder = model.folder("sparse", false);
    for (line, part) in [
        ("4 PINHOLE 0 8 10 11 6 4", "image size 0x8"),
        (
            "4 PINHOLE 12 4294967304 10 11 6 4",
            "image size 12x4294967304",
        ),
        (
            "1 PINHOLE 12 99999999999999999999 10 11 6 4",
            "not a valid number",
        ),
        ("4 PINHOLE 12 8 10 11 6", "4 parameters, found 3"),
        ("4 SIMPLE_PINHOLE 12 8 10 11 6 4", "3 parameters, found 4"),
        ("1 PINHOLE 12 8 10 11 six 4", "`six`"),
        ("1 PINHOLE 12", "line ends before the camera's height"),
    ] {
        folder.write("sparse/cameras.txt", format!("# one\n{line}\n"));
        folder.fails_with(&["cameras.txt: line 2", part]);
    }
}

#[test]
fn impossible_poses_are_refused() {
    let place = ("images.txt: line 2", "images.bin: byte 8");
    let mut model = good();
    model.images[0].2 = 5;
    model.fails_with(place.0, place.1, &["`c.png`", "no camera 5"]);
}
