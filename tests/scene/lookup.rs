//! Names of photographs, as people and programs write them; formats of photographs.

use gspotential::scene::{LoadOptions, Scene};
use image::ImageFormat;

use super::build::{Folder, GOOD_PLY, SIZE, encoded, images_txt, options, picture, png, warns};

/// Poses under these names, and photographs under those.
fn folder(poses: &[&str], files: &[&str]) -> Folder {
    let folder = Folder::with_views(&[]);
    folder.write("sparse/0/images.txt", images_txt(poses));
    folder.write("sparse/0/points3D.ply", GOOD_PLY);
    std::fs::create_dir_all(folder.path().join("images")).expect("a folder");
    for file in files {
        folder.write(&format!("images/{file}"), png(SIZE.0, SIZE.1));
    }
    folder
}

/// The photograph of each pose, by the place that the pose has.
fn found(scene: &Scene) -> Vec<(usize, String)> {
    let views = scene.train.iter().chain(&scene.test);
    let place = |x: f64| x.round() as usize;
    let mut found: Vec<_> = views
        .map(|view| (place(view.camera.center().x), view.camera.name.clone()))
        .collect();
    found.sort();
    found
}

#[test]
fn names_lead_to_the_photographs_that_people_mean() {
    let spelt = "1 images taken though their name is spelt differently";
    let by_stem = "1 images taken by their stem";
    let by_tail = "1 images taken by the last parts";
    for (pose, file, warning) in [
        ("left/a.png", "left/a.png", None),
        ("left\\a.png", "left/a.png", None),
        ("./a.png", "a.png", None),
        ("img_1.jpg", "IMG_1.JPG", Some(spelt)),
        ("Left/a.png", "left/A.png", Some(spelt)),
        ("K\u{fc}che.png", "Ku\u{308}che.png", Some(spelt)),
        ("Ku\u{308}che.PNG", "k\u{fc}che.png", Some(spelt)),
        ("a.jpg", "a.png", Some(by_stem)),
        ("a", "a.png", Some(by_stem)),
        ("A", "a.WebP", Some(by_stem)),
        ("b 1.2 (3).v1", "b 1.2 (3).v1.png", Some(by_stem)),
        ("b.v1.jpg", "b.v1.png", Some(by_stem)),
        ("a.jpg", "a.jpg.png", Some(by_stem)),
        ("a.heic", "a.jpg", Some(by_stem)),
        ("images/a.png", "a.png", Some(by_tail)),
        ("some/where\\left/a.jpg", "left/a.png", Some(by_tail)),
    ] {
        let scene = folder(&[pose, "z.png"], &[file, "z.png"]).scene();
        let expected = vec![(0, file.to_owned()), (1, "z.png".to_owned())];
        assert_eq!(found(&scene), expected, "{pose}");
        let warnings: Vec<&str> = warning.into_iter().chain(["only 2"]).collect();
        warns(&scene, &warnings);
        // The pose's name is one for the view, too.
        let by_pose = LoadOptions {
            train_views: Some(vec![pose.to_owned()]),
            ..options()
        };
        let folder = folder(&[pose, "z.png"], &[file, "z.png"]);
        let scene = folder.load_with(&by_pose).expect("a scene");
        assert_eq!(scene.train[0].camera.name, file);
    }
}

#[test]
fn what_could_be_meant_by_several_is_nobodys() {
    for (poses, files) in [
        // Two files for a pose, two poses for a file, and one that is another's own.
        (["a.jpg", "z.png"], ["a.png", "a.bmp"]),
        (["a.jpg", "a.bmp"], ["a.png", "z.png"]),
        (["a.jpg", "a.png"], ["a.png", "b.png"]),
        (["A.PNG", "aa.png"], ["a.png", "a.PNG"]),
        // A suffix that is none is part of the name, and other folders are others.
        (["a.v1", "z.png"], ["a.v2.png", "a.png"]),
        (["left/a.png", "z.png"], ["right/a.png", "y.png"]),
    ] {
        let folder = folder(
            &[poses[0], poses[1], "own.png"],
            &[files[0], files[1], "own.png"],
        );
        let scene = folder.scene();
        let found = found(&scene);
        assert!(
            !found.iter().any(|(place, _)| *place == 0),
            "{poses:?}: {found:?}"
        );
        assert!(found.contains(&(2, "own.png".to_owned())));
    }
}

#[cfg(unix)]
#[test]
fn links_to_folders_are_followed_and_circles_end() {
    use std::os::unix::fs::symlink;
    let folder = folder(&["cam/a.png", "b.png"], &["b.png"]);
    folder.write("store/a.png", png(SIZE.0, SIZE.1));
    folder.write("store/c.png", png(SIZE.0, SIZE.1));
    let images = folder.path().join("images");
    symlink("../store", images.join("cam")).expect("a link");
    symlink("..", images.join("round")).expect("a link");
    symlink(".", folder.path().join("store/again")).expect("a link");
    let scene = folder.scene();
    let expected = vec![(0, "cam/a.png".to_owned()), (1, "b.png".to_owned())];
    assert_eq!(found(&scene), expected);
    assert!(scene.warnings[0].contains("images have no pose"));
}

