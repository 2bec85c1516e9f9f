//! Real scenes from beside the repository, and clouds as large as real ones.

use std::path::Path;
use std::time::Instant;

use super::build::{options, warns};
use crate::kit::data::shared;
use gspotential::cloud::agreement::Agreement;
use gspotential::scene::{CloudSource, LoadOptions, PointCloud, View, load, read_cloud};

#[test]
#[ignore = "needs ../shared/scenes"]
fn real_scenes_load_with_their_known_numbers() {
    // name, training and test views, points, full size, size bounded by 320
    for (name, n_train, n_test, n_points, full, small) in [
        ("kitchen", 4, 20, 250_000, (997, 665), (320, 213)),
        ("fox", 4, 46, 350_000, (562, 1000), (180, 320)),
    ] {
        let dir = shared("scenes").join(name);
        for (max_size, size) in [(None, full), (Some(320), small)] {
            let limits = LoadOptions {
                max_size,
                ..options()
            };
            let start = Instant::now();
            let scene = load(&dir, &limits).unwrap_or_else(|e| panic!("{e}"));
            eprintln!("{name} at {}x{}: {:.2?}", size.0, size.1, start.elapsed());
            warns(&scene, &[]);
            assert_eq!(scene.name, name);
            assert_eq!((scene.train.len(), scene.test.len()), (n_train, n_test));
            assert_eq!(scene.cloud.len(), n_points);
            assert_eq!(
                scene.cloud.confidence.as_ref().map(Vec::len),
                Some(n_points)
            );
            for view in scene.train.iter().chain(&scene.test) {
                assert_eq!((view.image.width, view.image.height), size);
                assert_eq!((view.camera.width, view.camera.height), size);
            }
            // The clouds carry the training images' colours, so that a cloud seen through a
            // training camera looks like its image if and only if both are read right.
            let right = median_color_error(&scene.cloud, &scene.train[0]);
            let mut turned = scene.train[0].clone();
            turned.camera.rotation = turned.camera.rotation.transpose();
            let wrong = median_color_error(&scene.cloud, &turned);
            eprintln!("{name}: median colour error {right}, with a wrong camera {wrong}");
            assert!(
                right < 40.0 && wrong > 2.0 * right,
                "{name}: {right} {wrong}"
            );
        }
    }
}

#[test]
#[ignore = "needs ../shared/scenes"]
fn real_scenes_are_told_nothing_that_is_not_so() {
    let said = |dir: &Path, options: &LoadOptions| -> Vec<String> {
        let scene = load(dir, options).unwrap_or_else(|e| panic!("{e}"));
        let agreement = Agreement::of(&scene).unwrap_or_else(|e| panic!("{e}"));
        scene
            .warnings
            .into_iter()
            .chain(agreement.warnings)
            .collect()
    };
    let small = LoadOptions {
        max_size: Some(320),
        ..options()
    };
    for name in ["kitchen", "fox"] {
        assert_eq!(
            said(&shared("scenes").join(name), &small),
            [""; 0],
            "{name}"
        );
    }
    let dir = shared("scenes").join("kitchen");
    let noisy = LoadOptions {
        cloud: Some(CloudSource::File(dir.join("sparse/0/points3D_noisy.ply"))),
        ..small.clone()
    };
    assert_eq!(said(&dir, &noisy), [""; 0]);
    let said = said(&shared("scenes").join("dust3r_pair"), &small);
    for part in [
        "only 2 posed images",
        "of what DUSt3R sees",
        "read as camera-to-world",
    ] {
        assert!(
            said.iter().any(|w| w.contains(part)),
            "no {part:?} in {said:?}"
        );
    }
    assert_eq!(said.len(), 3, "{said:?}");
}

/// Median, over the pixels with a point, of the nearest point's summed difference to the pixel.
fn median_color_error(cloud: &PointCloud, view: &View) -> f64 {
    let camera = &view.camera;
    let n_pixels = camera.width as usize * camera.height as usize;
    let mut nearest = vec![(f64::INFINITY, 0u32); n_pixels];
    for (p, color) in cloud.positions.iter().zip(&cloud.colors) {
        let p = camera.rotation * *p + camera.translation;
        let u = (camera.fx * p.x / p.z + camera.cx).floor();
        let v = (camera.fy * p.y / p.z + camera.cy).floor();
        let inside = p.z > 0.0
            && (0.0..f64::from(camera.width)).contains(&u)
            && (0.0..f64::from(camera.height)).contains(&v);
        if inside {
            let at = v as usize * camera.width as usize + u as usize;
            let pixel = &view.image.rgb[3 * at..3 * at + 3];
            if p.z < nearest[at].0 {
                let error = pixel
                    .iter()
                    .zip(color)
                    .map(|(a, b)| u32::from(a.abs_diff(*b)));
                nearest[at] = (p.z, error.sum());
            }
        }
    }
    let mut errors: Vec<u32> = nearest
        .iter()
        .filter(|(depth, _)| depth.is_finite())
        .map(|(_, error)| *error)
        .collect();
    errors.sort_unstable();
    errors
        .get(errors.len() / 2)
        .map_or(f64::INFINITY, |&e| f64::from(e))
}

/// The clouds that users bring: 5 million points.
#[test]
fn a_large_cloud_is_read() {
    let n = 5_000_000;
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {n}\nproperty float x\n\
         property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nproperty float confidence\nend_header\n"
    )
    .into_bytes();
    for i in 0..n {
        for value in [i as f32, -1.0, 2.0] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([1, 2, 3]);
        bytes.extend(1f32.to_le_bytes());
    }
    let folder = super::build::Folder::empty();
    folder.write("points3D.ply", bytes);
    let cloud = read_cloud(&folder.path().join("points3D.ply")).expect("a cloud");
    assert_eq!(cloud.positions[4_999_999].x, 4_999_999.0);
}
