//! Distorted cameras: photographs of a known pattern, undistorted on load.

use glam::DVec2;
use gspotential::camera::Camera;
use gspotential::scene::{LoadOptions, View};
use image::{Rgb, RgbImage};

use super::build::{Folder, GOOD_PLY, images_txt, options, png};

const SIZE: (u32, u32) = (120, 90);
const FOCAL: [f64; 2] = [84.0, 88.0];
const PRINCIPAL: [f64; 2] = [57.0, 47.5];

/// The definition of COLMAP's OPENCV model (colmap/sensor/models.h), and of OpenCV.
fn distort([k1, k2, p1, p2]: [f64; 4], p: DVec2) -> DVec2 {
    let (u, v) = (p.x, p.y);
    let (u2, uv, v2) = (u * u, u * v, v * v);
    let r2 = u2 + v2;
    let radial = k1 * r2 + k2 * r2 * r2;
    DVec2::new(
        u + u * radial + 2.0 * p1 * uv + p2 * (r2 + 2.0 * u2),
        v + v * radial + 2.0 * p2 * uv + p1 * (r2 + 2.0 * v2),
    )
}

/// By fixed-point iteration, which has nothing of Newton's method; `None` where the model has
/// folded before it gets there.
fn undistort(coefficients: [f64; 4], goal: DVec2) -> Option<DVec2> {
    let mut p = goal;
    for _ in 0..300 {
        p += 0.5 * (goal - distort(coefficients, p));
    }
    ((distort(coefficients, p) - goal).length() < 1e-12).then_some(p)
}

/// What lies on the plane at depth 1.
fn pattern(p: DVec2) -> [f64; 3] {
    [
        128.0 + 110.0 * (9.0 * p.x + 1.0).sin() * (7.0 * p.y).cos(),
        128.0 + 110.0 * (8.0 * p.y - 4.0 * p.x).sin(),
        100.0 + 90.0 * p.x - 60.0 * p.y,
    ]
}

fn photograph(coefficients: [f64; 4]) -> Vec<u8> {
    let image = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let distorted = DVec2::new(
            (f64::from(x) + 0.5 - PRINCIPAL[0]) / FOCAL[0],
            (f64::from(y) + 0.5 - PRINCIPAL[1]) / FOCAL[1],
        );
        let seen = undistort(coefficients, distorted).map(pattern);
        Rgb(seen.unwrap_or([255.0, 0.0, 255.0]).map(|v| v.round() as u8))
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a PNG");
    bytes.into_inner()
}

/// A scene of one photograph by a camera of this model.
fn folder(model: &str, params: &[f64], photograph: &[u8]) -> Folder {
    let folder = Folder::empty();
    let params: Vec<String> = params.iter().map(f64::to_string).collect();
    let camera = format!("1 {model} {} {} {}\n", SIZE.0, SIZE.1, params.join(" "));
    folder.write("sparse/0/cameras.txt", camera);
    folder.write("sparse/0/images.txt", images_txt(&["a.png"]));
    folder.write("sparse/0/points3D.ply", GOOD_PLY);
    folder.write("images/a.png", photograph);
    folder
}

fn opencv([k1, k2, p1, p2]: [f64; 4]) -> Vec<f64> {
    let ([fx, fy], [cx, cy]) = (FOCAL, PRINCIPAL);
    vec![fx, fy, cx, cy, k1, k2, p1, p2]
}

fn ray(camera: &Camera, u: f64, v: f64) -> DVec2 {
    DVec2::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
}

