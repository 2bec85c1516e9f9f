//! Photographs: matching, sizes, damage.

use super::build::{Folder, SIZE, encoded, fails_with, options, picture, png, warns};
use gspotential::error::ErrorKind;
use gspotential::scene::LoadOptions;
use image::ImageFormat;

const NAMES: [&str; 4] = ["a.png", "b.png", "c.png", "d.png"];

#[test]
fn pixels_arrive_as_stored() {
    let scene = Folder::with_views(&NAMES).scene();
    warns(&scene, &[]);
    let image = &scene.train[0].image;
    assert_eq!((image.width, image.height), SIZE);
    assert_eq!(image.rgb, picture(SIZE.0, SIZE.1).into_raw());
    assert_ne!(image.rgb, picture(SIZE.0, SIZE.1 + 1).into_raw());
}

#[test]
fn images_are_matched_by_stem_where_only_the_suffix_differs() {
    let folder = Folder::with_views(&NAMES);
    folder.remove("images/b.png");
    folder.write("images/b.JPG", encoded(SIZE.0, SIZE.1, ImageFormat::Jpeg));
    let scene = folder.scene();
    warns(
        &scene,
        &[
            "1 images taken by their stem as their suffix differs from the pose's: `b.JPG` for `b.png`",
        ],
    );
    assert_eq!(scene.train[1].camera.name, "b.JPG");
    assert_eq!(scene.train[1].camera.center().x, 1.0);
    // The model's name for it names it too.
    let by_model_name = LoadOptions {
        train_views: Some(vec!["b.png".to_owned()]),
        ..options()
    };
    let scene = folder.load_with(&by_model_name).expect("a scene");
    assert_eq!(scene.train[0].camera.name, "b.JPG");
    // Two candidates are one too many.
    folder.write("images/b.jpeg", encoded(SIZE.0, SIZE.1, ImageFormat::Jpeg));
    let scene = folder.scene();
    assert_eq!(scene.train.len(), 3);
    warns(
        &scene,
        &["1 poses have no image", "2 images have no pose", "only 3"],
    );
}

#[test]
fn an_image_with_its_own_pose_is_not_taken_for_another() {
    let folder = Folder::with_views(&["a.png", "a.jpg", "b.png", "c.png"]);
    folder.remove("images/a.png");
    let scene = folder.scene();
    warns(
        &scene,
        &["1 poses have no image and are not used: `a.png`", "only 3"],
    );
    assert!(
        scene
            .train
            .iter()
            .any(|v| v.camera.name == "a.jpg" && v.camera.center().x == 1.0)
    );
}

#[test]
fn poses_and_images_without_each_other_are_counted() {
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png", "e.png", "f.png"]);
    folder.remove("images/b.png");
    folder.remove("images/e.png");
    folder.write("images/x.png", png(3, 3));
    folder.write("images/thumbs.db", "not a photograph");
    let scene = folder.scene();
    warns(
        &scene,
        &[
            "2 poses have no image and are not used: `b.png`, ...",
            "1 images have no pose and are not used: `x.png`",
        ],
    );
    assert_eq!(scene.train.len(), 4);
}

#[test]
fn damaged_images_are_named() {
    let good = png(SIZE.0, SIZE.1);
    let mut zero_width = good.clone();
    zero_width[16..20].fill(0);
    let cases: [(&[u8], &str); 5] = [
        (b"", "empty"),
        (b"hello", "neither a PNG nor a JPEG"),
        (b"GIF89a\x01\x00\x01\x00", "neither a PNG nor a JPEG"),
        (&good[..good.len() - 40], "cannot decode"),
        (&zero_width, "image"),
    ];
    for (bytes, part) in cases {
        let folder = Folder::with_views(&NAMES);
        folder.write("images/c.png", bytes);
        folder.fails_with(&["images/c.png: ", part, "; "]);
    }
}

#[test]
fn only_chosen_views_are_decoded() {
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png", "e.png"]);
    folder.write("images/b.png", "damaged");
    folder.write(
        "split.json",
        r#"{"train": ["a.png", "c.png"], "test": ["d.png"]}"#,
    );
    assert_eq!(folder.scene().train.len(), 2);
    folder.write(
        "split.json",
        r#"{"train": ["a.png", "c.png"], "test": ["b.png"]}"#,
    );
    folder.fails_with(&["images/b.png"]);
}

/// A PNG of [`SIZE`] whose header, with a valid checksum, claims another size.
fn claiming(width: u32, height: u32) -> Vec<u8> {
    let mut bomb = b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR".to_vec();
    bomb.extend(width.to_be_bytes());
    bomb.extend(height.to_be_bytes());
    bomb.extend([8, 2, 0, 0, 0]);
    let crc = crc32(&bomb[12..]);
    bomb.extend(crc.to_be_bytes());
    bomb.extend(&png(8, 8)[33..]);
    bomb
}

#[test]
fn image_bombs_are_refused_before_they_are_decoded() {
    let folder = Folder::with_views(&NAMES);
    // Both have the aspect of the cameras.
    folder.write("images/a.png", claiming(60_000, 40_000));
    folder.fails_with(&["images/a.png", "16384 pixels a side"]);
    // Within the limits, but 288 MB of pixels are not in 200 bytes.
    folder.write("images/a.png", claiming(12_000, 8_000));
    folder.fails_with(&["images/a.png", "12000x8000", "cannot hold"]);
}

