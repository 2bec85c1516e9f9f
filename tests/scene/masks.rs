//! Masks: where they are found, how they are read, what is refused.

use image::{DynamicImage, GrayImage, ImageFormat, Luma, Rgba, RgbaImage};

use super::build::{Folder, SIZE, fails_with, options, picture, warns};
use gspotential::config::OutsideMask;
use gspotential::error::ErrorKind;
use gspotential::scene::{CloudSource, LoadOptions, Outside, Scene, SceneSource};

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
    let mask = &view.mask.as_ref()?.set;
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

/// [`picture`] opaque left of `edge` and transparent right of it.
fn opaque_left_of(edge: u32) -> Vec<u8> {
    let opaque = picture(SIZE.0, SIZE.1);
    bytes(RgbaImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let [r, g, b] = opaque.get_pixel(x, y).0;
        Rgba([r, g, b, if x < edge { 255 } else { 0 }])
    }))
}

/// [`picture`] with `color` from `edge` on.
fn before(color: [u8; 3], edge: u32) -> Vec<u8> {
    let mut image = picture(SIZE.0, SIZE.1);
    for (x, _, pixel) in image.enumerate_pixels_mut() {
        if x >= edge {
            pixel.0 = color;
        }
    }
    image.into_raw()
}

#[test]
fn alpha_is_a_mask_unless_all_of_it_is_opaque() {
    let folder = Folder::with_views(&NAMES);
    folder.write("images/a.png", opaque_left_of(6));
    folder.write("images/b.png", opaque_left_of(SIZE.0));
    let scene = folder.scene();
    assert_eq!((edge(&scene, 0), edge(&scene, 1)), (Some(6), None));
    assert_eq!(scene.train[1].image.rgb, picture(SIZE.0, SIZE.1).into_raw());
    // A file is meant, where there is one.
    folder.write("masks/a.png.png", left_of(4, SIZE));
    assert_eq!(edge(&folder.scene(), 0), Some(4));
}

#[test]
fn what_a_mask_leaves_out_is_ignored_or_background_or_kept_as_asked() {
    let folder = Folder::with_views(&NAMES);
    folder.write("images/a.png", opaque_left_of(6));
    folder.write("masks/b.png.png", left_of(7, SIZE));
    let pink = [255, 51, 102];
    let load = |outside_mask| {
        let options = LoadOptions {
            outside_mask,
            background: [1.0, 0.2, 0.4],
            ..options()
        };
        folder.load_with(&options).expect("a scene").train
    };
    let whole = picture(SIZE.0, SIZE.1).into_raw();
    // (of the alpha channel, of the file)
    for (wanted, outside) in [
        (OutsideMask::Auto, [Outside::Background, Outside::Ignored]),
        (OutsideMask::Ignored, [Outside::Ignored; 2]),
        (OutsideMask::Background, [Outside::Background; 2]),
        (OutsideMask::Kept, [Outside::Kept; 2]),
    ] {
        let views = load(wanted);
        for ((view, outside), edge) in views.iter().zip(outside).zip([6, 7]) {
            let mask = view.mask.as_ref().expect("a mask");
            assert_eq!(mask.outside, outside);
            let expected = match outside {
                Outside::Background => before(pink, edge),
                _ => whole.clone(),
            };
            assert_eq!(view.image.rgb, expected, "{wanted:?}");
            let is_ignored = outside == Outside::Ignored;
            for (i, texel) in view.goal().iter().enumerate() {
                let counts = !is_ignored || (i as u32 % SIZE.0) < edge;
                assert_eq!(texel >> 24, if counts { 255 } else { 0 }, "{wanted:?} {i}");
                assert_eq!(view.counts(i), counts);
            }
        }
    }
}

#[test]
fn a_half_transparent_pixel_is_half_background() {
    let folder = Folder::with_views(&NAMES);
    let veil = RgbaImage::from_pixel(SIZE.0, SIZE.1, Rgba([200, 100, 0, 153]));
    folder.write("images/a.png", bytes(veil));
    let options = LoadOptions {
        background: [1.0; 3],
        ..options()
    };
    let scene = folder.load_with(&options).expect("a scene");
    // 0.6 * (200, 100, 0) + 0.4 * 255.
    assert_eq!(scene.train[0].image.rgb[..3], [222, 162, 102]);
}

