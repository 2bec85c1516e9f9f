//! Every stage of the network on tiny weights, for one, two and four views and with known cameras.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DVec3};
use gspotential::camera::Camera;
use gspotential::prior::{Images, Network, Outputs, Prediction, decode, normalized};

use super::{golden, worst};
use crate::reference::npy;

/// Largest errors: absolute, or relative where said. The original's own rounding in f32 is a tenth
/// of them or less.
fn tolerance(stage: &str) -> (f64, bool) {
    match stage {
        "pos_embed" | "tokens" => (2e-6, false),
        "depth" | "depth_conf" | "ray_conf" => (3e-5, true),
        "pose_enc" | "input_pose_enc" => (1e-5, false),
        _ => (5e-5, false),
    }
}

/// Stages whose maps are `[view][channel][y][x]` on disk.
fn is_map(stage: &str) -> bool {
    stage.starts_with("head_")
}

type Stages = BTreeMap<String, Vec<f32>>;

fn network() -> Network {
    Network::read(&golden("tiny.safetensors"), Outputs::DepthAndRays)
        .unwrap_or_else(|e| panic!("{e}"))
}

fn run(network: &Network, images: &Images, cameras: Option<&[Camera]>) -> (Stages, Prediction) {
    let mut stages = Stages::new();
    let prediction = network.predict(images, cameras, &mut |name, values| {
        stages.entry(name.to_owned()).or_default().extend(values);
    });
    (stages, prediction)
}

fn images(name: &str) -> Images {
    let array = npy::read(&golden(name));
    let [_, 3, height, width] = array.shape[..] else {
        panic!("{name} has the shape {:?}", array.shape);
    };
    let values = array.values.iter().map(|x| *x as f32).collect();
    Images::from_values(values, height as u32, width as u32).unwrap_or_else(|e| panic!("{e}"))
}

/// One view of several.
fn one(all: &Images, view: usize) -> Images {
    let n = 3 * all.height * all.width;
    let values = all.values[view * n..][..n].to_vec();
    Images::from_values(values, all.height as u32, all.width as u32).expect("as the others")
}

/// The values on disk in the order that we have them in.
fn right(folder: &Path, stage: &str) -> Option<Vec<f64>> {
    let path = folder.join(format!("{stage}.npy"));
    if !path.is_file() {
        return None;
    }
    let array = npy::read(&path);
    let [views, channels, height, width] = array.shape[..] else {
        return Some(array.values);
    };
    if !is_map(stage) {
        return Some(array.values);
    }
    let mut values = Vec::new();
    for view in 0..views {
        for pixel in 0..height * width {
            let at = |c: usize| (view * channels + c) * height * width + pixel;
            values.extend((0..channels).map(|c| array.values[at(c)]));
        }
    }
    Some(values)
}

/// Holds every stage that is on disk; says the worst error of each.
fn hold(folder: &str, stages: &Stages) -> usize {
    let path = golden(folder);
    let mut n_held = 0;
    for (stage, ours) in stages {
        let Some(right) = right(&path, stage) else {
            continue;
        };
        let (most, relative) = tolerance(stage);
        let error = worst(ours, &right, relative);
        eprintln!("{folder} {stage}: {error:.1e} of {most:.0e}");
        assert!(error <= most, "{folder} {stage}: {error:e} > {most:e}");
        // The comparison must be able to fail.
        let mut altered = ours.clone();
        let middle = altered.len() / 2;
        altered[middle] += (0.01_f32).max(altered[middle].abs());
        assert!(worst(&altered, &right, relative) > most, "{folder} {stage}");
        n_held += 1;
    }
    n_held
}

