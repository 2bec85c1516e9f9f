//! Depth maps to one cloud.

use glam::{DMat3, DVec3};
use gspotential::camera::Camera;
use gspotential::dense::{
    CloudOptions, DepthMap, adjust, cloud, scale_of_cameras, scale_to_points,
};

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

/// A wavy, coloured surface, found along each ray by halving.
fn wavy(camera: Camera) -> DepthMap {
    let height = |x: f64, y: f64| 4.0 + 0.25 * x + 0.3 * (2.0 * x).sin() * (1.5 * y).cos();
    let (turn, eye) = (camera.rotation.transpose(), camera.center());
    let depth = |x: u32, y: u32| {
        let place = |n: u32, c: f64, f: f64| (f64::from(n) + 0.5 - c) / f;
        let ray = turn
            * DVec3::new(
                place(x, camera.cx, camera.fx),
                place(y, camera.cy, camera.fy),
                1.0,
            );
        let (mut near, mut far) = (1.0, 9.0);
        for _ in 0..60 {
            let middle = 0.5 * (near + far);
            let p = eye + ray * middle;
            if p.z < height(p.x, p.y) {
                near = middle
            } else {
                far = middle
            }
        }
        near
    };
    let pixels = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y)));
    let depth: Vec<f32> = pixels.map(|(x, y)| depth(x, y) as f32).collect();
    let n = depth.len();
    let mut map = DepthMap {
        confidence: vec![1.0; n],
        colors: vec![[0; 3]; n],
        depth,
        camera,
    };
    for i in 0..n {
        let (x, y) = (i % SIZE as usize, i / SIZE as usize);
        let p = map.point(x, y, f64::from(map.depth[i]));
        let level = 128.0 + 60.0 * (3.0 * p.x).sin() + 60.0 * (2.5 * p.y + p.x).cos();
        map.colors[i] = [level as u8; 3];
    }
    map
}

/// Median distance between where a view's pixels are in the other views, and where they should be.
fn off_px(maps: &[DepthMap], right: &[DepthMap]) -> f64 {
    let mut off = Vec::new();
    for (ours, truth) in maps.iter().zip(right) {
        for (other, other_truth) in maps.iter().zip(right) {
            for i in 0..ours.depth.len() {
                let (x, y) = (i % SIZE as usize, i / SIZE as usize);
                let (a, b) = (f64::from(ours.depth[i]), f64::from(truth.depth[i]));
                let place = other.camera.project(ours.point(x, y, a)).0;
                let truth = other_truth.camera.project(truth.point(x, y, b)).0;
                if other.camera.name != ours.camera.name && other_truth.pixel(truth).is_some() {
                    off.push(place.distance(truth));
                }
            }
        }
    }
    off.sort_by(f64::total_cmp);
    off[off.len() / 2]
}

#[test]
fn cameras_and_scales_that_are_off_are_found_again() {
    let right: Vec<DepthMap> = [-1.0, 0.0, 1.0].map(|x| wavy(camera(x))).to_vec();
    let one = 1_f64.to_radians();
    let motions = [
        [0.0, one, 0.0, 0.0, 0.04, 0.0],
        [one, 0.0, 0.0, 0.04, 0.0, 0.0],
        [0.0, -one, 0.0, -0.04, 0.0, 0.0],
    ];
    let mut off = right.clone();
    for ((map, motion), scale) in off.iter_mut().zip(motions).zip([1.03, 0.97, 1.03]) {
        map.camera = map.camera.moved(motion);
        map.depth.iter_mut().for_each(|depth| *depth *= scale);
    }
    let adjusted = adjust(&off);
    let (before, after) = (off_px(&off, &right), off_px(&adjusted.maps, &right));
    eprintln!(
        "{before:.3} px before, {after:.3} after; {:?}",
        adjusted.residual
    );
    assert!(adjusted.kept && before > 0.8, "{before}");
    assert!(after < 0.25 * before, "{before} {after}");
    // Views that are right stay where they are.
    let still = adjust(&right);
    assert!(
        !still.kept && still.residual[1] > 0.95 * still.residual[0],
        "{:?}",
        still.residual
    );
    assert_eq!(off_px(&still.maps, &right), 0.0);
}

#[test]
fn one_view_has_nothing_to_be_adjusted_by() {
    let maps = maps();
    let adjusted = adjust(&maps[..1]);
    assert!(!adjusted.kept);
    assert!(adjusted.maps[0].depth == maps[0].depth);
}
