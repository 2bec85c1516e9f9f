//! COLMAP models: poses and intrinsics.

use super::build::{
    CAMERAS_TXT, Folder, GOOD_PLY, SIZE, fails_with, images_txt, options, png, warns,
};
use glam::{DMat3, DQuat, DVec3};
use gspotential::error::ErrorKind;
use gspotential::scene::{Scene, SceneSource, load};

/// id, model, model id, parameters
type CameraLine = (i32, &'static str, i32, Vec<f64>);
/// rotation wxyz, translation, camera id, name, number of observations
type ImageLine = ([f64; 4], [f64; 3], i32, Vec<u8>, u64);

/// A model to write in either encoding.
struct Model {
    cameras: Vec<CameraLine>,
    images: Vec<ImageLine>,
}

impl Model {
    fn cameras_txt(&self) -> String {
        let line = |(id, model, _, params): &CameraLine| {
            let params: Vec<String> = params.iter().map(f64::to_string).collect();
            format!("{id} {model} {} {} {}\n", SIZE.0, SIZE.1, params.join(" "))
        };
        self.cameras.iter().map(line).collect()
    }

    fn images_txt(&self) -> Vec<u8> {
        let mut bytes = b"# images\n".to_vec();
        for (i, ([w, x, y, z], [tx, ty, tz], camera, name, n)) in self.images.iter().enumerate() {
            bytes.extend(format!("{i} {w} {x} {y} {z} {tx} {ty} {tz} {camera} ").bytes());
            bytes.extend(name);
            bytes.extend(format!("\n{}\n", "1.5 2.5 -1 ".repeat(*n as usize)).bytes());
        }
        bytes
    }

    fn cameras_bin(&self) -> Vec<u8> {
        let mut bytes = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for (id, _, model, params) in &self.cameras {
            bytes.extend(id.to_le_bytes());
            bytes.extend(model.to_le_bytes());
            bytes.extend(u64::from(SIZE.0).to_le_bytes());
            bytes.extend(u64::from(SIZE.1).to_le_bytes());
            bytes.extend(params.iter().flat_map(|p| p.to_le_bytes()));
        }
        bytes
    }

    fn images_bin(&self) -> Vec<u8> {
        let mut bytes = (self.images.len() as u64).to_le_bytes().to_vec();
        for (i, (rotation, translation, camera, name, n)) in self.images.iter().enumerate() {
            bytes.extend((i as i32).to_le_bytes());
            bytes.extend(
                rotation
                    .iter()
                    .chain(translation)
                    .flat_map(|v| v.to_le_bytes()),
            );
            bytes.extend(camera.to_le_bytes());
            bytes.extend(name);
            bytes.push(0);
            bytes.extend(n.to_le_bytes());
            bytes.resize(bytes.len() + 24 * *n as usize, 0xee);
        }
        bytes
    }

    fn folder(&self, place: &str, binary: bool) -> Folder {
        let folder = Folder::empty();
        if binary {
            folder.write(&format!("{place}/cameras.bin"), self.cameras_bin());
            folder.write(&format!("{place}/images.bin"), self.images_bin());
        } else {
            folder.write(&format!("{place}/cameras.txt"), self.cameras_txt());
            folder.write(&format!("{place}/images.txt"), self.images_txt());
        }
        folder.write(&format!("{place}/points3D.ply"), GOOD_PLY);
        for (_, _, _, name, _) in &self.images {
            if let Ok(name) = std::str::from_utf8(name)
                && !name.is_empty()
                && !name.contains("..")
                && !name.starts_with('/')
            {
                folder.write(&format!("images/{name}"), png(SIZE.0, SIZE.1));
            }
        }
        folder
    }

    #[track_caller]
    fn fails_with(&self, text_place: &str, binary_place: &str, parts: &[&str]) {
        for (binary, place) in [(false, text_place), (true, binary_place)] {
            let mut parts = parts.to_vec();
            parts.push(place);
            self.folder("sparse/0", binary).fails_with(&parts);
        }
    }
}

/// PINHOLE and SIMPLE_PINHOLE, shared and not, unsorted, a name with a blank and a folder.
fn good() -> Model {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1);
    let pose = |i: f64| {
        let q = DQuat::from_rotation_y(0.4 * i) * turn;
        ([q.w, q.x, q.y, q.z], [0.1 * i, -0.2, 3.0 + i])
    };
    let image = |i: u8, camera, name: &str| {
        let (rotation, translation) = pose(f64::from(i));
        (
            rotation,
            translation,
            camera,
            name.as_bytes().to_vec(),
            u64::from(i % 3),
        )
    };
    Model {
        cameras: vec![
            (4, "PINHOLE", 1, vec![10.25, 11.5, 6.125, 3.875]),
            (-9, "SIMPLE_PINHOLE", 0, vec![12.0, 6.0, 4.0]),
        ],
        images: vec![
            image(1, 4, "c.png"),
            image(2, -9, "left/a b.png"),
            image(0, 4, "d.png"),
            image(3, -9, "b.png"),
            image(4, 4, "e.png"),
        ],
    }
}

