//! The strategies that stand beside the potential, and the choice by visibility.

use std::f64::consts::PI;

use glam::{DVec3, dvec3};
use gspotential::camera::Camera;
use gspotential::config::Config;
use gspotential::error::ErrorKind;
use gspotential::field::{Field, Focus, angle, fibonacci_sphere};
use gspotential::views::{
    VirtualView, enough, farthest_points, nearest_angle_weights, virtual_views,
};

use super::{around, check_geometry};
use crate::geometry::{camera, paper, ring};

const ON_THE_GRID: [&str; 4] = [
    "potential",
    "nearest_angle",
    "sphere_uniform",
    "sphere_farthest",
];

fn with(strategy: &str) -> Config {
    paper().set(&format!("views.strategy={strategy}")).unwrap()
}

fn views_of(train: &[Camera], config: &Config) -> Vec<VirtualView> {
    let (focus, field) = around(train, config);
    virtual_views(train, &focus, &field, None, config).unwrap()
}

/// Around the origin, whatever the cameras' layout.
fn given(train: &[Camera], config: &Config) -> (Focus, Field) {
    let focus = Focus {
        center: DVec3::ZERO,
        radius: 3.0,
        extent: 3.0,
        fallback: None,
    };
    let field = Field::new(train, &focus, &config.field);
    (focus, field)
}

#[test]
fn every_strategy_is_a_choice_of_its_own_that_the_seed_alone_decides() {
    let train = ring(4, dvec3(1.0, 2.0, 3.0));
    let mut all: Vec<Vec<VirtualView>> = Vec::new();
    for strategy in ON_THE_GRID.into_iter().chain(["interpolation"]) {
        let mut config = with(strategy);
        let views = views_of(&train, &config);
        let (focus, _) = around(&train, &config);
        assert_eq!(views.len(), 256, "{strategy}");
        if strategy != "interpolation" {
            views.iter().for_each(|view| check_geometry(view, &focus));
        }
        assert_eq!(views, views_of(&train, &config), "{strategy}");
        config.seed = 1;
        // The farthest points need no random number.
        let same = views == views_of(&train, &config);
        assert_eq!(same, strategy == "sphere_farthest", "{strategy}");
        assert!(all.iter().all(|others| *others != views), "{strategy}");
        all.push(views);
    }
}

#[test]
fn strategies_on_the_grid_take_no_candidate_twice_and_can_take_all() {
    let train = ring(4, DVec3::ZERO);
    let grid = fibonacci_sphere(64);
    for strategy in ON_THE_GRID {
        let mut config = with(strategy);
        config.field.n_candidates = 64;
        config.views.count = 64;
        let mut taken: Vec<usize> = views_of(&train, &config)
            .iter()
            .map(|v| grid.iter().position(|p| *p == v.direction).unwrap())
            .collect();
        taken.sort_unstable();
        assert!(taken.into_iter().eq(0..64), "{strategy}");
    }
}

#[test]
fn nearest_angle_draws_by_the_angle_to_the_nearest_camera() {
    let train = ring(4, DVec3::ZERO);
    let (_, field) = around(&train, &paper());
    let grid = fibonacci_sphere(300);
    for (p, w) in grid.iter().zip(nearest_angle_weights(&field, &grid, 0.25)) {
        let nearest = train
            .iter()
            .map(|c| p.dot(c.center().normalize()).acos())
            .fold(PI, f64::min);
        assert!((w - nearest - 0.25).abs() < 1e-7);
    }
    // Over seeds, the first draw lies as far out as the weights say; a uniform one does not.
    let mean_angle = |strategy: &str| {
        let angles = (0..300).map(|seed| {
            let mut config = with(strategy);
            config.views.count = 1;
            config.field.n_candidates = 300;
            config.seed = seed;
            views_of(&train, &config)[0].u_conf
        });
        angles.sum::<f64>() / 300.0
    };
    let angles: Vec<f64> = grid.iter().map(|p| field.u_conf(*p)).collect();
    let moment = |k: i32| angles.iter().map(|a| a.powi(k)).sum::<f64>() / 300.0;
    let (uniform, weighted) = (moment(1), moment(2) / moment(1));
    let variance = moment(3) / moment(1) - weighted * weighted;
    let sigma = (variance / 300.0).sqrt();
    assert!(weighted - uniform > 8.0 * sigma, "{weighted} {uniform}");
    assert!((mean_angle("nearest_angle") - weighted).abs() < 4.0 * sigma);
    assert!((mean_angle("sphere_uniform") - uniform).abs() < 4.0 * sigma);
}

