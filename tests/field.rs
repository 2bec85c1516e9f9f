//! Pseudo-focus and potential field against exact geometry and degenerate layouts.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec3, dvec3};
use gspotential::camera::Camera;
use gspotential::config::{FieldConfig, Kernel};
use gspotential::field::{Coverage, Field, Focus, fibonacci_sphere};
use gspotential::scene::PointCloud;

use crate::geometry::{Random, camera, cloud, paper, ring};

fn field_of(directions: &[DVec3]) -> Field {
    let FieldConfig { sigma, lambda, .. } = paper().field;
    Field {
        directions: directions.to_vec(),
        kernel: Kernel::Sech,
        sigma,
        lambda,
    }
}

fn error_of(cameras: &[Camera], cloud: &PointCloud) -> String {
    match Focus::find(cameras, cloud) {
        Ok(focus) => panic!("found {focus:?}"),
        Err(e) => e.to_string(),
    }
}

#[test]
fn axes_that_cross_give_their_crossing_and_the_greatest_distance() {
    let target = dvec3(1.0, -2.0, 0.5);
    let mut cameras = ring(4, target);
    cameras.push(camera(target + dvec3(0.0, 5.0, -1.0), target));
    let focus = Focus::find(&cameras, &PointCloud::default()).unwrap();
    assert!(focus.center.distance(target) < 1e-12, "{focus:?}");
    assert!((focus.radius - 26f64.sqrt()).abs() < 1e-12, "{focus:?}");
    assert_eq!(focus.fallback, None);
}

#[test]
fn one_camera_far_away_moves_the_sphere_but_not_the_extent_and_the_near_plane() {
    let target = dvec3(1.0, -2.0, 0.5);
    let of = |cameras: &[Camera]| Focus::find(cameras, &PointCloud::default()).unwrap();
    let ordinary = of(&ring(4, target));
    // Bit for bit: nothing changes where no camera is far.
    assert_eq!(ordinary.extent, ordinary.radius);
    assert_eq!(ordinary.frame().near(0.01), 0.01);
    let reach = 13f64.sqrt();
    for far in [50.0, 1e4] {
        let mut cameras = ring(4, target);
        cameras.push(camera(target + dvec3(0.0, far, 0.0), target));
        let focus = of(&cameras);
        assert!((focus.radius - far).abs() < 1e-6 * far);
        assert!(
            (focus.extent - 2.0 * reach).abs() < 1e-6 * reach,
            "{focus:?}"
        );
        let near = focus.frame().near(0.01) * focus.radius;
        assert!((near - 0.02 * reach).abs() < 1e-6, "{near}");
    }
    // Nor does one that stands at the focus.
    let mut cameras = ring(1, target);
    cameras.push(camera(
        target + dvec3(1e-6, 0.0, 0.0),
        target + dvec3(3.0, 0.0, 0.0),
    ));
    let focus = of(&cameras);
    assert_eq!(focus.extent, focus.radius);
}

#[test]
fn skew_axes_give_the_least_squares_point() {
    // Axes along x at z = 1 and along y at z = -2: midway between them, above the crossing.
    let cameras = [
        camera(dvec3(-4.0, 0.0, 1.0), dvec3(0.0, 0.0, 1.0)),
        camera(dvec3(0.0, -4.0, -2.0), dvec3(0.0, 0.0, -2.0)),
    ];
    let focus = Focus::find(&cameras, &PointCloud::default()).unwrap();
    assert!(
        focus.center.distance(dvec3(0.0, 0.0, -0.5)) < 1e-12,
        "{focus:?}"
    );
}

