//! Models that are read, with a warning or without.

use super::*;

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
fn images_without_a_finite_pose_or_camera_are_left_out_and_counted() {
    type Change = fn(&mut Model);
    let changes: [(Change, &str, usize); 5] = [
        (
            |model| model.images[0].0[1] = f64::NAN,
            "1 images have a pose that is not finite",
            4,
        ),
        (|model| model.images[0].0 = [0.0; 4], "no rotation", 4),
        (|model| model.images[0].1[2] = f64::INFINITY, "`c.png`", 4),
        (
            |model| model.cameras[0].3[1] = f64::NAN,
            "3 images have a pose that",
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
    // The first is taken if both have as many.
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
        ("sparse/0/", "Images/"),
        ("sparse/3/", "IMAGES/"),
        ("colmap/sparse/1/", "images/"),
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
