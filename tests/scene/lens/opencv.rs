//! The radial and tangential models, up to OPENCV.

use super::*;

/// Barrel (with corners that no ray reaches), pincushion, mustache, with and without tangential
/// parts, and next to nothing.
const LENSES: [[f64; 4]; 6] = [
    [-0.2, 0.0, 0.0, 0.0],
    [0.15, 0.0, 0.0, 0.0],
    [-0.25, 0.12, 0.0, 0.0],
    [0.08, -0.05, 0.01, -0.015],
    [-0.1, 0.02, -0.02, 0.01],
    [1e-9, 0.0, 0.0, 0.0],
];

#[test]
fn undistorted_images_show_what_a_pinhole_camera_sees() {
    for lens in LENSES {
        let scene = folder("OPENCV", &opencv(lens), &photograph(lens)).scene();
        assert!(
            scene.source.contains(", 1 images undistorted, "),
            "{}",
            scene.source
        );
        let (mean, greatest) = errors(&scene.train[0]);
        eprintln!("{lens:?}: mean {mean:.3}, greatest {greatest:.2} of 255");
        assert!(mean < 0.35 && greatest < 2.5, "{lens:?}: {mean} {greatest}");
        let camera = &scene.train[0].camera;
        assert_eq!([camera.fx, camera.fy], FOCAL);
    }
}

#[test]
fn a_wrong_lens_is_seen_in_the_pattern() {
    let lens = [-0.05, 0.06, 0.01, -0.015];
    let photograph = photograph(lens);
    for i in 0..4 {
        let mut wrong = lens;
        wrong[i] = -wrong[i];
        let scene = folder("OPENCV", &opencv(wrong), &photograph).scene();
        let (mean, greatest) = errors(&scene.train[0]);
        assert!(mean > 1.0 && greatest > 8.0, "{wrong:?}: {mean} {greatest}");
    }
    // So is a lens that is not undistorted at all.
    let scene = folder("PINHOLE", &opencv(lens)[..4], &photograph).scene();
    assert!(errors(&scene.train[0]).1 > 8.0);
}

#[test]
fn every_radial_model_is_the_opencv_one_with_zeros() {
    let f = FOCAL[0];
    let [cx, cy] = PRINCIPAL;
    for (model, params, full) in [
        (
            "SIMPLE_RADIAL",
            vec![f, cx, cy, -0.2],
            vec![f, f, cx, cy, -0.2, 0.0, 0.0, 0.0],
        ),
        (
            "RADIAL",
            vec![f, cx, cy, -0.2, 0.07],
            vec![f, f, cx, cy, -0.2, 0.07, 0.0, 0.0],
        ),
    ] {
        let photograph = photograph([-0.1, 0.0, 0.0, 0.0]);
        let a = folder(model, &params, &photograph).scene();
        let b = folder("OPENCV", &full, &photograph).scene();
        assert_eq!(a.train[0].camera, b.train[0].camera, "{model}");
        assert_eq!(a.train[0].image, b.train[0].image, "{model}");
    }
    // A lens without distortion leaves every bit as it is.
    let photograph = png(SIZE.0, SIZE.1);
    let plain = folder("OPENCV", &opencv([0.0; 4]), &photograph).scene();
    let pinhole = folder("PINHOLE", &opencv([0.0; 4])[..4], &photograph).scene();
    assert_eq!(plain.train[0].camera, pinhole.train[0].camera);
    assert_eq!(plain.train[0].image, pinhole.train[0].image);
    assert_eq!(plain.source, pinhole.source);
}

/// The largest overshoot, in pixels, of the image's border beyond the photograph, with the image
/// made larger by `margin` pixels at one side (0 left, 1 right, 2 top, 3 bottom).
fn overshoot(camera: &Camera, lens: [f64; 4], side: usize, margin: f64) -> f64 {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let mut sides = [0.0, w, 0.0, h];
    sides[side] += if side.is_multiple_of(2) {
        -margin
    } else {
        margin
    };
    let [left, right, top, bottom] = sides;
    let mut greatest = f64::NEG_INFINITY;
    for i in 0..=500 {
        let t = f64::from(i) / 500.0;
        let (u, v) = (left + t * (right - left), top + t * (bottom - top));
        for (u, v) in [(left, v), (right, v), (u, top), (u, bottom)] {
            let d = distort(lens, ray(camera, u, v));
            let seen = d * DVec2::from(FOCAL) + DVec2::from(PRINCIPAL);
            let size = DVec2::new(f64::from(SIZE.0), f64::from(SIZE.1));
            greatest = greatest.max((-seen).max(seen - size).max_element());
        }
    }
    greatest
}