/// Mean and greatest difference of the image from what its camera should see.
fn errors(view: &View) -> (f64, f64) {
    let camera = &view.camera;
    assert_eq!(
        (view.image.width, view.image.height),
        (camera.width, camera.height)
    );
    let (mut sum, mut greatest) = (0.0, 0.0f64);
    for (i, pixel) in view.image.rgb.chunks_exact(3).enumerate() {
        let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
        let seen = pattern(ray(camera, f64::from(x) + 0.5, f64::from(y) + 0.5));
        for (a, b) in pixel.iter().zip(seen) {
            let error = (f64::from(*a) - b.clamp(0.0, 255.0)).abs();
            sum += error;
            greatest = greatest.max(error);
        }
    }
    (sum / view.image.rgb.len() as f64, greatest)
}

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
    // Where the borders bulge outwards, their middles bound the image: nothing can be added.
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

type Bend = fn(&[f64], DVec2) -> DVec2;

/// COLMAP's definitions (colmap/sensor/models.h), by the parameters behind the principal point.
fn full_opencv(k: &[f64], p: DVec2) -> DVec2 {
    let r2 = p.length_squared();
    let above = 1.0 + k[0] * r2 + k[1] * r2.powi(2) + k[4] * r2.powi(3);
    let below = 1.0 + k[5] * r2 + k[6] * r2.powi(2) + k[7] * r2.powi(3);
    let uv = p.x * p.y;
    p * (above / below)
        + DVec2::new(
            2.0 * k[2] * uv + k[3] * (r2 + 2.0 * p.x * p.x),
            2.0 * k[3] * uv + k[2] * (r2 + 2.0 * p.y * p.y),
        )
}

fn opencv_fisheye(k: &[f64], p: DVec2) -> DVec2 {
    let theta = p.length().atan();
    let t2 = theta * theta;
    let bent =
        theta * (1.0 + k[0] * t2 + k[1] * t2.powi(2) + k[2] * t2.powi(3) + k[3] * t2.powi(4));
    p.normalize_or_zero() * bent
}

fn thin_prism_fisheye(k: &[f64], p: DVec2) -> DVec2 {
    let q = p.normalize_or_zero() * p.length().atan();
    let (r2, uv) = (q.length_squared(), q.x * q.y);
    let radial = k[0] * r2 + k[1] * r2.powi(2) + k[4] * r2.powi(3) + k[5] * r2.powi(4);
    q + q * radial
        + DVec2::new(
            2.0 * k[2] * uv + k[3] * (r2 + 2.0 * q.x * q.x) + k[6] * r2,
            2.0 * k[3] * uv + k[2] * (r2 + 2.0 * q.y * q.y) + k[7] * r2,
        )
}

/// What a lens that is defined by where rays go shows of the pattern.
fn seen_through(bend: Bend, k: &[f64], focal: f64) -> Vec<u8> {
    let image = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let goal = DVec2::new(
            (f64::from(x) + 0.5 - PRINCIPAL[0]) / focal,
            (f64::from(y) + 0.5 - PRINCIPAL[1]) / focal,
        );
        let mut p = goal;
        for _ in 0..4000 {
            p += 0.5 * (goal - bend(k, p));
        }
        let known = (bend(k, p) - goal).length() < 1e-9;
        let seen = if known {
            pattern(p)
        } else {
            [255.0, 0.0, 255.0]
        };
        Rgb(seen.map(|v| v.round() as u8))
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a PNG");
    bytes.into_inner()
}

/// A model, its definition, its coefficients, and the focal length.
type Lens = (&'static str, Bend, &'static [f64], f64);

const OTHERS: [Lens; 5] = [
    (
        "FULL_OPENCV",
        full_opencv,
        &[0.1, -0.05, 0.004, -0.006, 0.01, 0.02, -0.01, 0.003],
        84.0,
    ),
    (
        "OPENCV_FISHEYE",
        opencv_fisheye,
        &[0.02, -0.01, 0.003, -0.001],
        60.0,
    ),
    ("OPENCV_FISHEYE", opencv_fisheye, &[0.0; 4], 40.0),
    ("THIN_PRISM_FISHEYE", thin_prism_fisheye, &[0.0; 8], 60.0),
    (
        "THIN_PRISM_FISHEYE",
        thin_prism_fisheye,
        &[0.03, -0.01, 0.004, -0.003, 0.002, 0.001, 0.005, -0.004],
        60.0,
    ),
];