#[test]
fn each_farthest_point_is_farthest_from_cameras_and_from_those_before() {
    let (_, field) = around(&ring(4, DVec3::ZERO), &paper());
    let grid = fibonacci_sphere(400);
    let chosen = farthest_points(&grid, &field.directions, 60);
    let mut taken = field.directions.clone();
    let reach = |p: DVec3, taken: &[DVec3]| taken.iter().map(|q| angle(p, *q)).fold(PI, f64::min);
    for &j in &chosen {
        let most = grid.iter().map(|p| reach(*p, &taken)).fold(0.0, f64::max);
        assert!((reach(grid[j], &taken) - most).abs() < 1e-9);
        taken.push(grid[j]);
    }
    // Without a direction that is taken, and where all coincide, each still comes once.
    assert_eq!(farthest_points(&[DVec3::X; 3], &[], 9), [0, 1, 2]);
    assert!(farthest_points(&[], &[DVec3::X], 3).is_empty());
    assert_eq!(
        farthest_points(&[DVec3::X, DVec3::Y, -DVec3::X], &[DVec3::X], 2),
        [2, 1]
    );
}

/// Whether `p` lies on the shorter arc from `a` to `b`.
fn on_arc(p: DVec3, a: DVec3, b: DVec3) -> bool {
    (angle(a, p) + angle(p, b) - angle(a, b)).abs() < 1e-6
}

#[test]
fn interpolated_views_stand_between_two_cameras_at_a_distance_between_theirs() {
    let target = dvec3(4.0, 5.0, 6.0);
    let mut train = ring(4, target);
    train.push(camera(target + dvec3(0.5, -1.0, 0.4), target));
    let config = with("interpolation");
    let (focus, field) = around(&train, &config);
    let views = views_of(&train, &config);
    let mut pairs_met = std::collections::BTreeSet::new();
    for view in &views {
        let eye = view.camera.center() - focus.center;
        assert!(
            angle(eye.normalize(), view.direction) < 1e-9,
            "{}",
            view.direction
        );
        assert!((view.camera.forward() + view.direction).length() < 1e-12);
        assert_eq!(view.u_conf, field.u_conf(view.direction));
        let met = (0..5)
            .flat_map(|i| (i + 1..5).map(move |j| (i, j)))
            .find(|&(i, j)| {
                let [a, b] = [i, j].map(|k: usize| train[k].center() - focus.center);
                let whole = angle(a.normalize(), b.normalize());
                let t = angle(a.normalize(), view.direction) / whole;
                on_arc(view.direction, a.normalize(), b.normalize())
                    && (eye.length() - (1.0 - t) * a.length() - t * b.length()).abs() < 1e-6
            });
        pairs_met.insert(met.unwrap_or_else(|| panic!("between no pair: {}", view.camera.name)));
    }
    assert_eq!(pairs_met.len(), 10, "{pairs_met:?}");
}

#[test]
fn layouts_without_an_arc_interpolate_all_the_same() {
    let config = with("interpolation");
    let opposed = [
        camera(DVec3::X * 3.0, DVec3::ZERO),
        camera(DVec3::X * -3.0, DVec3::ZERO),
    ];
    let coincident = vec![camera(dvec3(0.0, 3.0, 0.0), DVec3::ZERO); 3];
    // One camera above the other's back: up lies along the directions themselves.
    let poles = [
        camera(DVec3::Z * 3.0, DVec3::ZERO),
        camera(DVec3::Z * -3.0, DVec3::ZERO),
    ];
    for (name, train) in [
        ("opposed", &opposed[..]),
        ("coincident", &coincident),
        ("poles", &poles),
    ] {
        let (focus, field) = given(train, &config);
        let views = virtual_views(train, &focus, &field, None, &config).unwrap();
        assert_eq!(views.len(), 256, "{name}");
        for view in &views {
            check_geometry(view, &focus);
            match name {
                // Over the top, not underneath.
                "opposed" => assert!(view.direction.z >= -1e-9, "{}", view.direction),
                "coincident" => assert!(view.direction.distance(DVec3::Y) < 1e-9),
                _ => {}
            }
        }
    }
    let spread = |views: &[VirtualView]| {
        let xs: Vec<f64> = views.iter().map(|v| v.direction.x).collect();
        xs.iter().copied().fold(f64::INFINITY, f64::min)..xs.into_iter().fold(-1.0, f64::max)
    };
    let (focus, field) = given(&opposed, &config);
    let views = virtual_views(&opposed, &focus, &field, None, &config).unwrap();
    let spread = spread(&views);
    assert!(spread.start < -0.95 && spread.end > 0.95, "{spread:?}");
}