#[test]
fn focus_is_a_minimum_of_the_squared_distances_to_the_axes() {
    let mut random = Random::new(5);
    let cameras: Vec<Camera> = (0..6)
        .map(|_| camera(random.in_cube(4.0), random.in_cube(1.0)))
        .collect();
    let cost = |x: DVec3| -> f64 {
        cameras
            .iter()
            .map(|c| (x - c.center()).cross(c.forward()).length_squared())
            .sum()
    };
    let c = Focus::find(&cameras, &PointCloud::default())
        .unwrap()
        .center;
    for axis in DVec3::AXES {
        for step in [-1e-4, 1e-4] {
            assert!(cost(c + axis * step) > cost(c));
        }
        let slope = (cost(c + axis * 1e-4) - cost(c - axis * 1e-4)) / 2e-4;
        assert!(slope.abs() < 1e-8, "slope {slope} along {axis}");
    }
}

#[test]
fn focus_follows_the_scenes_unit_and_origin() {
    let cameras = ring(5, DVec3::ZERO);
    for unit in [1e-6, 1.0, 1e6] {
        for shift in [DVec3::ZERO, dvec3(1e5, -2e5, 3e5) * unit] {
            let moved: Vec<Camera> = cameras
                .iter()
                .map(|c| Camera {
                    translation: -(c.rotation * (c.center() * unit + shift)),
                    ..c.clone()
                })
                .collect();
            let focus = Focus::find(&moved, &PointCloud::default()).unwrap();
            let radius = 13f64.sqrt() * unit;
            // 3e5 R away, f64 itself keeps 6e-11 R.
            assert!(focus.center.distance(shift) < 1e-9 * radius, "{focus:?}");
            assert!((focus.radius / radius - 1.0).abs() < 1e-9, "{focus:?}");
        }
    }
}

#[test]
fn one_camera_takes_the_clouds_median_depth_and_says_so() {
    let eye = dvec3(1.0, 1.0, 1.0);
    let forward = dvec3(0.0, 3.0, 4.0) / 5.0;
    let side = dvec3(1.0, 0.0, 0.0);
    let at = |depth: f64, x: f64| eye + forward * depth + side * x;
    // The point behind the camera does not count, nor do sideways offsets.
    let points = cloud(vec![
        at(-9.0, 0.0),
        at(1.0, 3.0),
        at(2.0, -1.0),
        at(7.0, 0.5),
    ]);
    let cameras = [camera(eye, eye + forward)];
    let focus = Focus::find(&cameras, &points).unwrap();
    assert!(focus.center.distance(at(2.0, 0.0)) < 1e-9, "{focus:?}");
    assert!((focus.radius - 2.0).abs() < 1e-9);
    assert!(focus.fallback.unwrap().contains("one camera"));
}

#[test]
fn fallback_median_is_weighted_by_confidence() {
    let mut points = cloud((1..=5).map(|d| dvec3(0.0, 0.0, f64::from(d))).collect());
    let cameras = [camera(DVec3::ZERO, DVec3::Z)];
    for (confidence, depth) in [
        (vec![1.0, 1.0, 1.0, 1.0, 9.0], 5.0),
        (vec![9.0, 1.0, 1.0, 1.0, 1.0], 1.0),
        (vec![1.0, 1.0, 1.0, 1.0, 0.0], 2.0),
        // Weights that mean nothing count as none; without any, all count alike.
        (vec![f32::NAN, f32::INFINITY, -9.0, 1.0, 0.0], 4.0),
        (vec![0.0; 5], 3.0),
    ] {
        points.confidence = Some(confidence);
        let focus = Focus::find(&cameras, &points).unwrap();
        assert!((focus.center.z - depth).abs() < 1e-9, "{depth}: {focus:?}");
    }
}

#[test]
fn parallel_axes_fall_back_and_nearly_parallel_ones_too() {
    let points = cloud(vec![dvec3(0.0, 0.0, 4.0); 3]);
    let layout = |toe_in: f64| -> Vec<Camera> {
        [-1.0, 0.0, 1.0]
            .map(|x| camera(dvec3(x, 0.0, 0.0), dvec3(x * (1.0 - toe_in), 0.0, 1.0)))
            .to_vec()
    };
    for toe_in in [0.0, 1e-9, 0.01] {
        let focus = Focus::find(&layout(toe_in), &points).unwrap();
        assert!(
            focus.center.distance(dvec3(0.0, 0.0, 4.0)) < 1e-6,
            "{focus:?}"
        );
        assert!(focus.fallback.unwrap().contains("parallel"));
    }
    // Axes 5.7 degrees off the middle one meet reliably, 10 away.
    let focus = Focus::find(&layout(0.1), &points).unwrap();
    assert_eq!(focus.fallback, None);
    assert!(
        focus.center.distance(dvec3(0.0, 0.0, 10.0)) < 1e-9,
        "{focus:?}"
    );
}

