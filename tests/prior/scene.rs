//! From photographs to a scene that can be trained on, with tiny weights: what they see is noise,
//! but everything around them is as with real ones.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use gspotential::config::{Config, PRESETS};
use gspotential::pipeline::{PriorOptions, cloud_of_scene, scene_of_photographs};
use gspotential::scene::{LoadOptions, SceneSource, load, read_cloud, read_photograph};
use image::{ImageEncoder, RgbImage};

use super::golden;
use crate::kit::program::{Ended, succeed};

fn options() -> PriorOptions {
    PriorOptions {
        weights: Some(golden("tiny.safetensors")),
        size: 84,
        share: 1.0,
        ..PriorOptions::default()
    }
}

fn picture(width: u32, height: u32, seed: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let wave =
            |k: u32| (128.0 + 100.0 * f64::from((x + seed * 7) * k + y * (k + seed)).sin()) as u8;
        image::Rgb([wave(1), wave(2), wave(3)])
    })
}

/// TIFF data of an orientation and a focal length on 35 mm film.
fn exif(orientation: u16, focal: u16) -> Vec<u8> {
    let mut bytes = b"II*\0\x08\0\0\0\x02\0".to_vec();
    let mut entry = |tag: u16, kind: u16, value: u32| {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    };
    entry(0x0112, 3, u32::from(orientation));
    entry(0x8769, 4, 38);
    bytes.extend([0; 4]);
    bytes.extend(1_u16.to_le_bytes());
    bytes.extend(0xa405_u16.to_le_bytes());
    bytes.extend(3_u16.to_le_bytes());
    bytes.extend(1_u32.to_le_bytes());
    bytes.extend(u32::from(focal).to_le_bytes());
    bytes.extend([0; 4]);
    bytes
}

fn jpeg(path: &Path, picture: &RgbImage, exif: Vec<u8>) {
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif).expect("is taken");
    let (width, height) = picture.dimensions();
    encoder
        .write_image(picture, width, height, image::ExtendedColorType::Rgb8)
        .expect("encodes");
    fs::write(path, bytes).expect("writes");
}

/// A folder of photographs of one shape.
fn photographs(dir: &Path, n: u32) -> PathBuf {
    let folder = dir.join("photographs");
    fs::create_dir_all(&folder).expect("makes a folder");
    for i in 0..n {
        picture(126, 84, i)
            .save(folder.join(format!("{i:02}.png")))
            .expect("writes");
    }
    folder
}

#[test]
#[ignore = "needs ../shared/prior"]
fn photographs_become_a_scene_that_loads() {
    let options = options();
    let dir = tempfile::tempdir().expect("a folder");
    for n in [1, 2, 5] {
        let folder = photographs(dir.path(), n);
        let out = dir.path().join(format!("scene-{n}"));
        scene_of_photographs(std::slice::from_ref(&folder), &options, &out)
            .unwrap_or_else(|e| panic!("{e}"));
        let load_options = LoadOptions::new(&Config::preset(PRESETS[0].0).expect("is there"));
        let scene = load(&out, &load_options).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((scene.train.len(), scene.test.len()), (n as usize, 0));
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        assert!(!scene.cloud.is_empty());
        assert!(scene.cloud.confidence.is_some());
        for (i, view) in scene.train.iter().enumerate() {
            assert_eq!(view.camera.name, format!("{i:02}.png"));
            assert_eq!((view.camera.width, view.camera.height), (126, 84));
            let file = format!("{i:02}.png");
            let copy = fs::read(out.join("images").join(&file)).expect("is there");
            assert!(copy == fs::read(folder.join(&file)).expect("is there"));
        }
        // The same bytes a second time.
        let again = dir.path().join(format!("again-{n}"));
        scene_of_photographs(&[folder], &options, &again).unwrap_or_else(|e| panic!("{e}"));
        for file in ["cameras.txt", "images.txt", "points3D.ply"] {
            let read =
                |scene: &Path| fs::read(scene.join("sparse/0").join(file)).expect("is there");
            assert!(read(&out) == read(&again), "{file}");
        }
        let error = scene_of_photographs(&[dir.path().join("photographs")], &options, &out);
        assert!(
            error
                .expect_err("is refused")
                .to_string()
                .contains("is there already")
        );
    }
}

#[test]
fn turned_photographs_are_turned_and_their_focal_length_is_read() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("turned.jpg");
    jpeg(&path, &picture(126, 84, 1), exif(6, 35));
    let photograph = read_photograph(&path).unwrap_or_else(|e| panic!("{e}"));
    assert!(photograph.turned);
    assert_eq!((photograph.image.width, photograph.image.height), (84, 126));
    assert_eq!(photograph.focal_35mm, Some(35.0));
    let upright = dir.path().join("upright.jpg");
    jpeg(&upright, &picture(126, 84, 1), exif(1, 0));
    let photograph = read_photograph(&upright).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((photograph.turned, photograph.focal_35mm), (false, None));
}