#[test]
fn a_single_camera_has_nothing_to_interpolate_between() {
    let train = [camera(dvec3(0.0, 3.0, 0.0), DVec3::ZERO)];
    let config = with("interpolation");
    let (focus, field) = given(&train, &config);
    let error = virtual_views(&train, &focus, &field, None, &config).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Usage);
    assert!(error.to_string().contains("views.strategy"), "{error}");
    for strategy in ON_THE_GRID {
        let config = with(strategy);
        let views = virtual_views(&train, &focus, &field, None, &config).unwrap();
        assert_eq!(views.len(), 256, "{strategy}");
    }
}

#[test]
fn shares_below_the_least_drop_a_candidate_and_the_others_weigh_by_the_power() {
    let train = ring(4, DVec3::ZERO);
    let grid = fibonacci_sphere(64);
    for strategy in ON_THE_GRID {
        let mut config = with(strategy);
        config.field.n_candidates = 64;
        config.views.count = 10;
        let (focus, field) = around(&train, &config);
        let index = |v: &VirtualView| grid.iter().position(|p| *p == v.direction).unwrap();
        let choose = |shares: &[f64], config: &Config| -> Vec<usize> {
            let views = virtual_views(&train, &focus, &field, Some(shares), config).unwrap();
            views.iter().map(index).collect()
        };
        let half: Vec<f64> = (0..64)
            .map(|j| if j % 2 == 0 { 0.25 } else { 0.249 })
            .collect();
        let chosen = choose(&half, &config);
        assert_eq!(chosen.len(), 10);
        assert!(chosen.iter().all(|j| j % 2 == 0), "{strategy}: {chosen:?}");
        // Full shares change nothing.
        let free = virtual_views(&train, &focus, &field, None, &config).unwrap();
        let full = choose(&[1.0; 64], &config);
        assert!(full.into_iter().eq(free.iter().map(index)), "{strategy}");

        // The share of those that stay counts by its power: at 16, a tenth is next to nothing.
        if strategy == "sphere_farthest" {
            continue;
        }
        config.views.visibility.min_share = 0.0;
        config.views.visibility.power = 16.0;
        let shares: Vec<f64> = (0..64).map(|j| if j < 12 { 1.0 } else { 0.1 }).collect();
        let chosen = choose(&shares, &config);
        assert!(chosen.iter().all(|j| *j < 12), "{strategy}: {chosen:?}");
        config.views.visibility.power = 0.0;
        let chosen = choose(&shares, &config);
        assert!(chosen.iter().any(|j| *j >= 12), "{strategy}: {chosen:?}");
    }
}

#[test]
fn few_candidates_give_few_views_and_none_is_an_error_with_the_best_share() {
    let train = ring(4, DVec3::ZERO);
    let mut config = paper();
    config.field.n_candidates = 64;
    config.views.count = 10;
    let (focus, field) = around(&train, &config);
    let mut shares = vec![0.2; 64];
    shares[5] = 0.9;
    shares[40] = 0.3;
    let views = virtual_views(&train, &focus, &field, Some(&shares), &config).unwrap();
    assert_eq!(views.len(), 2);

    for (shares, said) in [(vec![0.2; 64], "20 %"), (vec![0.0; 64], "0 %")] {
        let error = virtual_views(&train, &focus, &field, Some(&shares), &config).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Failure);
        let text = error.to_string();
        assert!(text.contains(said) && text.contains("min_share"), "{text}");
    }
    // A share of nothing is never drawn, however low the least share is.
    config.views.visibility.min_share = 0.0;
    shares.fill(0.0);
    shares[7] = 1e-9;
    let views = virtual_views(&train, &focus, &field, Some(&shares), &config).unwrap();
    assert_eq!(views.len(), 1);
    let short = virtual_views(&train, &focus, &field, Some(&[1.0]), &config);
    assert!(short.unwrap_err().to_string().contains("1 visible shares"));
}

#[test]
fn as_few_views_are_taken_as_leave_no_direction_far() {
    let at = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(cos, sin, 0.0)
    };
    let candidates: Vec<DVec3> = (0..40).map(|i| at(f64::from(i))).collect();
    let chosen = [5.0, 6.0, 20.0, 30.0, 38.0].map(at);
    let enough = |within: f64| enough(&chosen, &candidates, within.to_radians());
    // 5, 6, 20 and 30 leave 13 and 37 to 39; with 38 only 13 is left, and two may be.
    assert_eq!(enough(6.1), 5);
    // 5, 6, 20 and 30 leave 38 and 39.
    assert_eq!(enough(7.1), 4);
    assert_eq!(enough(40.0), 1);
    // No number does: all.
    assert_eq!(enough(0.1), 5);
}
