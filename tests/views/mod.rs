//! Sampling of virtual views and the cameras placed there.

mod strategies;

use glam::{DVec3, dvec3};
use gspotential::camera::Camera;
use gspotential::config::{Config, Strategy};
use gspotential::field::{Field, Focus, Outlook, fibonacci_sphere};
use gspotential::scene::PointCloud;
use gspotential::views::{
    Viewpoint, VirtualView, candidates, draw_without_replacement, place, potential_weights,
    virtual_views,
};

use crate::geometry::{camera, paper, ring};

fn around(train: &[Camera], config: &Config) -> (Focus, Field) {
    let focus = Focus::find(train, &PointCloud::default()).unwrap();
    let field = Field::new(train, &focus, &config.field);
    (focus, field)
}

fn views_of(train: &[Camera], config: &Config) -> Vec<VirtualView> {
    let (focus, field) = around(train, config);
    virtual_views(train, &focus, &field, None, config).unwrap()
}

/// `n` cameras on a circle of radius 1 around `c` that look away from it, or at it where `inward` says.
fn outward_ring(n: usize, c: DVec3, inward: impl Fn(usize) -> bool) -> Vec<Camera> {
    (0..n)
        .map(|i| {
            let (sin, cos) = (i as f64 * std::f64::consts::TAU / n as f64).sin_cos();
            let offset = dvec3(cos, sin, 0.3);
            let target = if inward(i) { c } else { c + 3.0 * offset };
            camera(c + offset, target)
        })
        .collect()
}

#[test]
fn outward_layouts_are_told_from_inward_and_mixed_ones() {
    let c = dvec3(4.0, -1.0, 2.0);
    let outlook = |n_in: usize| {
        let train = outward_ring(8, c, |i| i < n_in);
        let focus = Focus::find(&train, &PointCloud::default()).unwrap();
        let outlook = Outlook::of(&train, &focus);
        assert_eq!(outlook.away.len(), 8 - n_in);
        (outlook.is_outward(), outlook.warning(&train))
    };
    assert_eq!(outlook(8), (false, None));
    let (outward, warning) = outlook(0);
    assert!(outward);
    let warning = warning.unwrap();
    assert!(
        warning.contains("8 of 8") && warning.contains("outward"),
        "{warning}"
    );
    let (outward, warning) = outlook(6);
    assert!(!outward);
    let warning = warning.unwrap();
    assert!(
        warning.contains("2 of 8") && !warning.contains("outward"),
        "{warning}"
    );
    assert!(outlook(4).0);
}

#[test]
fn views_of_an_outward_layout_stand_among_the_cameras_and_look_as_they_look() {
    let c = dvec3(4.0, -1.0, 2.0);
    let train = outward_ring(8, c, |_| false);
    let mut config = paper();
    config.views.count = 40;
    config.field.n_candidates = 200;
    let mut seen = Vec::new();
    for strategy in [
        Strategy::Potential,
        Strategy::NearestAngle,
        Strategy::SphereUniform,
        Strategy::SphereFarthest,
        Strategy::Interpolation,
    ] {
        config.views.strategy = strategy;
        let views = views_of(&train, &config);
        assert_eq!(views.len(), 40);
        for (k, view) in views.iter().enumerate() {
            let camera = &view.camera;
            assert_eq!(camera.name, format!("virtual_{k:03}"));
            assert!(camera.center().distance(c) < 1.05, "{}", camera.center());
            let nearest = train
                .iter()
                .map(|t| camera.forward().angle_between(t.forward()));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.5, "looks where no camera looks: {nearest}");
            assert!((view.u_conf - nearest).abs() < 1e-6);
            assert!((view.alpha - 1.0 / (1.0 + view.u_conf)).abs() < 1e-12);
            let product = camera.rotation * camera.rotation.transpose();
            assert!(
                (product - glam::DMat3::IDENTITY)
                    .to_cols_array()
                    .iter()
                    .all(|v| v.abs() < 1e-12)
            );
        }
        seen.push(views);
    }
    assert!(
        seen.iter().all(|views| *views == seen[0]),
        "any strategy, the same bits"
    );
    // What shows too little is left out here, too.
    let (focus, field) = around(&train, &config);
    config.views.visibility.min_share = 0.5;
    let shares: Vec<f64> = (0..200)
        .map(|j| if j % 8 == 0 { 0.9 } else { 0.1 })
        .collect();
    let kept = virtual_views(&train, &focus, &field, Some(&shares), &config).unwrap();
    let all = candidates(&train, &focus, &field, &config).unwrap();
    assert_eq!(kept.len(), 25);
    for view in &kept {
        let from = all
            .iter()
            .position(|c| c.camera.translation == view.camera.translation);
        assert_eq!(from.unwrap() % 8, 0);
    }
}

