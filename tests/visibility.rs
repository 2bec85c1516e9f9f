//! What training cameras see of a view's points, against brute force and by hand.

use glam::{DVec3, dvec3};
use gspotential::camera::{Camera, Frame};
use gspotential::cloud::visibility::{Support, Visibility, candidate_shares};
use gspotential::config::{ColorSource, Config, Footprint, SplatConfig, VisibilityConfig};
use gspotential::field::{Field, Focus};
use gspotential::pipeline::prepare;
use gspotential::run::Seconds;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{PointCloud, Scene};
use gspotential::views::candidates;

use crate::geometry::{Random, camera, cloud, paper, ring};
use crate::splat::brute_force;

const NEAR: f64 = 0.01;
const BARE: SplatConfig = SplatConfig {
    footprint: Footprint::Pixel,
    max_radius_px: 4.0,
    depth_tolerance: 0.02,
    filter_window_px: 1,
    filter_min_neighbors: 0,
    colors: ColorSource::Points,
    outline: false,
};

fn config() -> VisibilityConfig {
    paper().views.visibility
}

fn visibility(points: &PointCloud, train: &[Camera], config: &VisibilityConfig) -> Visibility {
    Visibility::new(points, points, &Frame::IDENTITY, train, config, NEAR).unwrap()
}

fn support(points: &PointCloud, train: &[Camera], view: &Camera) -> Support {
    let cameras = std::slice::from_ref(view);
    visibility(points, train, &config())
        .measure(cameras, &BARE)
        .unwrap()[0]
}

/// The definitions, one by one.
fn twin(
    points: &PointCloud,
    train: &[Camera],
    view: &Camera,
    config: &VisibilityConfig,
) -> Support {
    let maps: Vec<_> = train.iter().map(|c| brute_force(points, c, NEAR)).collect();
    let depth = |c: &Camera, p: DVec3| (c.rotation * p + c.translation).z;
    let sees = |i: usize, p: DVec3| {
        let c = &train[i];
        let q = c.rotation * p + c.translation;
        let (u, v) = (c.fx * q.x / q.z + c.cx, c.fy * q.y / q.z + c.cy);
        let inside =
            (0.0..f64::from(c.width)).contains(&u) && (0.0..f64::from(c.height)).contains(&v);
        q.z > NEAR
            && inside
            && maps[i][v as usize * c.width as usize + u as usize].is_some_and(|nearest| {
                q.z <= depth(c, points.positions[nearest]) * (1.0 + config.depth_tolerance)
            })
    };
    let winners = brute_force(points, view, NEAR);
    let covered: Vec<DVec3> = winners
        .iter()
        .flatten()
        .map(|&k| points.positions[k])
        .collect();
    let supported = |p: DVec3| {
        (0..train.len()).any(|i| {
            let [a, b] = [train[i].center() - p, view.center() - p].map(DVec3::normalize);
            sees(i, p) && a.dot(b).clamp(-1.0, 1.0).acos().to_degrees() <= config.max_angle_deg
        })
    };
    let n_seen = covered.iter().filter(|p| supported(**p)).count();
    Support {
        coverage: covered.len() as f64 / winners.len() as f64,
        visible_share: n_seen as f64 / covered.len().max(1) as f64,
    }
}

#[test]
fn supports_agree_with_the_definitions_one_by_one() {
    let mut random = Random::new(3);
    let points = cloud((0..1500).map(|_| random.in_cube(1.0)).collect());
    let train: Vec<Camera> = ring(3, DVec3::ZERO)
        .iter()
        .map(|c| c.resized(40, 30))
        .collect();
    let mut shares = Vec::new();
    for (max_angle_deg, depth_tolerance) in [(60.0, 0.05), (25.0, 0.05), (60.0, 0.4), (180.0, 0.05)]
    {
        let config = VisibilityConfig {
            max_angle_deg,
            depth_tolerance,
            ..config()
        };
        let visibility = visibility(&points, &train, &config);
        for eye in [
            dvec3(3.0, 0.0, 1.0),
            dvec3(-1.0, 2.0, -2.0),
            dvec3(0.2, 0.1, 0.0),
        ] {
            let view = camera(eye, dvec3(0.0, 0.1, 0.05)).resized(40, 30);
            let expected = twin(&points, &train, &view, &config);
            let found = visibility
                .measure(std::slice::from_ref(&view), &BARE)
                .unwrap()[0];
            assert_eq!(
                found, expected,
                "{max_angle_deg} {depth_tolerance} from {eye}"
            );
            assert!(found.coverage > 0.05);
            shares.push(found.visible_share);
        }
    }
    // Angle, tolerance and place each make a difference: a slip in any would show.
    shares.sort_by(f64::total_cmp);
    shares.dedup();
    assert!(shares.len() > 9, "{shares:?}");
}

