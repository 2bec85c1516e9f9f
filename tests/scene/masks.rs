//! Masks: where they are found, how they are read, what is refused.

use image::{DynamicImage, GrayImage, ImageFormat, Luma, Rgba, RgbaImage};

use super::build::{Folder, SIZE, options, picture, warns};
use gspotential::scene::{LoadOptions, Scene};

const NAMES: [&str; 4] = ["a.png", "b.png", "c.png", "d.png"];

fn bytes(image: impl Into<DynamicImage>) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image: DynamicImage = image.into();
    image.write_to(&mut bytes, ImageFormat::Png).expect("PNG");
    bytes.into_inner()
}

/// White left of `edge`.
fn left_of(edge: u32, (width, height): (u32, u32)) -> Vec<u8> {
    bytes(GrayImage::from_fn(width, height, |x, _| {
        Luma([if x < edge { 255 } else { 0 }])
    }))
}

/// Number of set pixels in each row of the view's mask, which are the first ones.
#[track_caller]
fn edge(scene: &Scene, view: usize) -> Option<usize> {
    let view = &scene.train[view];
    let mask = view.mask.as_ref()?;
    let width = view.image.width as usize;
    assert_eq!(mask.len(), width * view.image.height as usize);
    let edge = mask[..width].iter().filter(|&&set| set).count();
    let is_left = |(i, &set): (usize, &bool)| set == (i % width < edge);
    assert!(mask.iter().enumerate().all(is_left));
    Some(edge)
}

#[test]
fn masks_are_found_by_colmaps_name_and_by_the_stem() {
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "left/d.png"]);
    folder.write("masks/a.png.png", left_of(3, SIZE));
    folder.write("masks/b.png", left_of(5, SIZE));
    folder.write("masks/left/d.png.png", left_of(7, SIZE));
    folder.write("masks/d.png", "not for left/d.png");
    // COLMAP's name is the surer one.
    folder.write("masks/a.png", left_of(9, SIZE));
    let scene = folder.scene();
    warns(
        &scene,
        &["1 of 4 views have no mask in `masks/` (`c.png.png`)"],
    );
    let edges: Vec<_> = (0..4).map(|view| edge(&scene, view)).collect();
    assert_eq!(edges, [Some(3), Some(5), None, Some(7)]);
    // The photographs are as they were.
    assert_eq!(scene.train[0].image.rgb, picture(SIZE.0, SIZE.1).into_raw());
}

#[test]
fn a_scene_without_masks_has_none_and_says_nothing() {
    let scene = Folder::with_views(&NAMES).scene();
    warns(&scene, &[]);
    assert!(scene.train.iter().all(|view| view.mask.is_none()));
}

#[test]
fn alpha_is_a_mask_unless_all_of_it_is_opaque() {
    let folder = Folder::with_views(&NAMES);
    let with_alpha = |edge: u32| {
        let opaque = picture(SIZE.0, SIZE.1);
        bytes(RgbaImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            let [r, g, b] = opaque.get_pixel(x, y).0;
            Rgba([r, g, b, if x < edge { 255 } else { 0 }])
        }))
    };
    folder.write("images/a.png", with_alpha(4));
    folder.write("images/b.png", with_alpha(SIZE.0));
    let scene = folder.scene();
    warns(&scene, &[]);
    assert_eq!((edge(&scene, 0), edge(&scene, 1)), (Some(4), None));
    assert_eq!(scene.train[0].image.rgb, picture(SIZE.0, SIZE.1).into_raw());
    // A file is meant, where there is one.
    folder.write("masks/a.png.png", left_of(6, SIZE));
    assert_eq!(edge(&folder.scene(), 0), Some(6));
}

#[test]
fn masks_are_scaled_with_their_photographs_and_stay_black_and_white() {
    let folder = Folder::with_views(&NAMES);
    for name in NAMES {
        folder.write(&format!("masks/{name}.png"), left_of(6, SIZE));
    }
    // Drawn at another resolution.
    folder.write("masks/b.png.png", left_of(18, (36, 24)));
    let half = LoadOptions {
        max_size: Some(6),
        ..options()
    };
    for (options, expected) in [(options(), 6), (half, 3)] {
        let scene = folder.load_with(&options).expect("a scene");
        let edges: Vec<_> = (0..4).map(|view| edge(&scene, view)).collect();
        assert_eq!(edges, [Some(expected); 4]);
    }
}

#[test]
fn grey_is_set_from_half_on() {
    let folder = Folder::with_views(&NAMES);
    let ramp = GrayImage::from_fn(SIZE.0, SIZE.1, |x, _| Luma([(255 - 23 * x) as u8]));
    folder.write("masks/a.png.png", bytes(ramp));
    // 255 - 23 * 5 = 140, and 117 is below the half.
    assert_eq!(edge(&folder.scene(), 0), Some(6));
}

#[test]
fn an_empty_mask_is_a_mask() {
    let folder = Folder::with_views(&NAMES);
    folder.write("masks/a.png.png", left_of(0, SIZE));
    assert_eq!(edge(&folder.scene(), 0), Some(0));
}

#[test]
fn masks_that_are_none_are_refused_by_name() {
    let labels = bytes(GrayImage::from_fn(SIZE.0, SIZE.1, |x, _| {
        Luma([(x % 2) as u8])
    }));
    let good = left_of(4, SIZE);
    for (mask, parts) in [
        (left_of(4, (12, 10)), &["the mask is 12x10", "12x8"][..]),
        (left_of(4, (8, 12)), &["the mask is 8x12", "12x8"]),
        (Vec::new(), &["empty"]),
        (b"hello".to_vec(), &["neither a PNG nor a JPEG"]),
        (good[..good.len() - 20].to_vec(), &["cannot decode"]),
        (labels, &["brightest pixel is 1 of 255", "white"]),
    ] {
        let folder = Folder::with_views(&NAMES);
        folder.write("masks/c.png.png", mask);
        folder.fails_with(&[&["masks/c.png.png: ", "; "], parts].concat());
    }
}

#[test]
fn a_stamp_changes_with_the_files_and_with_nothing_else() {
    use gspotential::scene::SceneSource;
    let folder = Folder::with_views(&NAMES);
    let source = SceneSource::Folder(folder.path().to_owned());
    let stamp = || source.stamp().expect("a folder");
    let before = stamp();
    assert_eq!(stamp(), before);
    folder.write("masks/a.png.png", left_of(3, SIZE));
    let with_mask = stamp();
    assert_ne!(with_mask, before);
    folder.write("masks/a.png.png", left_of(5, (24, 16)));
    assert_ne!(stamp(), with_mask);
    folder.remove("masks/a.png.png");
    // The empty folder is left, which holds no file.
    assert_eq!(stamp(), before);
    let gone = SceneSource::Folder(folder.path().join("none"));
    assert_eq!(gone.stamp(), None);
    let builtin = |width| SceneSource::Builtin { width }.stamp();
    assert!(builtin(64).is_some() && builtin(64) != builtin(65));
}