#[test]
fn a_small_file_may_be_a_large_image_of_one_colour() {
    let folder = Folder::with_views(&NAMES);
    let flat = image::GrayImage::new(1500, 1000);
    let mut bytes = std::io::Cursor::new(Vec::new());
    flat.write_to(&mut bytes, ImageFormat::Png).expect("a PNG");
    let bytes = bytes.into_inner();
    assert!(bytes.len() < 20_000, "{}", bytes.len());
    folder.write("images/a.png", bytes);
    folder.scene();
}

fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| {
        if crc & 1 == 1 {
            crc >> 1 ^ 0xedb8_8320
        } else {
            crc >> 1
        }
    };
    !bytes
        .iter()
        .fold(!0u32, |crc, &b| (0..8).fold(crc ^ u32::from(b), step))
}

#[test]
fn images_at_another_resolution_rescale_their_camera() {
    for (width, height) in [(24, 16), (36, 25), (6, 4), (3, 2)] {
        let folder = Folder::with_views(&NAMES);
        folder.write("images/b.png", png(width, height));
        let scene = folder.scene();
        warns(
            &scene,
            &["1 images are not of their camera's size, intrinsics rescaled: `b.png`, camera 12x8"],
        );
        let camera = &scene.train[1].camera;
        assert_eq!((camera.width, camera.height), (width, height));
        assert!((camera.fx - 10.0 * f64::from(width) / 12.0).abs() < 1e-12);
        assert!((camera.cy - 3.5 * f64::from(height) / 8.0).abs() < 1e-12);
    }
}

#[test]
fn images_of_another_shape_are_refused_with_both_sizes() {
    for (width, height, part) in [
        (12, 10, "the same at another resolution"),
        (24, 8, "the same at another resolution"),
        (8, 12, "stored sideways"),
    ] {
        let folder = Folder::with_views(&NAMES);
        folder.write("images/b.png", png(width, height));
        folder.fails_with(&["images/b.png", &format!("{width}x{height}"), "12x8", part]);
    }
}

#[test]
fn sizes_are_bounded_and_intrinsics_follow() {
    let folder = Folder::with_views(&NAMES);
    let cases = [
        (1600, None, (12, 8)),
        (12, None, (12, 8)),
        (6, None, (6, 4)),
        (5, None, (5, 3)),
        (1600, Some(7), (7, 5)),
        (2, Some(9), (9, 6)),
        (1600, Some(1), (1, 1)),
        (1600, Some(100), (12, 8)),
    ];
    for (max_width, max_size, expected) in cases {
        let limits = LoadOptions {
            max_width,
            max_size,
            ..options()
        };
        let scene = folder.load_with(&limits).expect("a scene");
        for view in &scene.train {
            let camera = &view.camera;
            assert_eq!((camera.width, camera.height), expected);
            assert_eq!((view.image.width, view.image.height), expected);
            assert_eq!(view.image.rgb.len() as u32, 3 * expected.0 * expected.1);
            assert!((camera.fx - 10.0 * f64::from(expected.0) / 12.0).abs() < 1e-12);
            assert!((camera.fy - 11.0 * f64::from(expected.1) / 8.0).abs() < 1e-12);
        }
    }
}

#[test]
fn portrait_images_are_bounded_by_their_height() {
    let folder = Folder::with_views(&NAMES);
    folder.write("sparse/0/cameras.txt", "1 PINHOLE 8 12 10 11 4 6\n");
    for name in NAMES {
        folder.write(&format!("images/{name}"), png(8, 12));
    }
    let limits = LoadOptions {
        max_size: Some(6),
        ..options()
    };
    let camera = &folder.load_with(&limits).expect("a scene").train[0].camera;
    assert_eq!((camera.width, camera.height), (4, 6));
}

#[test]
fn scaling_keeps_the_mean_colour() {
    let folder = Folder::with_views(&NAMES);
    let mean = |rgb: &[u8]| rgb.iter().map(|&b| f64::from(b)).sum::<f64>() / rgb.len() as f64;
    folder.write("sparse/0/cameras.txt", "1 PINHOLE 15 10 10 11 6 4\n");
    for name in NAMES {
        folder.write(&format!("images/{name}"), png(15, 10));
    }
    let limits = LoadOptions {
        max_size: Some(5),
        ..options()
    };
    let small = &folder.load_with(&limits).expect("a scene").train[0].image;
    let full = mean(&picture(15, 10).into_raw());
    assert!(
        (mean(&small.rgb) - full).abs() < 2.0,
        "{} {full}",
        mean(&small.rgb)
    );
}

#[test]
fn zero_sizes_are_usage_errors() {
    let folder = Folder::with_views(&NAMES);
    for (max_width, max_size) in [(0, None), (1600, Some(0))] {
        let limits = LoadOptions {
            max_width,
            max_size,
            ..options()
        };
        fails_with(folder.load_with(&limits), ErrorKind::Usage, &["0 pixels"]);
    }
}

#[test]
fn a_damaged_jpeg_is_an_error_of_one_line() {
    let folder = Folder::with_views(&NAMES);
    // Its decoder's message ends in a line break.
    folder.write("images/a.png", b"\xff\xd8\xff\xd8\xff\xd9");
    folder.fails_with(&["images/a.png", "cannot decode"]);
}