#[test]
fn opposed_axes_fall_back_to_the_cloud_between_the_cameras() {
    let points = cloud(vec![
        dvec3(0.5, 0.1, 0.0),
        dvec3(1.0, 0.0, 0.2),
        dvec3(1.5, 0.0, 0.0),
    ]);
    let cameras = [
        camera(dvec3(-4.0, 0.0, 0.0), DVec3::ZERO),
        camera(dvec3(4.0, 0.0, 0.0), DVec3::ZERO),
    ];
    let focus = Focus::find(&cameras, &points).unwrap();
    assert!(
        focus.center.distance(dvec3(1.0, 0.0, 0.0)) < 1e-9,
        "{focus:?}"
    );
    assert!((focus.radius - 5.0).abs() < 1e-9);
    assert!(focus.fallback.is_some());
}

#[test]
fn coincident_cameras_fall_back() {
    let points = cloud(vec![dvec3(0.0, 0.0, 2.0)]);
    let cameras = vec![camera(DVec3::ZERO, DVec3::Z); 4];
    let focus = Focus::find(&cameras, &points).unwrap();
    assert!(
        focus.center.distance(dvec3(0.0, 0.0, 2.0)) < 1e-9,
        "{focus:?}"
    );
    assert!((focus.radius - 2.0).abs() < 1e-9);
    assert!(focus.fallback.is_some());
}

#[test]
fn collinear_cameras_with_crossing_axes_need_no_fallback() {
    let target = dvec3(0.0, 0.0, 3.0);
    let cameras = [-1.0, 0.0, 1.0, 2.0].map(|x| camera(dvec3(x, 0.0, 0.0), target));
    let focus = Focus::find(&cameras, &PointCloud::default()).unwrap();
    assert!(focus.center.distance(target) < 1e-12, "{focus:?}");
    assert_eq!(focus.fallback, None);
}

#[test]
fn cameras_that_share_one_centre_fall_back_along_their_mean_axis() {
    let points = cloud(
        (0..9)
            .map(|i| dvec3(0.1 * f64::from(i), 0.0, 5.0))
            .collect(),
    );
    let cameras = [-0.5, 0.0, 0.5].map(|x| camera(DVec3::ZERO, dvec3(x, 0.0, 1.0)));
    let focus = Focus::find(&cameras, &points).unwrap();
    assert!(
        focus.center.distance(dvec3(0.0, 0.0, 5.0)) < 1e-9,
        "{focus:?}"
    );
    assert!(focus.fallback.is_some());
}

#[test]
fn layouts_without_a_sphere_are_errors() {
    let points = cloud(vec![dvec3(0.0, 0.0, 5.0)]);
    assert!(error_of(&[], &points).contains("no training camera"));
    // A full panorama from one place.
    let panorama = [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y].map(|d| camera(DVec3::ZERO, d));
    assert!(error_of(&panorama, &points).contains("all directions"));
    // One camera and nothing in front of it.
    let away = [camera(DVec3::ZERO, -DVec3::Z)];
    assert!(error_of(&away, &points).contains("in front of a camera"));
    let mut broken = ring(3, DVec3::ZERO);
    broken[1].translation.x = f64::NAN;
    broken[1].name = "b.jpg".into();
    assert!(error_of(&broken, &points).starts_with("b.jpg: "));
    // So far apart that squares overflow.
    let far = [
        camera(dvec3(1e200, 0.0, 0.0), DVec3::ZERO),
        camera(DVec3::Y * 1e200, DVec3::ZERO),
    ];
    match Focus::find(&far, &points) {
        Ok(focus) => assert!(focus.center.is_finite() && focus.radius.is_finite()),
        Err(e) => assert!(e.to_string().contains("finite") || e.to_string().contains("sphere")),
    }
}