#[test]
fn the_pinhole_image_is_the_largest_that_was_photographed() {
    for lens in LENSES {
        let scene = folder("OPENCV", &opencv(lens), &photograph(lens)).scene();
        let camera = &scene.train[0].camera;
        let inside = overshoot(camera, lens, 0, 0.0);
        assert!(inside < 0.02, "{lens:?}: {inside} px beyond the photograph");
    }
    // If the borders bulge outwards, their middles bound the image: nothing can be added.
    for lens in [
        [-0.2, 0.0, 0.0, 0.0],
        [-0.25, 0.12, 0.0, 0.0],
        [1e-9, 0.0, 0.0, 0.0],
    ] {
        let scene = folder("OPENCV", &opencv(lens), &photograph(lens)).scene();
        for side in 0..4 {
            let beyond = overshoot(&scene.train[0].camera, lens, side, 1.5);
            assert!(beyond > 0.3, "{lens:?}: side {side} has room, {beyond}");
        }
    }
}

#[test]
fn undistorted_images_are_scaled_like_others() {
    let lens = [-0.2, 0.0, 0.0, 0.0];
    let folder = folder("OPENCV", &opencv(lens), &photograph(lens));
    let full = folder.scene().train[0].camera.clone();
    let small = LoadOptions {
        max_size: Some(60),
        ..options()
    };
    let scene = folder.load_with(&small).expect("a scene");
    let camera = &scene.train[0].camera;
    assert_eq!(camera.width.max(camera.height), 60);
    let scale = f64::from(camera.width) / f64::from(full.width);
    assert!((camera.fx - scale * full.fx).abs() < 1e-9);
    assert!((camera.cx - scale * full.cx).abs() < 1e-9);
    assert!(errors(&scene.train[0]).0 < 3.0);

    // A photograph at half the size of its camera has the lens of the whole.
    let twice: Vec<String> = opencv(lens)
        .iter()
        .enumerate()
        .map(|(i, v)| if i < 4 { 2.0 * v } else { *v }.to_string())
        .collect();
    let camera = format!("1 OPENCV 240 180 {}\n", twice.join(" "));
    folder.write("sparse/0/cameras.txt", camera);
    let scene = folder.scene();
    assert_eq!(scene.train[0].camera, full);
    assert!(errors(&scene.train[0]).0 < 0.35);
}

#[test]
fn lenses_that_cannot_be_undone_are_refused() {
    let photograph = png(SIZE.0, SIZE.1);
    for (lens, what) in [
        ([-3.0, 0.0, 0.0, 0.0], "folds the image"),
        ([-1.0, 0.3, 0.0, 0.0], "folds the image"),
        ([-1e300, 0.0, 0.0, 0.0], "folds the image"),
        ([1e300, 1e300, 0.0, 0.0], "folds the image"),
        ([0.0, 0.0, 5.0, 0.0], "folds the image"),
        ([1e4, 0.0, 0.0, 0.0], "less than a fifth of the width"),
    ] {
        folder("OPENCV", &opencv(lens), &photograph).fails_with(&[
            "images/a.png: the distortion",
            what,
            "image_undistorter",
        ]);
    }
    for bad in ["nan", "inf", "-inf"] {
        let folder = folder("OPENCV", &opencv([0.0; 4]), &photograph);
        let camera = format!("1 RADIAL 120 90 80 60 45 0.1 {bad}\n");
        folder.write("sparse/0/cameras.txt", camera);
        folder.fails_with(&["cameras.txt: line 1: camera 1", "is not finite"]);
    }
    let mut few = opencv([0.1; 4]);
    few.pop();
    folder("OPENCV", &few, &photograph).fails_with(&["OPENCV has 8 parameters, found 7"]);
}

#[test]
fn masks_are_undistorted_with_their_photographs() {
    // Set where the pattern's plane is right of x = 0.1: a straight line once it is undistorted.
    let lens = [-0.1, 0.02, -0.02, 0.01];
    for scale in [1u32, 2] {
        let mask = image::GrayImage::from_fn(SIZE.0 * scale, SIZE.1 * scale, |x, y| {
            let at = |p: u32, i: usize| {
                ((f64::from(p) + 0.5) / f64::from(scale) - PRINCIPAL[i]) / FOCAL[i]
            };
            let seen = undistort(lens, DVec2::new(at(x, 0), at(y, 1))).expect("a ray");
            image::Luma([if seen.x > 0.1 { 255 } else { 0 }])
        });
        let mut bytes = std::io::Cursor::new(Vec::new());
        mask.write_to(&mut bytes, image::ImageFormat::Png)
            .expect("a PNG");
        let folder = folder("OPENCV", &opencv(lens), &photograph(lens));
        folder.write("masks/a.png.png", bytes.into_inner());
        let view = &folder.scene().train[0];
        let camera = &view.camera;
        let mask = &view.mask.as_ref().expect("a mask").set;
        assert_eq!(mask.len(), view.image.rgb.len() / 3);
        for (i, set) in mask.iter().enumerate() {
            let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
            let seen = ray(camera, f64::from(x) + 0.5, f64::from(y) + 0.5);
            // Within a pixel of the line either is right.
            if (seen.x - 0.1).abs() * camera.fx > 1.0 {
                assert_eq!(*set, seen.x > 0.1, "{x} {y}");
            }
        }
    }
}