fn hold_cameras(folder: &str, prediction: &Prediction, images: &Images) {
    let path = golden(folder);
    let n = prediction.views.len();
    let extrinsics = npy::read_shaped(&path.join("extrinsics.npy"), &[n, 3, 4]);
    let intrinsics = npy::read_shaped(&path.join("intrinsics.npy"), &[n, 3, 3]);
    for (i, view) in prediction.views.iter().enumerate() {
        let (width, height) = (images.width as u32, images.height as u32);
        let camera = decode(&view.pose, "view", width, height).unwrap_or_else(|e| panic!("{e}"));
        for row in 0..3 {
            let right = &extrinsics[i * 12 + row * 4..][..4];
            let ours = camera.rotation.row(row);
            let ours = [ours.x, ours.y, ours.z, camera.translation[row]];
            for (a, b) in ours.iter().zip(right) {
                assert!((a - b).abs() <= 2e-5, "{folder} view {i}: {a} {b}");
            }
        }
        let k = &intrinsics[i * 9..][..9];
        for (a, b) in [
            (camera.fx, k[0]),
            (camera.cx, k[2]),
            (camera.fy, k[4]),
            (camera.cy, k[5]),
        ] {
            assert!((a - b).abs() <= 1e-5 * b, "{folder} view {i}: {a} {b}");
        }
    }
}

#[test]
#[ignore = "needs ../shared/prior"]
fn one_view_is_seen_as_the_original_sees_it() {
    let network = network();
    let images = one(&images("tiny_input_4.npy"), 1);
    let (stages, prediction) = run(&network, &images, None);
    assert_eq!(hold("golden_1", &stages), 24);
    hold_cameras("golden_1", &prediction, &images);
}

#[test]
#[ignore = "needs ../shared/prior"]
fn every_stage_of_two_views_is_the_originals() {
    let network = network();
    let images = images("tiny_input_2.npy");
    let (stages, prediction) = run(&network, &images, None);
    assert_eq!(hold("golden_2", &stages), 48);
    hold_cameras("golden_2", &prediction, &images);
}

#[test]
#[ignore = "needs ../shared/prior"]
fn four_views_take_the_originals_reference_view() {
    let network = network();
    let images = images("tiny_input_4.npy");
    let (stages, prediction) = run(&network, &images, None);
    assert_eq!(prediction.reference, 2);
    assert_eq!(hold("golden_4", &stages), 24);
    hold_cameras("golden_4", &prediction, &images);
}

/// The known cameras of the four views.
fn known() -> Vec<Camera> {
    let path = golden("golden_pose");
    let extrinsics = npy::read_shaped(&path.join("input_extrinsics.npy"), &[4, 4, 4]);
    let intrinsics = npy::read_shaped(&path.join("input_intrinsics.npy"), &[4, 3, 3]);
    let cameras = extrinsics
        .as_chunks::<16>()
        .0
        .iter()
        .zip(intrinsics.as_chunks::<9>().0);
    cameras
        .map(|(e, k)| Camera {
            name: String::new(),
            width: 84,
            height: 56,
            fx: k[0],
            fy: k[4],
            cx: k[2],
            cy: k[5],
            rotation: DMat3::from_cols_array(&[
                e[0], e[4], e[8], e[1], e[5], e[9], e[2], e[6], e[10],
            ]),
            translation: DVec3::new(e[3], e[7], e[11]),
        })
        .collect()
}

#[test]
#[ignore = "needs ../shared/prior"]
fn known_cameras_condition_the_network() {
    let network = network();
    let images = images("tiny_input_4.npy");
    let cameras = known();
    let path = golden("golden_pose/input_extrinsics_normalised.npy");
    let right = npy::read(&path).values;
    for (camera, right) in normalized(&cameras).iter().zip(right.as_chunks::<16>().0) {
        for row in 0..3 {
            let ours = camera
                .rotation
                .row(row)
                .extend(camera.translation[row])
                .to_array();
            for (a, b) in ours.iter().zip(&right[row * 4..]) {
                assert!((a - b).abs() <= 1e-6, "{a} {b}");
            }
        }
    }
    let (stages, prediction) = run(&network, &images, Some(&cameras));
    assert_eq!(hold("golden_pose", &stages), 26);
    hold_cameras("golden_pose", &prediction, &images);
}

#[test]
#[ignore = "needs ../shared/prior"]
fn the_bytes_are_the_same_for_any_number_of_threads() {
    let network = network();
    let images = images("tiny_input_4.npy");
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .expect("starts");
        pool.install(|| run(&network, &images, None).0)
    };
    let one = with_threads(1);
    for n in [2, 5] {
        assert!(with_threads(n) == one, "{n} threads");
    }
}
