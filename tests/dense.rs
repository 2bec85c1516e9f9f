//! Depth maps to one cloud.

use glam::{DMat3, DVec3};
use gspotential::camera::Camera;
use gspotential::dense::{CloudOptions, DepthMap, cloud, scale_of_cameras, scale_to_points};

const SIZE: u32 = 48;

/// A camera `x` to the right of the origin that looks along z.
fn camera(x: f64) -> Camera {
    Camera {
        name: format!("{x}"),
        width: SIZE,
        height: SIZE,
        fx: 60.0,
        fy: 60.0,
        cx: 24.0,
        cy: 24.0,
        rotation: DMat3::from_rotation_y(0.05 * x),
        translation: DMat3::from_rotation_y(0.05 * x) * DVec3::new(-x, 0.0, 0.0),
    }
}

/// A plane that rises to the right: z = 4 + x / 4.
fn plane_depth(camera: &Camera, x: u32, y: u32) -> f64 {
    let ray = DVec3::new(
        (f64::from(x) + 0.5 - camera.cx) / camera.fx,
        (f64::from(y) + 0.5 - camera.cy) / camera.fy,
        1.0,
    );
    let (ray, eye) = (camera.rotation.transpose() * ray, camera.center());
    (4.0 + eye.x / 4.0 - eye.z) / (ray.z - ray.x / 4.0)
}

fn map(camera: Camera) -> DepthMap {
    let pixels = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y)));
    let depth = pixels
        .map(|(x, y)| plane_depth(&camera, x, y) as f32)
        .collect();
    let n = (SIZE * SIZE) as usize;
    DepthMap {
        depth,
        confidence: (0..n).map(|i| 1.0 + i as f32).collect(),
        colors: vec![[1, 2, 3]; n],
        camera,
    }
}

fn maps() -> Vec<DepthMap> {
    [-0.5, 0.0, 0.5].map(|x| map(camera(x))).to_vec()
}

const ALL: CloudOptions = CloudOptions { share: 1.0 };

#[test]
fn exact_depths_become_points_on_the_surface() {
    let made = cloud(&maps(), ALL);
    assert_eq!(made.points.len(), 3 * (SIZE * SIZE) as usize);
    let off = |p: &DVec3| (p.z - 4.0 - p.x / 4.0).abs();
    let worst = made.points.positions.iter().map(off).fold(0.0, f64::max);
    // Half a pixel beside it would be 8e-3.
    assert!(worst < 1e-5, "{worst}");
    for view in 0..3 {
        assert_eq!(
            made.views.iter().filter(|v| **v == view).count(),
            (SIZE * SIZE) as usize
        );
    }
}

#[test]
fn the_surest_pixels_of_each_view_are_kept() {
    let made = cloud(&maps(), CloudOptions { share: 0.25 });
    let n = (SIZE * SIZE) as usize;
    assert_eq!(made.points.len() + made.n_unsure, 3 * n);
    assert!(
        made.points.len().abs_diff(3 * n / 4) <= 6,
        "{}",
        made.points.len()
    );
    let confidence = made.points.confidence.expect("has them");
    assert!(confidence.iter().all(|c| *c > 0.74 * n as f32));
}

#[test]
fn pixels_between_two_surfaces_are_left_out() {
    let mut maps = vec![map(camera(0.0))];
    for y in 0..SIZE as usize {
        for x in 0..10 {
            maps[0].depth[y * SIZE as usize + x] *= 0.5;
        }
    }
    let made = cloud(&maps, ALL);
    // The columns on both sides of the step.
    assert_eq!(made.n_edges, 2 * SIZE as usize);
}

#[test]
fn what_other_views_see_through_goes() {
    let mut maps = maps();
    let middle = |x: usize, y: usize| (16..32).contains(&x) && (16..32).contains(&y);
    for y in 0..SIZE as usize {
        for x in 0..SIZE as usize {
            if middle(x, y) {
                maps[1].depth[y * SIZE as usize + x] *= 0.6;
            }
        }
    }
    let made = cloud(&maps, ALL);
    let hangs = |p: &DVec3| p.z < 3.0 + p.x / 4.0;
    assert!(made.n_denied > 100, "{}", made.n_denied);
    assert!(!made.points.positions.iter().any(hangs));
    // With nobody to deny it, it stays.
    let alone = cloud(&maps[1..2], ALL);
    assert!(alone.points.positions.iter().any(hangs));
}

#[test]
fn depths_that_are_none_become_no_points() {
    let mut maps = maps();
    for (i, value) in [f32::NAN, f32::INFINITY, 0.0, -1.0].into_iter().enumerate() {
        maps[0].depth[1000 + 3 * i] = value;
    }
    let made = cloud(&maps, ALL);
    assert!(
        made.points
            .positions
            .iter()
            .all(|p| p.is_finite() && p.z > 0.0)
    );
    assert_eq!(made.n_unsure, 4);
}

#[test]
fn known_points_give_the_scale() {
    let mut maps = maps();
    let points = cloud(&maps, ALL).points.positions;
    for map in &mut maps {
        map.depth.iter_mut().for_each(|depth| *depth /= 1.3);
    }
    let scale = scale_to_points(&maps, &points[..500]).expect("are seen");
    assert!((scale - 1.3).abs() < 0.01, "{scale}");
    assert_eq!(scale_to_points(&maps, &points[..2]), None);
}

#[test]
fn cameras_on_a_line_give_the_scale_too() {
    let known: Vec<Camera> = [-0.5, 0.0, 0.5].map(camera).to_vec();
    let longer = |camera: &Camera| Camera {
        translation: 3.0 * camera.translation,
        ..camera.clone()
    };
    let found: Vec<Camera> = known.iter().map(longer).collect();
    for n in [2, 3] {
        let scale = scale_of_cameras(&known[..n], &found[..n]);
        assert!((scale - 3.0).abs() < 1e-9, "{n}: {scale}");
    }
    assert_eq!(scale_of_cameras(&known[..1], &found[..1]), 1.0);
}