#[track_caller]
fn check_good(scene: &Scene, model: &Model) {
    warns(scene, &[]);
    let names: Vec<_> = scene.train.iter().map(|v| v.camera.name.as_str()).collect();
    assert_eq!(names, ["b.png", "c.png", "e.png", "left/a b.png"]);
    assert_eq!(scene.test.len(), 1);
    for view in scene.train.iter().chain(&scene.test) {
        let camera = &view.camera;
        let ([w, x, y, z], t, id, ..) = model
            .images
            .iter()
            .find(|image| image.3 == camera.name.as_bytes())
            .expect("the image of that name");
        let rotation = DMat3::from_quat(DQuat::from_xyzw(*x, *y, *z, *w));
        assert!(
            camera.rotation.abs_diff_eq(rotation, 1e-14),
            "{}",
            camera.name
        );
        assert_eq!(camera.translation, DVec3::from(*t));
        let got = [camera.fx, camera.fy, camera.cx, camera.cy];
        let expected = if *id == 4 {
            [10.25, 11.5, 6.125, 3.875]
        } else {
            [12.0, 12.0, 6.0, 4.0]
        };
        assert_eq!(got, expected, "{}", camera.name);
        assert_eq!((camera.width, camera.height), SIZE);
    }
}

#[test]
fn text_and_binary_models_are_read_alike_from_every_folder() {
    for place in ["sparse/0", "sparse", "0"] {
        for binary in [false, true] {
            let folder = good().folder(place, binary);
            let scene = folder.scene();
            check_good(&scene, &good());
            let kind = if binary { "binary" } else { "text" };
            assert!(
                scene.source.starts_with(&format!("{place} ({kind})")),
                "{}",
                scene.source
            );
        }
    }
}

#[test]
fn rotations_are_world_to_camera() {
    // COLMAP's q = (cos 45, 0, sin 45, 0): a turn about y that takes world +x to camera -z.
    let half = 0.5f64.sqrt();
    let mut model = good();
    model.images.truncate(1);
    model.images[0].0 = [half, 0.0, half, 0.0];
    let scene = model.folder("sparse", false).scene();
    let camera = &scene.train[0].camera;
    assert!((camera.rotation * DVec3::X).abs_diff_eq(-DVec3::Z, 1e-14));
    assert!(camera.forward().abs_diff_eq(-DVec3::X, 1e-14));
}

#[test]
fn missing_folders_and_files_are_named() {
    let folder = Folder::empty();
    let missing = load(&folder.path().join("nowhere"), &options());
    fails_with(
        missing,
        ErrorKind::Failure,
        &["nowhere", "no such scene folder", "give"],
    );
    folder.fails_with(&["no scene in this folder", "`sparse/0`"]);
    folder.write("sparse/0/cameras.txt", CAMERAS_TXT);
    folder.fails_with(&["sparse/0/images.txt", "cannot read"]);
    for (name, way_out) in [
        ("sparce", "did you mean `sparse`?"),
        ("garden", "`--scene builtin`"),
    ] {
        let source = SceneSource::Folder(folder.path().join(name)).resolved();
        fails_with(
            source,
            ErrorKind::Failure,
            &["cannot open the scene", name, way_out],
        );
    }
    folder.write("sparse/0/images.txt", images_txt(&["a.png"]));
    folder.fails_with(&["no point cloud"]);
    folder.write("sparse/0/points3D.ply", GOOD_PLY);
    folder.fails_with(&["images", "cannot list the images", "put the photographs"]);
    folder.write("images/other.png", png(4, 4));
    folder.fails_with(&["images", "none of the 1 posed images", "`a.png`"]);
    folder.write("images/a.png", png(SIZE.0, SIZE.1));
    assert_eq!(folder.scene().train.len(), 1);
}

#[test]
fn models_without_an_image_are_refused() {
    let mut model = good();
    model.images.clear();
    model.fails_with(
        "images.txt",
        "images.bin",
        &["no posed image", "run it again"],
    );
}

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
    model.images[0].0 = [0.0; 4];
    model.fails_with(place.0, place.1, &["`c.png`", "no rotation"]);
    let mut model = good();
    model.images[0].2 = 5;
    model.fails_with(place.0, place.1, &["`c.png`", "no camera 5"]);
}

