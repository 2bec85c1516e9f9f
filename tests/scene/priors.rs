//! Files of depths, confidences and normals beside the photographs.

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
use gspotential::config::Config;
use gspotential::scene::{LoadOptions, Prior, PriorFiles, Scene};
use image::{GrayImage, ImageBuffer, ImageFormat, Luma, Rgb, RgbImage};

use super::build::{Folder, SIZE, options};

const NAMES: [&str; 2] = ["a.png", "b.png"];
const N: usize = (SIZE.0 * SIZE.1) as usize;

fn config(settings: &[&str]) -> Config {
    let mut config = Config::preset("paper").expect("a preset");
    for setting in [&["prior.source=files"], settings].concat() {
        config = config.set(setting).expect("a setting");
    }
    config.validate().expect("allowed values");
    config
}

fn wanted(settings: &[&str]) -> LoadOptions {
    LoadOptions {
        priors: PriorFiles::of(&config(settings)),
        ..options()
    }
}

fn load(folder: &Folder, settings: &[&str]) -> Scene {
    folder
        .load_with(&wanted(settings))
        .unwrap_or_else(|e| panic!("{e}"))
}

#[track_caller]
fn refused(folder: &Folder, settings: &[&str], parts: &[&str]) {
    let error = folder.load_with(&wanted(settings)).expect_err("refused");
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "no `{part}` in: {text}");
    }
}

fn npy(shape: &str, values: &[f32]) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// A depth that differs in every pixel.
fn depths(n: usize) -> Vec<f32> {
    (0..n).map(|i| 1.0 + 0.25 * i as f32).collect()
}

fn png_16(width: u32, height: u32, levels: Vec<u16>) -> Vec<u8> {
    let image: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_raw(width, height, levels).expect("as many");
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, ImageFormat::Png)
        .expect("encodes");
    bytes.into_inner()
}

fn exr_of(channels: Vec<(&str, Vec<f32>)>) -> Vec<u8> {
    let channels = channels
        .into_iter()
        .map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values)));
    let image = Image::from_channels(
        (SIZE.0 as usize, SIZE.1 as usize),
        AnyChannels::sort(channels.collect()),
    );
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).expect("encodes");
    bytes.into_inner()
}

fn prior(scene: &Scene, i: usize) -> &Prior {
    scene.train[i].prior.as_ref().expect("read")
}

#[test]
fn depths_are_read_of_every_format_and_by_either_name() {
    let folder = Folder::with_views(&NAMES);
    let levels = (0..N as u16).map(|i| 1000 + 250 * i).collect();
    folder.write("depths/a.png.npy", npy("(8, 12)", &depths(N)));
    folder.write("depths/b.png", png_16(SIZE.0, SIZE.1, levels));
    let scene = load(&folder, &[]);
    for i in 0..2 {
        let found = prior(&scene, i).depth.as_ref().expect("depths");
        let off = found.iter().zip(depths(N)).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f32::max) < 1e-5, "view {i}");
        assert!(prior(&scene, i).confidence.is_none() && prior(&scene, i).normal.is_none());
    }
    for channels in [
        vec![("V", depths(N))],
        vec![("A", vec![1.0; N]), ("depth.Z", depths(N))],
    ] {
        folder.write("depths/a.png.npy", npy("(1, 8, 12)", &vec![7.0; N]));
        folder.remove("depths/a.png.npy");
        folder.write("depths/a.exr", exr_of(channels));
        let scene = load(&folder, &[]);
        assert_eq!(prior(&scene, 0).depth, Some(depths(N)));
    }
    // A metre is a thousand levels unless the config says otherwise.
    let scene = load(&folder, &["prior.png_step=0.002"]);
    let found = prior(&scene, 1).depth.as_ref().expect("depths")[0];
    assert!((found - 2.0).abs() < 1e-6, "{found}");
    // Nothing is read that nobody asks for.
    let scene = folder.scene();
    assert!(scene.train.iter().all(|view| view.prior.is_none()));
    assert!(PriorFiles::of(&config(&["prior.weight=0"])).is_none());
}

#[test]
fn maps_of_other_resolutions_have_the_nearest_number() {
    let folder = Folder::with_views(&NAMES);
    let (width, height) = (24, 16);
    let large: Vec<f32> = (0..width * height)
        .map(|i| (1 + i % width / 2 + 100 * (i / width / 2)) as f32)
        .collect();
    folder.write("depths/a.npy", npy("(16, 24)", &large));
    folder.write("depths/b.npy", npy("(4, 6)", &depths(24)));
    let scene = load(&folder, &[]);
    let found = prior(&scene, 0).depth.as_ref().expect("depths");
    for (i, depth) in found.iter().enumerate() {
        assert_eq!(*depth, (1 + i % 12 + 100 * (i / 12)) as f32);
    }
    let found = prior(&scene, 1).depth.as_ref().expect("depths");
    for (i, depth) in found.iter().enumerate() {
        assert_eq!(*depth, depths(24)[i / 12 / 2 * 6 + i % 12 / 2]);
    }
}