/// A square of points around the origin that faces +x.
fn wall(x: f64, half: f64) -> Vec<DVec3> {
    let steps = 60;
    let at = |i: i32| half * (f64::from(i) / f64::from(steps) * 2.0 - 1.0);
    (0..=steps)
        .flat_map(|i| (0..=steps).map(move |j| dvec3(x, at(i), at(j))))
        .collect()
}

#[test]
fn a_patch_is_seen_up_to_the_greatest_angle_between_the_two_directions_to_it() {
    let patch = cloud(wall(0.0, 0.01));
    let train = [camera(DVec3::X * 3.0, DVec3::ZERO)];
    let from = |degrees: f64, distance: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let view = camera(dvec3(cos, sin, 0.0) * distance, DVec3::ZERO);
        support(&patch, &train, &view).visible_share
    };
    for distance in [0.5, 3.0, 40.0] {
        assert_eq!(from(0.0, distance), 1.0);
        assert_eq!(from(-58.0, distance), 1.0, "{distance}");
        assert_eq!(from(62.0, distance), 0.0, "{distance}");
        assert_eq!(from(180.0, distance), 0.0);
    }
    // A camera that turns its back sees nothing, nor one whose image the patch is beside.
    for target in [DVec3::X * 9.0, dvec3(0.0, 9.0, 0.0)] {
        let train = [camera(DVec3::X * 3.0, target)];
        let view = camera(DVec3::X * 2.0, DVec3::ZERO);
        assert_eq!(support(&patch, &train, &view).visible_share, 0.0);
    }
}

#[test]
fn what_another_wall_hides_from_the_camera_does_not_count() {
    // Seen from +x, the near wall hides the far one; the view looks at the far one between them.
    let train = [camera(DVec3::X * 3.0, DVec3::ZERO)];
    let view = camera(dvec3(0.3, 0.0, 0.0), DVec3::ZERO);
    let far = wall(0.0, 0.15);
    let hidden = cloud([far.clone(), wall(0.4, 0.5)].concat());
    assert_eq!(support(&hidden, &train, &view).visible_share, 0.0);
    assert_eq!(
        support(&cloud(far.clone()), &train, &view).visible_share,
        1.0
    );
    // Within the tolerance, both are the same surface.
    let layered = cloud([far, wall(0.02, 0.15)].concat());
    let view = camera(DVec3::X * 0.015, DVec3::ZERO);
    assert_eq!(support(&layered, &train, &view).visible_share, 1.0);
}

#[test]
fn an_empty_cloud_or_no_camera_supports_nothing() {
    let view = camera(DVec3::X, DVec3::ZERO);
    let nothing = support(&PointCloud::default(), &ring(2, DVec3::ZERO), &view);
    assert_eq!((nothing.coverage, nothing.visible_share), (0.0, 0.0));
    let alone = support(&cloud(wall(0.0, 0.1)), &[], &view);
    assert!(alone.coverage > 0.0 && alone.visible_share == 0.0);
    let nothing = candidate_shares(
        &[view],
        &PointCloud::default(),
        &Frame::IDENTITY,
        &[],
        &paper(),
    );
    assert_eq!(nothing.unwrap(), [0.0]);
}