#[test]
fn images_without_a_finite_pose_or_camera_are_left_out_and_counted() {
    type Change = fn(&mut Model);
    let changes: [(Change, &str, usize); 4] = [
        (
            |model| model.images[0].0[1] = f64::NAN,
            "1 images have a pose or a camera",
            4,
        ),
        (|model| model.images[0].1[2] = f64::INFINITY, "`c.png`", 4),
        (
            |model| model.cameras[0].3[1] = f64::NAN,
            "3 images have a pose or a camera",
            2,
        ),
        (
            |model| model.cameras[1].3[2] = f64::NEG_INFINITY,
            "2 images have a pose",
            3,
        ),
    ];
    for (change, warning, n_left) in changes {
        for binary in [false, true] {
            let mut model = good();
            change(&mut model);
            let scene = model.folder("sparse", binary).scene();
            assert!(scene.warnings[0].contains(warning), "{:?}", scene.warnings);
            assert_eq!(scene.train.len() + scene.test.len(), n_left);
        }
    }
    // As Microsoft's C library prints what is no number.
    let folder = good().folder("sparse", false);
    let cameras = good().cameras_txt();
    folder.write("sparse/cameras.txt", cameras.replace("11.5", "-nan(ind)"));
    assert!(folder.scene().warnings[0].contains("3 images have a pose"));
    folder.write("sparse/cameras.txt", cameras.replace("11.5", "1.#QNAN"));
    assert_eq!(folder.scene().train.len(), 2);
}

#[test]
fn a_camera_that_no_photograph_uses_is_not_judged() {
    for binary in [false, true] {
        let mut model = good();
        model.cameras.push((7, "FOV", 7, vec![0.0; 5]));
        check_good(&model.folder("sparse", binary).scene(), &model);
        // Nor is that of a pose whose photograph is not there.
        let mut image = model.images[0].clone();
        (image.2, image.3) = (7, b"gone.png".to_vec());
        model.images.push(image);
        let folder = model.folder("sparse", binary);
        folder.fails_with(&["camera 7", "`FOV` is not supported"]);
        folder.remove("images/gone.png");
        assert_eq!(folder.scene().train.len(), 4);
    }
}

#[test]
fn byte_order_marks_and_what_stands_for_observations_are_passed_over() {
    let model = good();
    let folder = model.folder("sparse", false);
    let images = String::from_utf8(model.images_txt()).expect("text");
    // The line behind each image, whatever it held.
    let mut lines: Vec<&str> = images.lines().collect();
    for (i, line) in lines.iter_mut().enumerate().skip(2).step_by(2) {
        *line = [
            "placeholder",
            "1 2",
            "",
            "0 x y z 1 2 3 4 5 6",
            "1.5 2.5 -1",
        ][i % 5];
    }
    folder.write(
        "sparse/images.txt",
        format!("\u{feff}{}\n", lines.join("\n")),
    );
    folder.write(
        "sparse/cameras.txt",
        format!("\u{feff}{}", model.cameras_txt()),
    );
    check_good(&folder.scene(), &model);
}

#[test]
fn the_larger_of_several_models_is_taken_and_the_others_are_named() {
    let folder = good().folder("sparse/1", false);
    let mut smaller = good();
    smaller.images.truncate(2);
    for place in ["sparse/0", "sparse/2"] {
        folder.write(&format!("{place}/cameras.txt"), smaller.cameras_txt());
        folder.write(&format!("{place}/images.txt"), smaller.images_txt());
    }
    let scene = folder.scene();
    let warning = "`sparse/1` with 5 images is taken; also here and not used: `sparse/0` (2), \
                   `sparse/2` (2)";
    warns(&scene, &[warning]);
    assert!(scene.source.starts_with("sparse/1 "), "{}", scene.source);
    // Of as many, the first.
    folder.write("sparse/0/cameras.txt", good().cameras_txt());
    folder.write("sparse/0/images.txt", good().images_txt());
    folder.write("sparse/0/points3D.ply", GOOD_PLY);
    assert!(folder.scene().source.starts_with("sparse/0 "));
}

