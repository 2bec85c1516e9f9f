//! Photographs as the network takes them.

use gspotential::camera::Camera;
use gspotential::prior::{Images, prepare};
use gspotential::scene::Image;

use super::{golden, worst};
use crate::reference::npy;

fn photograph(name: &str) -> Image {
    let path = golden(&format!("prep/{name}.png"));
    let image = image::open(&path).expect("decodes").into_rgb8();
    Image {
        width: image.width(),
        height: image.height(),
        rgb: image.into_raw(),
    }
}

fn blank(width: u32, height: u32) -> Image {
    Image {
        width,
        height,
        rgb: vec![0; (width * height * 3) as usize],
    }
}

#[test]
#[ignore = "needs ../shared/prior"]
fn scaled_photographs_are_those_of_the_original() {
    for name in [
        "123x77", "1000x640", "1000x655", "1000x750", "1008x756", "655x1000",
    ] {
        let photograph = photograph(name);
        let ours = prepare(&photograph, 504).image;
        let array = npy::read(&golden(&format!("prep/{name}_u8.npy")));
        assert_eq!(
            array.shape,
            [ours.height as usize, ours.width as usize, 3],
            "{name}"
        );
        let pairs = || ours.rgb.iter().zip(&array.values);
        let off = pairs().filter(|(a, b)| f64::from(**a) != **b).count();
        let most = pairs()
            .map(|(a, b)| (f64::from(*a) - b).abs())
            .fold(0.0, f64::max);
        let share = off as f64 / ours.rgb.len() as f64;
        eprintln!("{name}: {share:.1e} of the values differ, by {most} levels at most");
        assert!(share <= 1e-4 && most <= 1.0, "{name}: {share} {most}");
    }
}

#[test]
#[ignore = "needs ../shared/prior"]
fn the_network_is_fed_what_the_original_is_fed() {
    for name in ["123x77", "1000x750"] {
        let photograph = photograph(name);
        let images = Images::new(&[prepare(&photograph, 504)]).expect("one photograph");
        let right = npy::read(&golden(&format!("prep/{name}_tensor.npy")));
        // One level is 0.0176.
        let off = images.values.iter().zip(&right.values);
        let off = off
            .filter(|(a, b)| (f64::from(**a) - **b).abs() > 1e-6)
            .count();
        assert!(
            off as f64 <= 1e-4 * right.values.len() as f64,
            "{name}: {off}"
        );
    }
}

#[test]
#[ignore = "needs ../shared/prior"]
fn photographs_of_mixed_shapes_are_cropped_to_one() {
    let (a, b) = (photograph("1000x655"), photograph("655x1000"));
    let images = Images::new(&[prepare(&a, 112), prepare(&b, 112)]).expect("two photographs");
    assert_eq!((images.width, images.height), (70, 70));
    let right = npy::read(&golden("prep/mixed_112.npy"));
    assert!(worst(&images.values, &right.values, false) <= 0.018);
    let camera = |w: f64, h: f64| Camera {
        name: String::new(),
        width: w as u32,
        height: h as u32,
        fx: 0.9 * w,
        fy: 0.92 * w,
        cx: w / 2.0 + 1.0,
        cy: h / 2.0 - 2.0,
        rotation: glam::DMat3::IDENTITY,
        translation: glam::DVec3::ZERO,
    };
    let right = [
        [100.8, 98.320_61, 35.112, 34.786_258_7],
        [63.0, 67.491_203, 35.106_868_7, 34.776_001],
    ];
    for (i, (camera, right)) in [camera(1000.0, 655.0), camera(655.0, 1000.0)]
        .iter()
        .zip(right)
        .enumerate()
    {
        let seen = images.camera_of_image(i, camera);
        for (a, b) in [seen.fx, seen.fy, seen.cx, seen.cy].iter().zip(right) {
            assert!((a - b).abs() < 1e-4, "view {i}: {a} {b}");
        }
        let back = images.camera_of_photograph(i, &seen);
        for (a, b) in [
            (back.fx, camera.fx),
            (back.cx, camera.cx),
            (back.cy, camera.cy),
        ] {
            assert!((a - b).abs() < 1e-9, "view {i}: {a} {b}");
        }
        assert_eq!((back.width, back.height), (camera.width, camera.height));
    }
}

#[test]
fn sides_become_whole_patches() {
    for ((w, h), right) in [
        ((640, 480), (504, 378)),
        ((4032, 3024), (504, 378)),
        ((3024, 4032), (378, 504)),
        ((1920, 1080), (504, 280)),
        ((997, 665), (504, 336)),
        ((562, 1000), (280, 504)),
        ((504, 378), (504, 378)),
        ((500, 500), (504, 504)),
        ((505, 379), (504, 378)),
        ((300, 200), (504, 336)),
        ((2000, 100), (504, 28)),
        // The original makes one pixel of this, which its network refuses.
        ((2000, 20), (504, 14)),
        ((1297, 840), (504, 322)),
        ((1238, 822), (504, 336)),
        ((1, 1), (504, 504)),
    ] {
        let image = prepare(&blank(w, h), 504).image;
        assert_eq!((image.width, image.height), right, "{w}x{h}");
    }
}