#[test]
fn supports_do_not_depend_on_unit_origin_or_number_of_threads() {
    let mut random = Random::new(8);
    let points = cloud((0..4000).map(|_| random.in_cube(1.0)).collect());
    let train = ring(3, DVec3::ZERO);
    let views: Vec<Camera> = (0..9)
        .map(|_| camera(random.in_cube(1.0).normalize() * 3.0, DVec3::ZERO))
        .collect();
    let reference = visibility(&points, &train, &config())
        .measure(&views, &BARE)
        .unwrap();
    assert!(reference.iter().any(|s| s.visible_share > 0.3));

    let frame = Frame {
        center: dvec3(8.0, -16.0, 32.0),
        radius: 1024.0,
        extent: 1024.0,
    };
    let moved = |cameras: &[Camera]| -> Vec<Camera> {
        let moved = |c: &Camera| Camera {
            translation: -(c.rotation * frame.to_world(c.center())),
            ..c.clone()
        };
        cameras.iter().map(moved).collect()
    };
    let mut elsewhere = points.clone();
    elsewhere
        .positions
        .iter_mut()
        .for_each(|p| *p = frame.to_world(*p));
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(3)
        .build()
        .unwrap();
    let found = pool.install(|| {
        Visibility::new(
            &elsewhere,
            &elsewhere,
            &frame,
            &moved(&train),
            &config(),
            NEAR,
        )
        .unwrap()
        .measure(&moved(&views), &BARE)
        .unwrap()
    });
    for (found, expected) in found.iter().zip(&reference) {
        // A point on a pixel's edge may change sides.
        assert!(
            (found.visible_share - expected.visible_share).abs() < 2e-3,
            "{found:?} {expected:?}"
        );
    }
}

fn builtin() -> Scene {
    scene(&BuiltinOptions {
        width: 160,
        n_test: 0,
        ..BuiltinOptions::default()
    })
}

fn cameras(scene: &Scene) -> Vec<Camera> {
    scene.train.iter().map(|view| view.camera.clone()).collect()
}

#[test]
fn the_estimate_in_miniature_is_close_to_the_full_share() {
    let scene = builtin();
    for footprint in [Footprint::Pixel, Footprint::Disc] {
        let mut config = paper();
        config.field.n_candidates = 128;
        config.splat.footprint = footprint;
        estimate_holds(&scene, &config);
    }
}

fn estimate_holds(scene: &Scene, config: &Config) {
    let train = cameras(scene);
    let focus = Focus::find(&train, &scene.cloud).unwrap();
    let frame = focus.frame();
    let field = Field::new(&train, &focus, &config.field);
    let views = candidates(&train, &focus, &field, config).unwrap();
    let views: Vec<Camera> = views.into_iter().map(|v| v.camera).collect();
    let estimate = candidate_shares(&views, &scene.cloud, &frame, &train, config).unwrap();
    let whole = Visibility::new(
        &scene.cloud,
        &scene.cloud,
        &frame,
        &train,
        &config.views.visibility,
        NEAR,
    );
    let full = whole.unwrap().measure(&views, &config.splat).unwrap();
    let mean_error = |estimate: &[f64]| {
        let errors = estimate
            .iter()
            .zip(&full)
            .map(|(e, f)| (e - f.visible_share).abs());
        errors.sum::<f64>() / views.len() as f64
    };
    let mean = mean_error(&estimate);
    let greatest = estimate
        .iter()
        .zip(&full)
        .map(|(e, f)| (e - f.visible_share).abs())
        .fold(0.0, f64::max);
    eprintln!(
        "{} points: mean absolute error {mean:.4}, greatest {greatest:.4}",
        scene.cloud.len()
    );
    // A candidate is dropped below 0.25 and weighed by the share's square.
    assert!(mean < 0.02 && greatest < 0.1, "{mean} {greatest}");
    // That is much closer than neighbouring candidates are to one another.
    let mut turned = estimate;
    turned.rotate_left(1);
    assert!(mean_error(&turned) > 0.1);
}

fn prepared_shares(scene: &Scene, config: &Config) -> (usize, f64, String) {
    let prepared = prepare(scene, config, &mut Seconds::default()).unwrap();
    let (train, frame) = (cameras(scene), &prepared.frame);
    let whole = Visibility::new(
        &scene.cloud,
        &scene.cloud,
        frame,
        &train,
        &config.views.visibility,
        NEAR,
    );
    let views = &prepared.virtual_cameras;
    let supports = whole.unwrap().measure(views, &config.splat).unwrap();
    let mean = supports.iter().map(|s| s.visible_share).sum::<f64>() / views.len() as f64;
    assert_eq!(prepared.supervision.virtual_views.len(), views.len());
    (views.len(), mean, prepared.warnings.join("; "))
}