#[test]
fn photographs_are_found_where_programs_leave_them() {
    let model = good();
    let write = |place: &str, images: &str| {
        let folder = Folder::empty();
        folder.write(&format!("{place}cameras.txt"), model.cameras_txt());
        folder.write(&format!("{place}images.txt"), model.images_txt());
        folder.write(&format!("{place}points3D.PLY"), GOOD_PLY);
        for (_, _, _, name, _) in &model.images {
            let name = std::str::from_utf8(name).expect("a name");
            folder.write(&format!("{images}{name}"), png(SIZE.0, SIZE.1));
        }
        folder
    };
    for (place, images) in [
        ("dense/0/sparse/", "dense/0/images/"),
        ("dense/sparse/", "dense/images/"),
        ("colmap/sparse/0/", "images/"),
        ("", ""),
        ("", "images/"),
    ] {
        check_good(&write(place, images).scene(), &model);
    }
    let scene = write("sparse/0/", "images_4/").scene();
    warns(
        &scene,
        &["there is no `images`: the photographs are those in `images_4`"],
    );
}

#[test]
fn quaternions_of_another_length_are_normalised_with_a_warning() {
    for binary in [false, true] {
        let mut model = good();
        for value in &mut model.images[2].0 {
            *value *= 3.0;
        }
        let scene = model.folder("sparse", binary).scene();
        warns(&scene, &["1 poses have quaternions"]);
        let camera = &scene
            .test
            .iter()
            .find(|v| v.camera.name == "d.png")
            .expect("d")
            .camera;
        let identity = camera.rotation * camera.rotation.transpose();
        assert!(identity.abs_diff_eq(DMat3::IDENTITY, 1e-14));
    }
}

#[test]
fn image_names_that_leave_the_folder_or_are_none_are_refused() {
    for (name, what) in [
        ("../x.png", "leaves the scene"),
        ("a/../../x.png", "leaves the scene"),
        ("..\\x.png", "leaves the scene"),
        ("/etc/x.png", "leaves the scene"),
        ("\\\\server\\x.png", "leaves the scene"),
        ("C:\\x.png", "leaves the scene"),
        ("a\u{1b}[31m.png", "control characters"),
        ("", "is empty"),
    ] {
        let mut model = good();
        model.images[0].3 = name.as_bytes().to_vec();
        model.fails_with(
            "images.txt: line 2",
            "images.bin: byte 8",
            &["image name", what],
        );
    }
    let mut model = good();
    model.images[0].3 = b"caf\xe9.png".to_vec();
    model
        .folder("0", true)
        .fails_with(&["images.bin: byte 8", "`caf\\xe9.png` is not UTF-8"]);
    model
        .folder("0", false)
        .fails_with(&["images.txt: line 2", "not UTF-8"]);
}

#[test]
fn duplicate_image_names_are_refused() {
    let mut model = good();
    model.images[1].3 = b"c.png".to_vec();
    model.fails_with(
        "images.txt: line 4",
        "images.bin: byte 110",
        &["`c.png`", "appears twice"],
    );
}

#[test]
fn text_models_without_observation_lines_are_refused() {
    let folder = good().folder("sparse", false);
    let text = images_txt(&["a.png", "b.png"]).replace("\n\n", "\n");
    folder.write(
        "sparse/images.txt",
        text.replace("1 a", "4 a").replace("1 b", "4 b"),
    );
    folder.fails_with(&["images.txt: line 2", "two lines an image"]);
}

#[test]
fn every_truncation_of_a_binary_model_is_refused_with_its_byte() {
    let model = good();
    let folder = model.folder("sparse/0", true);
    for (name, bytes) in [
        ("cameras.bin", model.cameras_bin()),
        ("images.bin", model.images_bin()),
    ] {
        for end in 0..bytes.len() {
            folder.write(&format!("sparse/0/{name}"), &bytes[..end]);
            folder.fails_with(&[&format!("{name}: byte"), &format!("ends at byte {end}")]);
        }
        folder.write(&format!("sparse/0/{name}"), bytes);
    }
    check_good(&folder.scene(), &model);
}

#[test]
fn absurd_counts_in_a_binary_model_cost_nothing() {
    let model = good();
    let folder = model.folder("sparse/0", true);
    for (name, bytes) in [
        ("cameras.bin", model.cameras_bin()),
        ("images.bin", model.images_bin()),
    ] {
        for count in [1000u64, 1 << 40, u64::MAX] {
            let mut absurd = bytes.clone();
            absurd[..8].copy_from_slice(&count.to_le_bytes());
            folder.write(&format!("sparse/0/{name}"), absurd);
            folder.fails_with(&[&format!("{name}: byte 0"), &count.to_string(), "at most"]);
        }
        folder.write(&format!("sparse/0/{name}"), bytes);
    }
}