#[test]
fn normals_are_unit_vectors_in_the_cameras_axes_on_its_side() {
    let folder = Folder::with_views(&NAMES);
    // Up and to the viewer, in either convention.
    let (opencv, opengl) = ([0.0, -3.0, -4.0], [0.0, 3.0, 4.0]);
    folder.write("normals/a.npy", npy("(8, 12, 3)", &opencv.repeat(N)));
    let planes: Vec<f32> = opencv.iter().flat_map(|x| vec![*x; N]).collect();
    folder.write("normals/b.npy", npy("(3, 8, 12)", &planes));
    let settings = ["prior.weight=0", "prior.normal_weight=0.1"];
    let check = |folder: &Folder, more: &[&str], bound: f32| {
        let scene = load(folder, &[&settings, more].concat());
        for i in 0..2 {
            assert!(prior(&scene, i).depth.is_none());
            for normal in prior(&scene, i).normal.as_ref().expect("normals") {
                let off = normal
                    .iter()
                    .zip([0.0, -0.6, -0.8])
                    .map(|(a, b)| (a - b).abs());
                assert!(off.fold(0.0, f32::max) < bound, "{normal:?}");
            }
        }
    };
    check(&folder, &[], 1e-6);
    let channels = ["R", "G", "B"].into_iter().zip(opengl);
    let channels = channels.map(|(name, x)| (name, vec![x; N])).collect();
    folder.remove("normals/a.npy");
    folder.write("normals/a.exr", exr_of(channels));
    folder.remove("normals/b.npy");
    let level = |x: f32| ((x / 5.0 + 1.0) * 127.5).round() as u8;
    let image = RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb(opengl.map(level)));
    let mut png = std::io::Cursor::new(Vec::new());
    image.write_to(&mut png, ImageFormat::Png).expect("encodes");
    folder.write("normals/b.png", png.into_inner());
    check(&folder, &["prior.normal_axes=opengl"], 0.01);
    // Those that look away are turned to the camera.
    folder.write(
        "normals/a.npy",
        npy("(8, 12, 3)", &[0.0, 3.0, 4.0].repeat(N)),
    );
    folder.write("normals/b.npy", npy("(8, 12, 3)", &opencv.repeat(N)));
    check(&folder, &[], 1e-6);
}

#[test]
fn confidences_are_optional_and_levels_of_a_png_are_shares() {
    let folder = Folder::with_views(&NAMES);
    for name in ["a", "b"] {
        folder.write(&format!("depths/{name}.npy"), npy("(8, 12)", &depths(N)));
    }
    folder.write("confidences/b.npy", npy("(8, 12)", &vec![2.5; N]));
    let mut grey = std::io::Cursor::new(Vec::new());
    GrayImage::from_pixel(SIZE.0, SIZE.1, Luma([51]))
        .write_to(&mut grey, ImageFormat::Png)
        .expect("encodes");
    folder.write("confidences/a.png", grey.into_inner());
    let scene = load(&folder, &[]);
    let confidence = |i: usize| prior(&scene, i).confidence.as_ref().expect("some")[5];
    assert!((confidence(0) - 0.2).abs() < 1e-4 && confidence(1) == 2.5);
}

#[test]
fn files_that_are_missing_or_wrong_are_named_with_the_way_out() {
    let folder = Folder::with_views(&NAMES);
    folder.write("depths/a.npy", npy("(8, 12)", &depths(N)));
    refused(
        &folder,
        &[],
        &["depths", "`b.png`", "b.npy", "prior.weight=0"],
    );
    folder.write("depths/b.npy", npy("(8, 9)", &depths(72)));
    refused(&folder, &[], &["depths/b.npy", "9x8", "12x8"]);
    folder.write("depths/b.npy", npy("(96,)", &depths(N)));
    refused(&folder, &[], &["depths/b.npy", "[96]", "(height, width)"]);
    folder.write("depths/b.npy", &npy("(8, 12)", &depths(N))[..200]);
    refused(&folder, &[], &["depths/b.npy", "truncated"]);
    folder.remove("depths/b.npy");
    folder.write("depths/b.exr", b"nothing");
    refused(&folder, &[], &["depths/b.exr", "EXR"]);
    folder.remove("depths/b.exr");
    folder.write("depths/b.png", super::build::png(SIZE.0, SIZE.1));
    refused(&folder, &[], &["depths/b.png", "colours", "grey"]);
    folder.write("depths/b.npy", npy("(8, 12)", &depths(N)));
    load(&folder, &[]);
    let normals = ["prior.normal_weight=1"];
    refused(
        &folder,
        &normals,
        &["normals", "`a.png`", "prior.normal_weight=0"],
    );
    // A lens that is undone while loading.
    folder.write(
        "sparse/0/cameras.txt",
        "1 SIMPLE_RADIAL 12 8 10 6.5 3.5 0.05\n",
    );
    refused(&folder, &[], &["`a.png`", "undistort"]);
}

#[test]
fn losses_that_mean_nothing_for_a_kind_of_depths_are_refused() {
    let of = |settings: &[&str]| {
        let mut config = Config::preset("paper").expect("a preset");
        for setting in settings {
            config = config.set(setting).expect("a setting");
        }
        config.validate().err().map(|e| e.to_string())
    };
    let relative = ["prior.source=files", "prior.depths=relative"];
    assert_eq!(of(&relative), None);
    let error = of(&[&relative[..], &["prior.loss=l1"]].concat()).expect("refused");
    assert!(error.contains("`prior.loss` is l1"), "{error}");
    let error = of(&[&relative[..], &["prior.inverse=true"]].concat()).expect("refused");
    assert!(error.contains("`prior.inverse` is true"), "{error}");
    assert_eq!(
        of(&["prior.source=cloud", "prior.loss=l1", "prior.inverse=true"]),
        None
    );
}
