//! Cameras from rays.

use glam::{DMat3, DVec3};
use gspotential::prior::{Rays, camera_of_rays};

use super::golden;
use crate::reference::npy;

/// What the original finds depends on the samples that it draws, by this much.
const POSE: f64 = 1e-3;
const LENS: f64 = 3e-3;

fn rays(view: usize) -> Rays {
    let rays = npy::read(&golden("geom/rays.npy"));
    let confidence = npy::read(&golden("geom/rays_conf.npy"));
    let [_, height, width, 6] = rays.shape[..] else {
        panic!("{:?}", rays.shape);
    };
    let n = height * width;
    let values: Vec<f32> = rays.values.iter().map(|v| *v as f32).collect();
    let confidence = &confidence.values[view * n..][..n];
    Rays {
        height,
        width,
        rays: values.as_chunks::<6>().0[view * n..][..n].to_vec(),
        confidence: confidence.iter().map(|v| *v as f32).collect(),
    }
}

#[test]
#[ignore = "needs ../shared/prior"]
fn cameras_are_those_that_the_original_finds() {
    let text = std::fs::read(golden("geom/geom.json")).expect("is there");
    let all: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
    let right = &all["ray_pose"];
    for view in 0..3 {
        let camera = camera_of_rays(&rays(view), "view", 200, 100);
        let camera = camera.unwrap_or_else(|e| panic!("{e}"));
        let pose = |r: usize, c: usize| right["w2c"][view][r][c].as_f64().expect("a number");
        let rotation = DMat3::from_cols_array(&std::array::from_fn(|i| pose(i % 3, i / 3)));
        let translation = DVec3::new(pose(0, 3), pose(1, 3), pose(2, 3));
        assert!(camera.rotation.abs_diff_eq(rotation, POSE), "{camera:?}");
        // Centres are up to 4.4 away.
        let off = camera.translation.distance(translation);
        assert!(off < 4.4 * POSE, "view {view}: {off}");
        let lens = |key: &str, i: usize| right[key][view][i].as_f64().expect("a number");
        for (ours, right, half) in [
            (camera.fx, lens("focal", 0), 100.0),
            (camera.fy, lens("focal", 1), 50.0),
            (camera.cx, lens("principal_point", 0), 100.0),
            (camera.cy, lens("principal_point", 1), 50.0),
        ] {
            assert!((ours / half - right).abs() < LENS, "{ours} {right} {view}");
        }
    }
}

#[test]
fn rays_of_no_camera_are_refused_by_name() {
    let empty = Rays {
        height: 8,
        width: 8,
        rays: vec![[0.0; 6]; 64],
        confidence: vec![2.0; 64],
    };
    let of_nothing = Rays {
        rays: vec![[f32::NAN; 6]; 64],
        ..empty.clone()
    };
    for rays in [empty, of_nothing] {
        let error = camera_of_rays(&rays, "a.jpg", 64, 64).expect_err("is refused");
        assert!(error.to_string().contains("a.jpg"), "{error}");
    }
}