#[test]
fn a_cut_out_subject_keeps_the_points_within_its_masks() {
    // They fall on (6.5, 3.5), (8.2, 3.5) and (5.1, 6.6) of the first view, those of others 10 z
    // further left for each.
    let folder = Folder::with_views(&NAMES);
    let load = |edge: u32, outside_mask| {
        folder.write("masks/a.png.png", left_of(edge, SIZE));
        folder.load_with(&LoadOptions {
            outside_mask,
            ..options()
        })
    };
    let n_left = |edge, outside| load(edge, outside).expect("a scene").cloud.len();
    assert_eq!(
        n_left(8, OutsideMask::Background),
        3,
        "a pixel beside the edge"
    );
    assert_eq!(n_left(7, OutsideMask::Background), 2);
    assert_eq!(n_left(5, OutsideMask::Background), 1);
    assert_eq!(n_left(1, OutsideMask::Ignored), 3);
    assert_eq!(n_left(1, OutsideMask::Kept), 3);
    let warnings = load(7, OutsideMask::Background).expect("a scene").warnings;
    assert!(
        warnings
            .iter()
            .any(|w| w.contains("1 of 3 points lie outside of the masks"))
    );
    fails_with(
        load(1, OutsideMask::Background),
        ErrorKind::Failure,
        &[
            "points3D.ply",
            "no point of the cloud lies within the masks",
            "outside_mask=ignored",
        ],
    );
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
        (left_of(0, SIZE), &["nothing inside", "remove it"]),
        (labels, &["brightest pixel is 1 of 255", "white"]),
    ] {
        let folder = Folder::with_views(&NAMES);
        folder.write("masks/c.png.png", mask);
        folder.fails_with(&[&["masks/c.png.png: ", "; "], parts].concat());
    }
}

#[test]
fn a_stamp_changes_with_the_files_and_with_nothing_else() {
    let folder = Folder::with_views(&NAMES);
    let source = SceneSource::Folder(folder.path().to_owned());
    let stamp = || source.stamp(None).expect("a folder");
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
    assert_eq!(gone.stamp(None), None);
    // A cloud from elsewhere is one of the files.
    let outside = Folder::empty();
    outside.write("cloud.ply", "1");
    let cloud = CloudSource::File(outside.path().join("cloud.ply"));
    let with_cloud = source.stamp(Some(&cloud));
    assert!(with_cloud.is_some() && with_cloud != source.stamp(None));
    outside.write("cloud.ply", "12");
    assert_ne!(source.stamp(Some(&cloud)), with_cloud);
    // A run that was put into the folder is none of the scene's files; a folder that only looks like one is.
    let with_scene = stamp();
    folder.write("runs/mine/config.json", "{}");
    assert_ne!(stamp(), with_scene);
    for mark in ["metrics.json", "eval.json", "point_cloud.ply"] {
        folder.write(&format!("runs/mine/{mark}"), mark);
        assert_eq!(stamp(), with_scene, "{mark}");
    }
    let builtin = |width| SceneSource::Builtin { width }.stamp(None);
    assert!(builtin(64).is_some() && builtin(64) != builtin(65));
}

#[test]
fn an_alpha_channel_that_says_nothing_of_a_subject_is_no_mask_and_is_told() {
    // 15,000 pixels, of which up to 15 are nothing.
    let size = (150, 100);
    let transparent = |n: u32| {
        bytes(RgbaImage::from_fn(size.0, size.1, |x, y| {
            let alpha = if y * size.0 + x < n { 0 } else { 255 };
            Rgba([90, 60, 30, alpha])
        }))
    };
    let all = size.0 * size.1;
    for (n, is_mask, said) in [
        (15, false, Some("next to nothing out")),
        (16, true, None),
        (all - 16, true, None),
        (all - 15, false, Some("nothing inside")),
        (all, false, Some("nothing inside")),
    ] {
        let folder = Folder::with_views(&NAMES);
        folder.write("images/a.png", transparent(n));
        let options = LoadOptions {
            outside_mask: OutsideMask::Kept,
            ..options()
        };
        let scene = folder.load_with(&options).expect("a scene");
        assert_eq!(scene.train[0].mask.is_some(), is_mask, "{n}");
        let told = scene
            .warnings
            .iter()
            .any(|w| w.contains("`a.png`") && w.contains("alpha channels of 1"));
        assert_eq!(told, said.is_some(), "{n}: {:?}", scene.warnings);
        if let Some(said) = said {
            assert!(
                scene.warnings.iter().any(|w| w.contains(said)),
                "{:?}",
                scene.warnings
            );
        }
    }
}

#[test]
fn a_photograph_that_is_all_but_opaque_throughout_has_no_mask() {
    for (alpha, is_mask) in [(254, false), (253, false), (252, true)] {
        let folder = Folder::with_views(&NAMES);
        let image = RgbaImage::from_pixel(SIZE.0, SIZE.1, Rgba([90, 60, 30, alpha]));
        folder.write("images/a.png", bytes(image));
        let scene = folder.scene();
        assert_eq!(scene.train[0].mask.is_some(), is_mask, "{alpha}");
        let told = scene
            .warnings
            .iter()
            .any(|w| w.contains("next to nothing out"));
        assert_eq!(told, !is_mask, "{alpha}: {:?}", scene.warnings);
    }
}

#[test]
fn a_cloud_is_checked_as_it_was_before_masks_drop_its_points() {
    let folder = Folder::with_views(&NAMES);
    folder.write("masks/a.png.png", left_of(7, SIZE));
    let load = |outside_mask| {
        let options = LoadOptions {
            outside_mask,
            ..options()
        };
        folder.load_with(&options).expect("a scene")
    };
    let scene = load(OutsideMask::Background);
    assert_eq!(scene.cloud.len(), 2);
    assert_eq!(scene.whole_cloud.map(|cloud| cloud.len()), Some(3));
    assert_eq!(load(OutsideMask::Ignored).whole_cloud, None);
}