/// Everything that a virtual camera must be, whatever the layout.
fn check_geometry(view: &VirtualView, focus: &Focus) {
    let camera = &view.camera;
    let eye = camera.center();
    let r = focus.radius;
    let scale = r + focus.center.length();
    assert!((view.direction.length() - 1.0).abs() < 1e-12);
    assert!(eye.distance(focus.center + r * view.direction) < 1e-12 * scale);
    assert!(
        (camera.forward() + view.direction).length() < 1e-12,
        "looks elsewhere"
    );
    let product = camera.rotation * camera.rotation.transpose();
    assert!(
        (product - glam::DMat3::IDENTITY)
            .to_cols_array()
            .iter()
            .all(|v| v.abs() < 1e-12)
    );
    assert!((camera.rotation.determinant() - 1.0).abs() < 1e-12);
}

#[test]
fn virtual_cameras_stand_on_the_sphere_and_look_at_the_focus() {
    let target = dvec3(10.0, -20.0, 5.0);
    let train = ring(4, target);
    let config = paper();
    let (focus, field) = around(&train, &config);
    let views = virtual_views(&train, &focus, &field, None, &config).unwrap();
    assert_eq!(views.len(), 256);
    for (k, view) in views.iter().enumerate() {
        check_geometry(view, &focus);
        assert_eq!(view.camera.name, format!("virtual_{k:03}"));
        assert_eq!(view.u_conf, field.u_conf(view.direction));
        assert_eq!(view.alpha, 1.0 / (1.0 + view.u_conf));
    }
    let mut directions: Vec<String> = views.iter().map(|v| format!("{}", v.direction)).collect();
    directions.sort();
    directions.dedup();
    assert_eq!(directions.len(), 256, "a direction was drawn twice");
}

#[test]
fn same_seed_same_views_and_another_seed_others() {
    let train = ring(4, DVec3::ZERO);
    let mut config = paper();
    let first = views_of(&train, &config);
    assert_eq!(first, views_of(&train, &config));
    config.seed = 1;
    assert_ne!(first, views_of(&train, &config));
}

#[test]
fn draws_follow_the_weights() {
    // Three weights; the second draw's odds follow from the first's by hand.
    let weights = [1.0, 2.0, 5.0];
    let n = 40_000;
    let mut first = [0usize; 3];
    let mut pairs = [[0usize; 3]; 3];
    for seed in 0..n {
        let drawn = draw_without_replacement(&weights, 2, seed as u64).unwrap();
        first[drawn[0]] += 1;
        pairs[drawn[0]][drawn[1]] += 1;
    }
    let close = |count: usize, p: f64| {
        let sigma = (p * (1.0 - p) / n as f64).sqrt();
        (count as f64 / n as f64 - p).abs() < 4.5 * sigma
    };
    for i in 0..3 {
        let p = weights[i] / 8.0;
        assert!(close(first[i], p), "{first:?}");
        for j in (0..3).filter(|j| *j != i) {
            let q = p * weights[j] / (8.0 - weights[i]);
            assert!(close(pairs[i][j], q), "{i} then {j}: {pairs:?}");
        }
        assert_eq!(pairs[i][i], 0);
    }
}

#[test]
fn directions_are_drawn_by_inverse_potential() {
    // Over many seeds the first draw's potential has the mean that P_j gives it.
    let train = ring(4, DVec3::ZERO);
    let config = paper();
    let (_, field) = around(&train, &config);
    let candidates = fibonacci_sphere(512);
    let weights = potential_weights(&field, &candidates, config.views.epsilon);
    let total: f64 = weights.iter().sum();
    let mean_of = |f: &dyn Fn(f64) -> f64| -> f64 {
        candidates
            .iter()
            .map(|p| f(field.u_total(*p)) / (field.u_total(*p) + config.views.epsilon) / total)
            .sum()
    };
    let expected = mean_of(&|u| u);
    let variance = mean_of(&|u| u * u) - expected * expected;
    let n = 4000;
    let mean = (0..n)
        .map(|seed| {
            let j = draw_without_replacement(&weights, 1, seed).unwrap()[0];
            field.u_total(candidates[j])
        })
        .sum::<f64>()
        / n as f64;
    assert!(
        (mean - expected).abs() < 4.0 * (variance / n as f64).sqrt(),
        "{mean} {expected}"
    );
    // A uniform draw would not pass.
    let uniform = candidates.iter().map(|p| field.u_total(*p)).sum::<f64>() / 512.0;
    assert!((uniform - expected).abs() > 8.0 * (variance / n as f64).sqrt());
}

#[test]
fn fewer_views_are_the_first_of_more_and_all_candidates_can_be_drawn() {
    let weights: Vec<f64> = (1..=50).map(f64::from).collect();
    let all = draw_without_replacement(&weights, 50, 3).unwrap();
    assert_eq!(draw_without_replacement(&weights, 7, 3).unwrap(), all[..7]);
    let mut sorted = all;
    sorted.sort_unstable();
    assert_eq!(sorted, (0..50).collect::<Vec<_>>());
    assert!(draw_without_replacement(&weights, 0, 3).unwrap().is_empty());
}