#[test]
fn one_cameras_influence_is_one_percent_at_the_hemispheres_edge() {
    let field = field_of(&[DVec3::X]);
    assert!((field.u_info(DVec3::X) - 1.0).abs() < 1e-15);
    assert!((field.u_info(DVec3::Y) - 0.01).abs() < 1e-15);
    assert!(field.u_info(-DVec3::X) < 1e-4);
}

#[test]
fn potentials_agree_with_their_definitions() {
    let mut random = Random::new(7);
    let directions: Vec<DVec3> = (0..5).map(|_| random.in_cube(1.0).normalize()).collect();
    let field = field_of(&directions);
    for _ in 0..100 {
        let p = random.in_cube(1.0).normalize();
        let mut info = 0.0;
        let mut cos_nearest = -1.0f64;
        for v in &directions {
            let x = field.sigma * (1.0 - (p.x * v.x + p.y * v.y + p.z * v.z));
            info += 2.0 / (x.exp() + (-x).exp());
            cos_nearest = cos_nearest.max(p.x * v.x + p.y * v.y + p.z * v.z);
        }
        assert!((field.u_info(p) - info).abs() < 1e-14);
        assert!((field.u_conf(p) - cos_nearest.acos()).abs() < 1e-7);
        assert!((field.u_total(p) - info - 0.2 * cos_nearest.acos()).abs() < 1e-7);
        let nearest = directions[field.nearest(p)];
        assert!((p.dot(nearest) - cos_nearest).abs() < 1e-15);
    }
}

#[test]
fn von_mises_fisher_decays_to_one_percent_at_90_degrees_with_ln_100() {
    let lone = |sigma: f64| Field {
        kernel: Kernel::VonMisesFisher,
        sigma,
        ..field_of(&[DVec3::X])
    };
    let field = lone(100f64.ln());
    assert_eq!(field.u_info(DVec3::X), 1.0);
    assert!((field.u_info(DVec3::Y) - 0.01).abs() < 1e-15);
    assert!((field.u_info(-DVec3::X) - 1e-4).abs() < 1e-15);
    // The density's shape, exp(kappa p . v), up to its value at the peak.
    let p = dvec3(0.6, 0.8, 0.0);
    let expected = f64::exp(3.0 * 0.6) / f64::exp(3.0);
    assert!((lone(3.0).u_info(p) - expected).abs() < 1e-15);
    // The paper's reason for sech: with the same 1 %, it is the wider one in between.
    let sech = field_of(&[DVec3::X]);
    assert!(sech.u_info(p) > field.u_info(p));
}

#[test]
fn the_configs_kernel_is_the_fields_and_kernels_sum_over_cameras() {
    let cameras = ring(3, DVec3::ZERO);
    let focus = Focus::find(&cameras, &PointCloud::default()).unwrap();
    let config = paper().set("field.kernel=von_mises_fisher").unwrap();
    let field = Field::new(&cameras, &focus, &config.field);
    assert_eq!(field.kernel, Kernel::VonMisesFisher);
    assert_eq!(
        Field::new(&cameras, &focus, &paper().field).kernel,
        Kernel::Sech
    );
    let p = dvec3(0.0, 0.6, 0.8);
    let sum: f64 = field
        .directions
        .iter()
        .map(|v| (config.field.sigma * (p.x * v.x + p.y * v.y + p.z * v.z - 1.0)).exp())
        .sum();
    assert!((field.u_info(p) - sum).abs() < 1e-14);
}