#[test]
fn rational_and_fisheye_lenses_are_undone_by_their_definitions() {
    for (model, bend, k, focal) in OTHERS {
        let photograph = seen_through(bend, k, focal);
        let params = [&[focal, focal, PRINCIPAL[0], PRINCIPAL[1]], k].concat();
        let scene = folder(model, &params, &photograph).scene();
        let view = &scene.train[0];
        let (mean, greatest) = errors(view);
        eprintln!(
            "{model} {k:?}: mean {mean:.3}, greatest {greatest:.2}, {:?}",
            scene.warnings
        );
        assert!(
            mean < 1.5 && greatest < 25.0,
            "{model} {k:?}: {mean} {greatest}"
        );
        // Another lens is seen.
        for i in 0..k.len() {
            let mut wrong = params.clone();
            wrong[4 + i] += if i < 2 { 0.1 } else { 0.3 };
            if let Ok(scene) = folder(model, &wrong, &photograph).load() {
                let (other, _) = errors(&scene.train[0]);
                assert!(
                    other > 1.5 * mean.max(0.5),
                    "{model}, coefficient {i}: {other} {mean}"
                );
            }
        }
        let camera = &view.camera;
        assert_eq!([camera.fx, camera.fy], [focal, focal]);
        let is_fisheye = model.ends_with("FISHEYE");
        let told = scene
            .warnings
            .iter()
            .any(|w| w.contains("fisheye photographs became pinhole"));
        assert_eq!(told, is_fisheye, "{:?}", scene.warnings);
        if is_fisheye {
            // 55 degrees to each side at most.
            let bound = focal * 55.0_f64.to_radians().tan() + 1.0;
            let sides = [camera.cx, f64::from(camera.width) - camera.cx, camera.cy];
            assert!(sides.iter().all(|side| *side <= bound), "{camera:?}");
        }
    }
}

#[test]
fn models_with_zeros_are_their_simpler_selves() {
    let f = FOCAL[0];
    let [cx, cy] = PRINCIPAL;
    let k = [-0.1, 0.02, 0.001, -0.002];
    let photograph = photograph(k);
    let zeros = |params: &[f64], n: usize| [params, &vec![0.0; n]].concat();
    for (model, params, simple, same) in [
        (
            "FULL_OPENCV",
            zeros(&opencv([0.0; 4]), 4),
            "PINHOLE",
            opencv([0.0; 4])[..4].to_vec(),
        ),
        ("FULL_OPENCV", zeros(&opencv(k), 4), "OPENCV", opencv(k)),
        (
            "SIMPLE_RADIAL_FISHEYE",
            vec![f, cx, cy, 0.0],
            "OPENCV_FISHEYE",
            zeros(&[f, f, cx, cy], 4),
        ),
        (
            "RADIAL_FISHEYE",
            vec![f, cx, cy, 0.01, 0.0],
            "OPENCV_FISHEYE",
            vec![f, f, cx, cy, 0.01, 0.0, 0.0, 0.0],
        ),
        (
            "FISHEYE",
            vec![f, f, cx, cy],
            "SIMPLE_FISHEYE",
            vec![f, cx, cy],
        ),
        (
            "THIN_PRISM_FISHEYE",
            zeros(&[f, f, cx, cy], 8),
            "OPENCV_FISHEYE",
            zeros(&[f, f, cx, cy], 4),
        ),
    ] {
        let a = folder(model, &params, &photograph).scene();
        let b = folder(simple, &same, &photograph).scene();
        assert_eq!(a.train[0].camera, b.train[0].camera, "{model}");
        assert_eq!(a.train[0].image, b.train[0].image, "{model}");
        assert_eq!(a.warnings, b.warnings, "{model}");
    }
}