#[test]
fn more_views_than_candidates_is_a_usage_error_with_the_numbers() {
    let train = ring(4, DVec3::ZERO);
    let mut config = paper();
    config.field.n_candidates = 100;
    let (focus, field) = around(&train, &config);
    let error = virtual_views(&train, &focus, &field, None, &config).unwrap_err();
    assert_eq!(error.exit_code(), 2);
    let text = error.to_string();
    assert!(text.contains("256") && text.contains("100"), "{text}");
    config.views.count = 0;
    assert!(
        virtual_views(&train, &focus, &field, None, &config)
            .unwrap()
            .is_empty()
    );
    assert!(draw_without_replacement(&[1.0], 2, 0).is_err());
}

#[test]
fn weights_that_are_no_probabilities_are_usage_errors() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = draw_without_replacement(&[1.0, bad, 1.0], 1, 0).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains("candidate 1"), "{error}");
    }
}

#[test]
fn confidence_weighting_can_be_switched_off() {
    let mut config = paper();
    config.loss.confidence_weighting = false;
    assert!(
        views_of(&ring(4, DVec3::ZERO), &config)
            .iter()
            .all(|v| v.alpha == 1.0)
    );
}

#[test]
fn intrinsics_are_the_median_of_the_most_common_size_and_centred() {
    let mut train = ring(6, DVec3::ZERO);
    for (camera, fx) in train.iter_mut().zip([900.0, 700.0, 100.0, 800.0, 1.0, 2.0]) {
        camera.fx = fx;
        camera.fy = fx + 1.0;
        (camera.width, camera.height) = (640, 480);
        (camera.cx, camera.cy) = (11.0, 13.0);
    }
    for camera in &mut train[4..] {
        (camera.width, camera.height) = (480, 640);
    }
    train.swap(0, 5);
    let view = &views_of(&train, &paper())[0].camera;
    assert_eq!((view.width, view.height), (640, 480));
    assert_eq!((view.fx, view.fy), (750.0, 751.0));
    assert_eq!((view.cx, view.cy), (320.0, 240.0));
}

#[test]
fn up_is_the_mean_camera_up_and_at_the_poles_the_nearest_cameras() {
    let train = ring(5, DVec3::ZERO);
    let config = paper();
    let (focus, field) = around(&train, &config);
    let mean_up: DVec3 = train.iter().map(Camera::up).sum();
    let pole = mean_up.normalize();
    let side = pole.cross(DVec3::X).normalize();
    let tilted = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        pole * cos + side * sin
    };
    for (direction, is_pole) in [
        (tilted(0.0), true),
        (tilted(9.9), true),
        (tilted(10.1), false),
        (tilted(90.0), false),
        (-tilted(0.0), true),
        (-tilted(10.1), false),
    ] {
        let view = &place(
            &[Viewpoint::on_sphere(direction)],
            &train,
            &focus,
            &field,
            &config,
        )
        .unwrap()[0];
        check_geometry(view, &focus);
        let wanted = if is_pole {
            train[field.nearest(direction)].up()
        } else {
            pole
        };
        // The wanted up appears upright: no sideways part, and above.
        let seen = view.camera.rotation * wanted;
        assert!(seen.x.abs() < 1e-12 && seen.y < 0.0, "{direction}: {seen}");
    }
}

#[test]
fn no_layout_of_ups_makes_a_view_degenerate() {
    let config = paper();
    let directions = fibonacci_sphere(500);
    let mut poles = vec![
        DVec3::X,
        DVec3::Y,
        DVec3::Z,
        -DVec3::X,
        -DVec3::Y,
        -DVec3::Z,
    ];
    poles.extend(directions);
    let poles: Vec<Viewpoint> = poles.into_iter().map(Viewpoint::on_sphere).collect();
    let roll = |c: &Camera| Camera {
        // Turned upside down about its own axis: the ups cancel out.
        rotation: glam::DMat3::from_diagonal(dvec3(-1.0, -1.0, 1.0)) * c.rotation,
        translation: dvec3(-1.0, -1.0, 1.0) * c.translation,
        ..c.clone()
    };
    let upright = ring(2, DVec3::ZERO);
    let cancelling = [
        upright[0].clone(),
        roll(&upright[0]),
        upright[1].clone(),
        roll(&upright[1]),
    ];
    // Cameras on the sphere that do not look at the focus but along it, up pointing outwards.
    let across = [DVec3::X, -DVec3::X].map(|p| Camera {
        rotation: glam::DMat3::from_cols(DVec3::Y, p, DVec3::Y.cross(p)).transpose(),
        ..camera(p * 3.0, DVec3::ZERO)
    });
    let across = across.map(|c| Camera {
        translation: -(c.rotation * DVec3::X * 3.0),
        ..c
    });
    for train in [&cancelling[..], &across[..]] {
        let focus = Focus {
            center: DVec3::ZERO,
            radius: 3.0,
            extent: 3.0,
            fallback: None,
        };
        let field = Field::new(train, &focus, &config.field);
        for view in place(&poles, train, &focus, &field, &config).unwrap() {
            check_geometry(&view, &focus);
        }
    }
}