#[test]
fn nearest_angle_is_exact_where_arccos_is_not() {
    let field = field_of(&[DVec3::X]);
    for theta in [0.0, 1e-9, 1e-5, FRAC_PI_2, PI - 1e-9, PI] {
        let (sin, cos) = f64::sin_cos(theta);
        let u_conf = field.u_conf(dvec3(cos, sin, 0.0));
        assert!((u_conf - theta).abs() < 1e-15, "{theta}: {u_conf}");
    }
}

#[test]
fn field_directions_point_to_the_cameras_even_from_a_camera_at_the_focus() {
    let target = dvec3(1e5, 2.0, 3.0);
    let mut cameras = ring(3, target);
    cameras.push(camera(target, target + DVec3::Y));
    let focus = Focus {
        center: target,
        radius: 13f64.sqrt(),
        extent: 13f64.sqrt(),
        fallback: None,
    };
    let field = Field::new(&cameras, &focus, &paper().field);
    for (camera, v) in cameras.iter().zip(&field.directions) {
        assert!((v.length() - 1.0).abs() < 1e-12);
        // All of these look at the focus, or stand in it and look away from -v.
        assert!((camera.forward() + *v).length() < 1e-9, "{v}");
    }
}

#[test]
fn coverage_is_normalised_over_the_grid() {
    let field = field_of(&[DVec3::X, dvec3(0.0, 0.6, 0.8)]);
    let grid = fibonacci_sphere(4096);
    let coverage = Coverage::new(&field, &grid);
    let potentials: Vec<f64> = grid.iter().map(|p| field.u_info(*p)).collect();
    let min = potentials.iter().copied().fold(f64::INFINITY, f64::min);
    let max = potentials.iter().copied().fold(0.0, f64::max);
    assert_eq!(coverage.norm_q(min), 0.0);
    assert_eq!(coverage.norm_q(max), 1.0);
    assert!((coverage.norm_q(0.5 * (min + max)) - 0.5).abs() < 1e-12);
    // Off the grid a score may lie a little outside: clamped.
    assert_eq!(coverage.norm_q(max + 1.0), 1.0);
    assert_eq!(coverage.norm_q(min - 1.0), 0.0);
    // A Gaussian's distance does not matter, only its direction; the focus has none.
    let x = dvec3(0.3, -0.2, 0.5);
    assert_eq!(coverage.q(x * 4.0), coverage.q(x));
    assert!((coverage.q(x) - field.u_info(x.normalize())).abs() < 1e-15);
    let mean = potentials.iter().sum::<f64>() / 4096.0;
    assert!((coverage.q(DVec3::ZERO) - mean).abs() < 1e-12);
    // Behind the focus, seen from camera 0, coverage is low; before it, high.
    assert!(coverage.norm_q(coverage.q(-DVec3::X)) < 0.02);
    assert!(coverage.norm_q(coverage.q(DVec3::X)) > 0.95);
}

#[test]
fn a_flat_field_counts_as_covered() {
    let field = Field {
        sigma: 0.0,
        ..field_of(&[DVec3::X])
    };
    let coverage = Coverage::new(&field, &fibonacci_sphere(64));
    assert_eq!(coverage.norm_q(coverage.q(-DVec3::X)), 1.0);
}

#[test]
fn fibonacci_directions_are_unit_and_nearly_uniform() {
    let n = 4096;
    let grid = fibonacci_sphere(n);
    let mean: DVec3 = grid.iter().sum::<DVec3>() / n as f64;
    assert!(mean.length() < 1e-3, "{mean}");
    // Each direction has its share of the sphere: the nearest other is about as far as on a
    // hexagonal lattice of that density.
    let spacing = (8.0 * PI / (3f64.sqrt() * n as f64)).sqrt();
    for (i, p) in grid.iter().enumerate() {
        assert!((p.length() - 1.0).abs() < 1e-12);
        let nearest = grid
            .iter()
            .enumerate()
            .filter(|(j, _)| *j != i)
            .map(|(_, q)| p.distance(*q))
            .fold(f64::INFINITY, f64::min);
        assert!(
            (0.5..1.2).contains(&(nearest / spacing)),
            "{i}: {nearest} of {spacing}"
        );
    }
}