#[test]
#[ignore = "needs ../shared/prior"]
fn a_focal_length_that_is_read_becomes_the_cameras() {
    let dir = tempfile::tempdir().expect("a folder");
    let [path, upright] = ["turned.jpg", "upright.jpg"].map(|name| dir.path().join(name));
    jpeg(&path, &picture(126, 84, 1), exif(6, 35));
    jpeg(&upright, &picture(126, 84, 1), exif(1, 0));
    let options = PriorOptions {
        exif_focal: true,
        ..options()
    };
    let out = dir.path().join("scene");
    scene_of_photographs(&[path, upright], &options, &out).unwrap_or_else(|e| panic!("{e}"));
    let load_options = LoadOptions::new(&Config::preset(PRESETS[0].0).expect("is there"));
    let scene = load(&out, &load_options).unwrap_or_else(|e| panic!("{e}"));
    let camera = &scene.train[0].camera;
    assert_eq!((camera.width, camera.height), (84, 126));
    let focal = 35.0 * 84_f64.hypot(126.0) / 43.266_615;
    assert!(
        (camera.fx - focal).abs() < 1e-6 && (camera.fy - focal).abs() < 1e-6,
        "{camera:?}"
    );
}

#[track_caller]
fn assert_refused(paths: &[PathBuf], options: &PriorOptions, out: &Path, parts: &[&str]) {
    let error = scene_of_photographs(paths, options, out)
        .expect_err("is refused")
        .to_string();
    for part in parts {
        assert!(error.contains(part), "`{part}` is not in: {error}");
    }
    assert!(!out.exists());
}

#[test]
fn photographs_that_cannot_be_used_are_refused_by_name() {
    let dir = tempfile::tempdir().expect("a folder");
    let options = PriorOptions::default();
    let folder = photographs(dir.path(), 2);
    let out = dir.path().join("scene");
    let one = std::slice::from_ref(&folder);
    assert_refused(
        one,
        &options,
        &out,
        &["no weights", "137 MB", "541 MB", "Apache-2.0", "--weights"],
    );
    assert_refused(
        &[dir.path().join("gone.jpg")],
        &options,
        &out,
        &["gone.jpg", "no such photograph"],
    );
    assert_refused(
        &[folder.clone(), folder.join("00.png")],
        &options,
        &out,
        &["two photographs are named"],
    );
    fs::create_dir(dir.path().join("empty")).expect("makes a folder");
    assert_refused(
        &[dir.path().join("empty")],
        &options,
        &out,
        &["empty", "holds no photograph"],
    );
}

/// Makes a scene by the command, as with the options of the other tests.
fn scene_command(paths: &[PathBuf], out: &Path) -> Ended {
    let weights = golden("tiny.safetensors");
    let fixed = ["scene", "--size", "84", "--confidence", "1", "--weights"];
    let mut args: Vec<&OsStr> = fixed.map(OsStr::new).to_vec();
    args.extend([weights.as_os_str(), OsStr::new("--out"), out.as_os_str()]);
    args.extend(paths.iter().map(|path| path.as_os_str()));
    succeed(out.parent().expect("a folder"), args.as_slice())
}

fn train_names(scene: &Path) -> Vec<String> {
    let options = LoadOptions::new(&Config::preset(PRESETS[0].0).expect("is there"));
    let scene = load(scene, &options).unwrap_or_else(|e| panic!("{e}"));
    scene.train.iter().map(|v| v.camera.name.clone()).collect()
}

#[test]
#[ignore = "needs ../shared/prior"]
fn fifty_photographs_keep_their_order_and_are_told_to_be_many() {
    let dir = tempfile::tempdir().expect("a folder");
    let folder = photographs(dir.path(), 50);
    // In an order that is not that of their names.
    let paths: Vec<PathBuf> = (0..50)
        .map(|i| folder.join(format!("{:02}.png", i * 7 % 50)))
        .collect();
    let out = dir.path().join("scene");
    let log = scene_command(&paths, &out).log;
    let memory = log.find("50 views of 84x56 take about").expect("is said");
    let many = log.find("50 photographs are more than").expect("is said");
    assert!(memory < many, "{log}");
    // What tiny weights make of noise is no scene.
    assert!(log.contains("the photographs hardly agree"), "{log}");
    let images = fs::read_to_string(out.join("sparse/0/images.txt")).expect("is there");
    let names: Vec<&str> = images
        .lines()
        .filter_map(|line| {
            line.rsplit(' ')
                .next()
                .filter(|name| name.ends_with(".png"))
        })
        .collect();
    let right = paths
        .iter()
        .map(|p| p.file_name().expect("a name").to_string_lossy());
    assert!(names.iter().copied().eq(right), "{names:?}");
    assert_eq!(train_names(&out).len(), 50);
}

