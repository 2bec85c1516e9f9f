//! Test cameras brought into the frame of a run's model: similarities, and poses fitted to their
//! photographs.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use gspotential::camera::{Camera, Frame, Similarity};
use gspotential::scene::Scene;
use gspotential::scene::builtin::{BuiltinOptions, scene};

use crate::kit::program::{Ended, run, succeed};
use crate::scene::build::Folder;
use crate::scene::fixtures::{OPENGL, nerfstudio};

fn turn() -> Similarity {
    Similarity {
        scale: 3.7,
        rotation: DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.7, -1.9, 0.4))),
        translation: DVec3::new(12.0, -3.0, 40.0),
    }
}

const POINTS: [DVec3; 4] = [
    DVec3::new(1.0, 0.2, 0.0),
    DVec3::new(-0.4, 2.0, 0.3),
    DVec3::new(0.1, -0.7, -1.5),
    DVec3::new(0.9, 0.9, 0.8),
];

#[test]
fn a_similarity_is_found_again_from_three_points_and_more() {
    let turn = turn();
    for n in [3, 4] {
        let to: Vec<DVec3> = POINTS[..n].iter().map(|p| turn.point(*p)).collect();
        let found = Similarity::between(&POINTS[..n], &to).expect("not on a line");
        assert!((found.scale - turn.scale).abs() < 1e-12, "{found:?}");
        assert!(found.rotation.abs_diff_eq(turn.rotation, 1e-12));
        assert!(found.translation.abs_diff_eq(turn.translation, 1e-11));
    }
    // A mirrored set has no rotation that takes it there, and gets one all the same.
    let mirrored = POINTS.map(|p| DVec3::new(-p.x, p.y, p.z));
    let found = Similarity::between(&POINTS, &mirrored).expect("not on a line");
    assert!((found.rotation.determinant() - 1.0).abs() < 1e-12);
    // The least squares: no neighbour is nearer.
    let off = |s: &Similarity| -> f64 {
        let pairs = POINTS.iter().zip(&mirrored);
        pairs.map(|(a, b)| s.point(*a).distance_squared(*b)).sum()
    };
    for k in 0..7 {
        for h in [-1e-3, 1e-3] {
            let mut near = found;
            match k {
                0 => near.scale += h,
                1..4 => near.translation[k - 1] += h,
                _ => {
                    near.rotation *=
                        DMat3::from_quat(DQuat::from_scaled_axis(DVec3::AXES[k - 4] * h))
                }
            }
            assert!(off(&near) > off(&found), "{k} {h}");
        }
    }
}

#[test]
fn too_few_points_and_points_on_a_line_fix_no_similarity() {
    let error = |points: &[DVec3]| {
        let result = Similarity::between(points, &POINTS[..points.len()]);
        result.expect_err("no similarity").to_string()
    };
    assert!(error(&POINTS[..2]).contains("3 pairs"));
    let line = [0.0, 1.0, 2.0, 5.0].map(|t| POINTS[0] + t * POINTS[1]);
    assert!(error(&line).contains("on a line"));
    assert!(error(&[POINTS[0]; 4]).contains("on a line"));
    assert!(error(&[DVec3::NAN; 3]).contains("on a line"));
    let mut bent = line;
    bent[1] += 0.3 * POINTS[2];
    assert!(Similarity::between(&bent, &POINTS).is_ok());
}

#[test]
fn a_camera_sees_in_the_new_frame_what_it_saw_in_the_old_one() {
    let turn = turn();
    let eye = DVec3::new(2.0, 1.0, 0.5);
    let scene = small_scene();
    let camera = scene.test[0]
        .camera
        .looking_at("a".into(), eye, DVec3::ZERO, DVec3::Z);
    let there = turn.camera(&camera);
    for p in POINTS {
        let (a, b) = (camera.rotation * p + camera.translation, turn.point(p));
        let b = there.rotation * b + there.translation;
        assert!((a * turn.scale).abs_diff_eq(b, 1e-12), "{a} {b}");
    }
    let frame = Frame {
        center: DVec3::new(0.1, 0.2, 0.3),
        radius: 2.5,
        extent: 2.5,
    };
    let back = frame.camera_to_world(&frame.camera_to_canonical(&camera));
    assert!(back.translation.abs_diff_eq(camera.translation, 1e-14));
}