#[test]
fn formats_are_told_by_content_and_pixels_arrive_as_stored() {
    use ImageFormat::{Bmp, Png, WebP};
    for (format, suffix) in [(WebP, "webp"), (Bmp, "bmp"), (Png, "jpg")] {
        for suffix in [suffix, "png"] {
            let name = format!("a.{suffix}");
            let folder = folder(&[&name, "z.png"], &["z.png"]);
            folder.write(&format!("images/{name}"), encoded(SIZE.0, SIZE.1, format));
            let scene = folder.scene();
            assert_eq!(scene.train.len(), 2, "{name}");
            assert_eq!(scene.train[0].image.rgb, picture(SIZE.0, SIZE.1).into_raw());
        }
    }
}

#[test]
fn photographs_that_are_not_read_are_named() {
    let heic = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic";
    let folder = folder(&["a.jpg", "b.jpg"], &[]);
    folder.write("images/a.HEIC", heic);
    folder.write("images/b.NEF", "raw");
    folder.fails_with(&[
        "2 lie there in formats that are not read",
        "`a.HEIC`",
        "convert",
    ]);
    folder.write("images/b.jpg", png(SIZE.0, SIZE.1));
    let warnings = folder.scene().warnings;
    let told = warnings
        .iter()
        .any(|w| w.starts_with("2 photographs are in formats"));
    assert!(told, "{warnings:?}");
    folder.write("images/a.jpg", heic);
    folder.fails_with(&["images/a.jpg", "but a HEIC", "convert it"]);
}

#[test]
fn names_may_hold_commas_on_the_command_line() {
    let names = ["k, 0.png", "k, 1.png", "k, 2.png", "3.png", "k.png"];
    let folder = folder(&names, &names);
    // As a list is parted.
    let pieces = |list: &str| Some(list.split(',').map(str::to_owned).collect());
    let options = LoadOptions {
        train_views: pieces("k, 1.png,3.png,k, 0.png"),
        test_views: pieces("k.png,k, 2.png"),
        ..options()
    };
    let scene = folder.load_with(&options).expect("a scene");
    let names = |views: &[gspotential::scene::View]| -> Vec<String> {
        views.iter().map(|v| v.camera.name.clone()).collect()
    };
    assert_eq!(names(&scene.train), ["k, 1.png", "3.png", "k, 0.png"]);
    assert_eq!(names(&scene.test), ["k.png", "k, 2.png"]);
}

#[test]
fn small_files_that_tell_of_large_images_are_refused_in_every_format() {
    let folder = folder(&["a.png", "z.png"], &["a.png", "z.png"]);
    for format in [ImageFormat::WebP, ImageFormat::Bmp] {
        let good = encoded(SIZE.0, SIZE.1, format);
        let mut random = crate::geometry::Random::new(7);
        let (mut n_loaded, mut n_refused) = (0, 0);
        for round in 0..150 {
            let mut bytes = good.clone();
            if round % 3 == 0 {
                bytes.truncate(random.index(bytes.len()));
            }
            for _ in 0..round % 7 {
                let at = random.index(bytes.len().max(1)).min(60);
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = random.index(256) as u8;
                }
            }
            folder.write("images/a.png", bytes);
            match folder.load() {
                Ok(_) => n_loaded += 1,
                Err(e) => {
                    let text = e.to_string();
                    assert!(!text.contains('\n') && text.len() < 1000, "{text}");
                    n_refused += 1;
                }
            }
        }
        assert!(
            n_loaded > 5 && n_refused > 30,
            "{format:?}: {n_loaded} {n_refused}"
        );
    }
    // A header with the cameras' shape that 288 MB of pixels would follow: 14 bits a side.
    let mut bytes = encoded(SIZE.0, SIZE.1, ImageFormat::WebP);
    assert_eq!((&bytes[12..16], bytes[20]), (&b"VP8L"[..], 0x2f));
    let rest = u32::from_le_bytes([bytes[21], bytes[22], bytes[23], bytes[24]]) & 0xf000_0000;
    let claimed = rest | (12_000 - 1) | (8_000 - 1) << 14;
    bytes[21..25].copy_from_slice(&claimed.to_le_bytes());
    folder.write("images/a.png", bytes);
    folder.fails_with(&["12000x8000", "cannot hold"]);
    // What is of one colour may be small.
    let flat = image::RgbImage::new(1500, 1000);
    let mut bytes = std::io::Cursor::new(Vec::new());
    flat.write_to(&mut bytes, ImageFormat::WebP)
        .expect("a WEBP");
    folder.write("images/a.png", bytes.into_inner());
    folder.scene();
}