#[test]
#[ignore = "needs ../shared/prior"]
fn photographs_of_several_shapes_keep_their_own() {
    let dir = tempfile::tempdir().expect("a folder");
    let shapes = [(126, 84), (84, 126), (300, 200), (90, 90)];
    let paths: Vec<PathBuf> = (0..4)
        .map(|i| dir.path().join(format!("{i}.png")))
        .collect();
    for (i, (path, (width, height))) in paths.iter().zip(shapes).enumerate() {
        picture(width, height, i as u32).save(path).expect("writes");
    }
    let out = dir.path().join("scene");
    let log = scene_command(&paths, &out).log;
    assert!(log.contains("several shapes"), "{log}");
    let options = LoadOptions::new(&Config::preset(PRESETS[0].0).expect("is there"));
    let scene = load(&out, &options).unwrap_or_else(|e| panic!("{e}"));
    for (view, shape) in scene.train.iter().zip(shapes) {
        let camera = &view.camera;
        assert_eq!((camera.width, camera.height), shape);
        // What the network sees is the middle of each.
        let middle = (f64::from(shape.0) / 2.0, f64::from(shape.1) / 2.0);
        let off = (camera.cx - middle.0)
            .abs()
            .max((camera.cy - middle.1).abs());
        assert!(off < 1.0, "{camera:?}");
    }
}

#[test]
fn photographs_are_turned_upright_whichever_way_they_lie() {
    let dir = tempfile::tempdir().expect("a folder");
    let upright = RgbImage::from_fn(120, 80, |x, y| {
        image::Rgb([(x * 2) as u8, (y * 3) as u8, 90])
    });
    for orientation in 1..=8_u16 {
        use image::imageops::{flip_horizontal, flip_vertical, rotate90, rotate180, rotate270};
        let stored = match orientation {
            1 => upright.clone(),
            2 => flip_horizontal(&upright),
            3 => rotate180(&upright),
            4 => flip_vertical(&upright),
            5 => rotate270(&flip_horizontal(&upright)),
            6 => rotate270(&upright),
            7 => rotate90(&flip_horizontal(&upright)),
            _ => rotate90(&upright),
        };
        let path = dir.path().join(format!("{orientation}.jpg"));
        jpeg(&path, &stored, exif(orientation, 0));
        let photograph = read_photograph(&path).unwrap_or_else(|e| panic!("{e}"));
        let image = photograph.image;
        assert_eq!((image.width, image.height), (120, 80), "{orientation}");
        let off = image.rgb.iter().zip(upright.as_raw());
        let off = off.map(|(a, b)| a.abs_diff(*b)).max();
        // JPEG's own error is far below what another corner would be.
        assert!(off < Some(40), "{orientation}: {off:?}");
    }
}

#[test]
#[ignore = "needs ../shared/prior"]
fn a_scene_without_any_points_gets_a_cloud() {
    let options = options();
    let dir = tempfile::tempdir().expect("a folder");
    let scene = dir.path().join("scene");
    scene_of_photographs(&[photographs(dir.path(), 3)], &options, &scene)
        .unwrap_or_else(|e| panic!("{e}"));
    fs::remove_file(scene.join("sparse/0/points3D.ply")).expect("is there");
    let out = dir.path().join("dense.ply");
    let weights = golden("tiny.safetensors");
    let fixed = ["scene", "--size", "84", "--weights"];
    let mut args: Vec<&OsStr> = fixed.map(OsStr::new).to_vec();
    args.extend([
        weights.as_os_str(),
        OsStr::new("--cameras"),
        scene.as_os_str(),
    ]);
    args.extend([OsStr::new("--out"), out.as_os_str()]);
    let log = succeed(dir.path(), args.as_slice()).log;
    assert!(log.contains("by the cameras' distances"), "{log}");
    assert!(
        !read_cloud(&out)
            .unwrap_or_else(|e| panic!("{e}"))
            .is_empty()
    );
}

#[test]
#[ignore = "needs ../shared/prior"]
fn photographs_that_show_nothing_are_refused_by_name() {
    let dir = tempfile::tempdir().expect("a folder");
    let options = options();
    let folder = photographs(dir.path(), 2);
    let out = dir.path().join("scene");
    let one = std::slice::from_ref(&folder);
    RgbImage::from_pixel(40, 40, image::Rgb([9, 9, 9]))
        .save(folder.join("blank.png"))
        .expect("writes");
    assert_refused(one, &options, &out, &["blank.png", "shows nothing"]);
    fs::write(folder.join("blank.png"), b"no image").expect("writes");
    assert_refused(
        one,
        &options,
        &out,
        &["blank.png", "neither a PNG nor a JPEG"],
    );
}

#[test]
#[ignore = "needs ../shared/prior"]
fn a_scene_whose_cameras_are_known_gets_a_dense_cloud() {
    let options = options();
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("dense.ply");
    let load_options = LoadOptions {
        n_test: 0,
        ..LoadOptions::new(&Config::preset(PRESETS[0].0).expect("is there"))
    };
    let source = SceneSource::Builtin { width: 64 };
    cloud_of_scene(&source, &load_options, &options, &out).unwrap_or_else(|e| panic!("{e}"));
    let cloud = read_cloud(&out).unwrap_or_else(|e| panic!("{e}"));
    assert!(!cloud.is_empty() && cloud.confidence.is_some());
}