fn small_scene() -> Scene {
    scene(&BuiltinOptions {
        width: 96,
        n_test: 3,
        pixel_step: 2,
        ..BuiltinOptions::default()
    })
}

/// Puts another frame's poses and points into the scene's folder.
fn rewrite(folder: &Folder, scene: &Scene) {
    let other = nerfstudio(scene, OPENGL);
    for name in ["transforms.json", "sparse_pc.ply"] {
        std::fs::copy(other.path().join(name), folder.path().join(name)).expect("a copy");
    }
}

/// Mean PSNR at the test views, dB, and the table.
fn psnr(folder: &Path, align: &str) -> (f64, String) {
    let output = succeed(folder, &format!("eval run --align {align}"));
    let eval = std::fs::read(folder.join("run/eval.json")).expect("written");
    let eval: serde_json::Value = serde_json::from_slice(&eval).expect("JSON");
    let psnr = eval["mean"]["psnr"].as_f64().expect("a PSNR");
    (psnr, output.stdout)
}

/// Turned by about `degrees` about its centre, which moves by `shift`.
fn jolted(camera: &Camera, degrees: f64, shift: f64) -> Camera {
    let w = degrees.to_radians() / 3f64.sqrt();
    camera.moved([w, -w, w, shift, shift, -shift])
}

#[test]
fn test_views_are_measured_alike_in_any_frame_and_fitted_poses_find_back() {
    let own = small_scene();
    let folder = nerfstudio(&own, OPENGL);
    let root = folder.path();
    let train = "train --scene . --out run --iterations 250 --set views.count=8 --max-points 3000";
    succeed(root, train);
    let (shared, table) = psnr(root, "shared");
    assert!(table.contains("in one frame"), "{table}");

    // In another frame the scene's test cameras are worth nothing as they are.
    let mut moved = own.clone();
    let turn = turn();
    for view in moved.train.iter_mut().chain(&mut moved.test) {
        view.camera = turn.camera(&view.camera);
    }
    for p in &mut moved.cloud.positions {
        *p = turn.point(*p);
    }
    rewrite(&folder, &moved);
    let (astray, _) = psnr(root, "shared");
    let (similar, table) = psnr(root, "similarity");
    assert!(astray < shared - 3.0, "{astray} {shared}");
    assert!((similar - shared).abs() < 0.01, "{similar} {shared}");
    assert!(table.contains("a similarity fitted"), "{table}");

    // Test poses that are off lower the figures, and are found again.
    let shift = 0.03 * turn.scale;
    for view in &mut moved.test {
        view.camera = jolted(&view.camera, 1.5, shift);
    }
    rewrite(&folder, &moved);
    let (off, _) = psnr(root, "similarity");
    let (fitted, table) = psnr(root, "fit");
    assert!(off < shared - 0.4, "{off} {shared}");
    assert!(fitted > shared - 0.1, "{fitted} {shared}");
    assert!(table.contains("fitted to the test photographs"), "{table}");
    eprintln!("shared {shared:.2}, similarity {similar:.2}, off {off:.2}, fitted {fitted:.2} dB");

    // Training cameras on a line, or another one, fix no frame.
    for (i, view) in moved.train.iter_mut().enumerate() {
        let camera = &mut view.camera;
        let eye = DVec3::new(1.0, 2.0, 3.0) * (i as f64 + 1.0);
        camera.translation = -(camera.rotation * eye);
    }
    rewrite(&folder, &moved);
    let Ended { code, log, .. } = run(root, "eval run --align similarity");
    assert_eq!(code, Some(1), "{log}");
    assert!(
        log.contains("on a line") && log.contains("training cameras"),
        "{log}"
    );
}