#[test]
fn a_run_that_weighs_by_visibility_gets_views_that_show_what_cameras_see() {
    let scene = builtin();
    let mut config = paper();
    config.field.n_candidates = 512;
    config.views.count = 64;
    let (n, literal, warnings) = prepared_shares(&scene, &config);
    assert_eq!((n, warnings.as_str()), (64, ""));
    config.views.visibility.enabled = true;
    let (n, weighed, warnings) = prepared_shares(&scene, &config);
    assert_eq!((n, warnings.as_str()), (64, ""));
    eprintln!("visible share {literal:.3} -> {weighed:.3}");
    assert!(weighed > literal + 0.2, "{literal} {weighed}");

    // Fewer where few are good enough, with a word; an error where none is.
    config.views.visibility.min_share = 0.92;
    let (n, strict, warnings) = prepared_shares(&scene, &config);
    assert!((1..64).contains(&n) && strict > 0.8, "{n} {strict}");
    assert!(
        warnings.contains(&format!("{n} virtual views instead of 64")),
        "{warnings}"
    );
    config.views.visibility.max_angle_deg = 0.01;
    let error = prepare(&scene, &config, &mut Seconds::default())
        .err()
        .expect("an error");
    assert!(
        error.to_string().contains("no candidate view is left"),
        "{error}"
    );
}

#[test]
fn one_camera_coincident_and_opposed_cameras_support_their_own_sides() {
    let points = cloud([wall(0.0, 0.5), wall(0.01, 0.5)].concat());
    let [right, left] = [1.0, -1.0].map(|x| camera(DVec3::X * 3.0 * x, DVec3::ZERO));
    let share = |train: &[Camera], view: &Camera| support(&points, train, view).visible_share;
    for train in [vec![right.clone()], vec![right.clone(); 4]] {
        assert_eq!(share(&train, &right), 1.0);
        // Both layers are within the tolerance; only the angle speaks against the other side.
        assert_eq!(share(&train, &left), 0.0);
    }
    let opposed = [right.clone(), left.clone()];
    assert_eq!(
        (share(&opposed, &right), share(&opposed, &left)),
        (1.0, 1.0)
    );
    let top = camera(dvec3(0.0, 0.2, 3.0), DVec3::ZERO);
    assert_eq!(share(&opposed, &top), 0.0, "90 degrees from both");
}

#[test]
fn masked_virtual_views_keep_the_pixels_whose_points_cameras_see() {
    let scene = builtin();
    let mut config = paper();
    config.field.n_candidates = 512;
    config.views.count = 16;
    let train = cameras(&scene);
    let kept = |mask_angle_deg: Option<f64>| {
        let mut config = config.clone();
        config.views.visibility.mask_angle_deg = mask_angle_deg;
        let prepared = prepare(&scene, &config, &mut Seconds::default()).unwrap();
        let seen = VisibilityConfig {
            max_angle_deg: mask_angle_deg.unwrap_or(180.0),
            ..config.views.visibility.clone()
        };
        let (cloud, frame) = (&scene.cloud, &prepared.frame);
        let seen = Visibility::new(cloud, cloud, frame, &train, &seen, NEAR).unwrap();
        let cameras = &prepared.virtual_cameras;
        let supports = seen.measure(cameras, &config.splat).unwrap();
        let mut total = 0;
        for (view, support) in prepared.supervision.virtual_views.iter().zip(supports) {
            let texels = view.goal.texels();
            let n_set = texels.iter().filter(|texel| **texel != 0).count();
            let share = match mask_angle_deg {
                Some(_) => support.coverage * support.visible_share,
                None => support.coverage,
            };
            assert_eq!(n_set, (share * texels.len() as f64).round() as usize);
            assert_eq!(view.total_weight, n_set as f64);
            total += n_set;
        }
        total
    };
    let [all, seen_at_all, within_60, within_20] =
        [None, Some(180.0), Some(60.0), Some(20.0)].map(kept);
    assert!(all > seen_at_all && seen_at_all > within_60 && within_60 > 2 * within_20);
    assert!(within_20 > 0);
}
