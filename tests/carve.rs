//! Carving against a twin, by hand, and at held-out photographs.

use glam::{DVec3, dvec3};
use gspotential::camera::{Camera, Frame};
use gspotential::cloud::carve::{Carved, carve};
use gspotential::config::CarveConfig;
use gspotential::eval::score_point_splat;
use gspotential::field::Focus;
use gspotential::pipeline::prepare;
use gspotential::run::Seconds;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{Image, PointCloud, Scene, View};

use crate::geometry::{Random, camera, cloud, paper, ring};
use crate::splat::brute_force;

const NEAR: f64 = 0.01;
const WHITE: [u8; 3] = [255; 3];
const RED: [u8; 3] = [255, 0, 0];

fn config() -> CarveConfig {
    CarveConfig {
        enabled: true,
        ..paper().carve
    }
}

fn carved(cloud: &PointCloud, views: &[View], config: &CarveConfig) -> Carved {
    carve(cloud, &Frame::IDENTITY, views, config, NEAR).unwrap()
}

/// A photograph of one colour.
fn plain(camera: Camera, color: [u8; 3]) -> View {
    let n = (camera.width * camera.height) as usize;
    View {
        image: Image {
            width: camera.width,
            height: camera.height,
            rgb: color.repeat(n),
        },
        mask: None,
        prior: None,
        camera,
    }
}

/// Looks along -x at the origin, 3 away: a pixel there is 0.06 wide.
fn from_the_right() -> Camera {
    camera(DVec3::X * 3.0, DVec3::ZERO)
}

fn colored(positions: Vec<DVec3>, color: [u8; 3]) -> PointCloud {
    PointCloud {
        colors: vec![color; positions.len()],
        confidence: Some((0..positions.len()).map(|i| i as f32).collect()),
        positions,
    }
}

fn joined(a: PointCloud, b: PointCloud) -> PointCloud {
    PointCloud {
        positions: [a.positions, b.positions].concat(),
        colors: [a.colors, b.colors].concat(),
        confidence: Some([a.confidence.unwrap(), b.confidence.unwrap()].concat()),
    }
}

/// A square at `x`, without gaps from 3 away.
fn wall(x: f64, half: f64, color: [u8; 3]) -> PointCloud {
    let n = (half / 0.025) as i32;
    let points = (-n..=n).flat_map(|i| (-n..=n).map(move |j| (i, j)));
    let at = |(i, j)| dvec3(x, 0.025 * f64::from(i), 0.025 * f64::from(j));
    colored(points.map(at).collect(), color)
}

#[test]
fn points_before_the_scene_go_one_layer_a_round_and_hidden_ones_stay() {
    let white = wall(0.0, 1.0, WHITE);
    let on_axis = |xs: &[f64]| colored(xs.iter().map(|x| DVec3::X * *x).collect(), RED);
    let points = joined(white.clone(), on_axis(&[1.0, -0.5, 0.9, 0.8]));
    let views = [plain(from_the_right(), WHITE)];
    let result = carved(&points, &views, &config());
    assert_eq!(result.removed, [1, 1, 1]);
    assert_eq!(result.warning, None);
    assert_eq!(
        result.cloud,
        joined(white, {
            let mut hidden = on_axis(&[-0.5]);
            hidden.confidence = Some(vec![1.0]);
            hidden
        })
    );
    let config = CarveConfig {
        max_rounds: 2,
        ..config()
    };
    assert_eq!(carved(&points, &views, &config).removed, [1, 1]);
}

#[test]
fn a_point_seen_through_a_gap_is_not_judged() {
    let mut points = wall(0.0, 1.0, WHITE);
    let closed: Vec<bool> = points.positions.iter().map(|p| p.length() > 0.08).collect();
    points.retain(&closed);
    let points = joined(points, wall(-0.8, 0.2, RED));
    let views = [plain(from_the_right(), WHITE)];
    assert!(carved(&points, &views, &config()).removed.is_empty());
    // That is what the tolerance is for.
    let config = CarveConfig {
        depth_tolerance: 0.9,
        ..config()
    };
    assert!(!carved(&points, &views, &config).removed.is_empty());
}

#[test]
fn the_threshold_is_an_excess_over_the_windows_range() {
    let goes = |color: [u8; 3], paint: Option<(i32, i32)>| {
        let mut view = plain(from_the_right(), [100; 3]);
        if let Some((dx, dy)) = paint {
            let pixel = (24 + dy) * 64 + 32 + dx;
            view.image.rgb[3 * pixel as usize..][..3].copy_from_slice(&[200; 3]);
        }
        let inside = dvec3(0.0, 0.001, -0.001);
        let points = joined(colored(vec![inside], color), wall(-1.0, 1.0, [100; 3]));
        let mut seen = view.camera.rotation * inside + view.camera.translation;
        seen /= seen.z;
        let (u, v) = (50.0 * seen.x + 32.0, 52.0 * seen.y + 24.0);
        assert_eq!((u.floor(), v.floor()), (32.0, 24.0));
        !carved(&points, &[view], &config()).removed.is_empty()
    };
    assert!(!goes([151, 100, 49], None));
    assert!(goes([152, 100, 100], None));
    assert!(goes([100, 100, 48], None));
    // One bright pixel in the window is enough to excuse a bright point.
    assert!(goes([220; 3], None));
    assert!(!goes([220; 3], Some((2, -2))));
    assert!(!goes([220; 3], Some((-2, 2))));
    assert!(goes([220; 3], Some((3, 0))) && goes([220; 3], Some((0, -3))));
}

#[test]
fn a_view_that_sees_a_point_accuses_it_though_another_agrees() {
    // Red for the camera that it was taken from, on the way of the other to a white wall.
    let white = wall(0.0, 1.0, WHITE);
    let points = joined(white, colored(vec![dvec3(1.0, 0.0, 0.0)], RED));
    let own = plain(camera(dvec3(1.0, 0.0, 2.0), dvec3(1.0, 0.0, 0.0)), RED);
    let other = plain(from_the_right(), WHITE);
    let alone = |view: &View| carved(&points, std::slice::from_ref(view), &config());
    assert_eq!(alone(&other).removed, [1]);
    // The red photograph sees the wall edge on, if at all.
    let both = carved(
        &points,
        &[own, other],
        &CarveConfig {
            max_share: 0.9,
            ..config()
        },
    );
    assert!(!both.cloud.colors.contains(&RED));
}

#[test]
fn carving_stops_before_it_takes_too_much() {
    let black = [plain(from_the_right(), [0; 3])];
    let at_most = |max_share: f64| {
        let config = CarveConfig {
            max_share,
            ..config()
        };
        carved(&wall(0.0, 1.0, WHITE), &black, &config)
    };
    // Each round sees, among 6,561 points, the nearest of some thousand pixels.
    let nothing = at_most(0.1);
    assert_eq!(nothing.cloud, wall(0.0, 1.0, WHITE));
    assert_eq!(nothing.removed, Vec::<usize>::new());
    let warning = nothing.warning.unwrap();
    assert!(
        warning.contains("after 0 rounds") && warning.contains("of 6561"),
        "{warning}"
    );
    let one = at_most(0.25);
    assert_eq!(one.removed.len(), 1);
    assert_eq!(one.cloud.len(), 6561 - one.removed[0]);
    let warning = one.warning.unwrap();
    assert!(
        warning.contains("after 1 rounds") && warning.contains("carve.max_share, 0.25"),
        "{warning}"
    );
    assert!(at_most(0.9).removed.len() > 2);
}

#[test]
fn nothing_to_judge_is_nothing_to_carve() {
    let views = [plain(from_the_right(), [0; 3])];
    for (points, views) in [
        (PointCloud::default(), &views[..]),
        (wall(0.0, 0.1, WHITE), &[]),
        (wall(9.0, 0.1, WHITE), &views),
    ] {
        let result = carved(&points, views, &config());
        assert_eq!(
            (result.cloud, result.removed, result.warning),
            (points, vec![], None)
        );
    }
}

/// The rule, pixel by pixel.
fn twin(mut points: PointCloud, views: &[View], config: &CarveConfig) -> (PointCloud, Vec<usize>) {
    let reach = i64::from(config.window_px) / 2;
    let n_pixels: usize = views.iter().map(|v| v.image.rgb.len() / 3).sum();
    // The smallest reach whose window holds 3 points on average.
    let gap = (0i64..)
        .find(|g| (2 * g + 1).pow(2) as f64 >= 3.0 * n_pixels as f64 / points.len() as f64)
        .unwrap();
    let mut removed = Vec::new();
    for _ in 0..config.max_rounds {
        let mut kept = vec![true; points.len()];
        for View { camera, image, .. } in views {
            let winners = brute_force(&points, camera, NEAR);
            let depth = |k: usize| {
                f64::from((camera.rotation * points.positions[k] + camera.translation).z as f32)
            };
            let (width, height) = (i64::from(camera.width), i64::from(camera.height));
            for (pixel, winner) in winners.iter().enumerate() {
                let Some(k) = *winner else { continue };
                let (x, y) = (pixel as i64 % width, pixel as i64 / width);
                let window = |reach: i64| -> Vec<usize> {
                    (y - reach..=y + reach)
                        .flat_map(|y| (x - reach..=x + reach).map(move |x| (x, y)))
                        .filter(|&(x, y)| (0..width).contains(&x) && (0..height).contains(&y))
                        .map(|(x, y)| (y * width + x) as usize)
                        .collect()
                };
                let front = depth(k) * (1.0 - config.depth_tolerance);
                if window(gap)
                    .iter()
                    .any(|&i| winners[i].is_some_and(|n| depth(n) < front))
                {
                    continue;
                }
                let excess = (0..3).map(|c| {
                    let values = window(reach)
                        .into_iter()
                        .map(|i| f64::from(image.rgb[3 * i + c]));
                    let (low, high) =
                        values.fold((255.0f64, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
                    let q = f64::from(points.colors[k][c]);
                    (low - q).max(q - high)
                });
                if excess.fold(0.0, f64::max) > 255.0 * config.threshold {
                    kept[k] = false;
                }
            }
        }
        let n = kept.iter().filter(|k| !**k).count();
        if n == 0 {
            break;
        }
        points.retain(&kept);
        removed.push(n);
    }
    (points, removed)
}

#[test]
fn carving_agrees_with_the_rule_pixel_by_pixel() {
    let mut random = Random::new(5);
    let slab = (0..800).map(|_| random.in_cube(1.0) * dvec3(1.0, 1.0, 0.2));
    let mut points = cloud(slab.collect());
    for color in &mut points.colors {
        *color = [0; 3].map(|_: u8| random.index(256) as u8);
    }
    let mut views: Vec<View> = ring(3, DVec3::ZERO)
        .into_iter()
        .map(|c| plain(c.resized(40, 30), WHITE))
        .collect();
    for view in &mut views {
        view.image
            .rgb
            .iter_mut()
            .for_each(|v| *v = 80 + random.index(90) as u8);
    }
    for (threshold, window_px, depth_tolerance) in
        [(0.2, 5, 0.2), (0.1, 5, 0.9), (0.2, 1, 0.1), (0.3, 9, 0.15)]
    {
        let config = CarveConfig {
            threshold,
            window_px,
            depth_tolerance,
            max_share: 0.999,
            ..config()
        };
        let run = |n_threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads);
            pool.build()
                .unwrap()
                .install(|| carved(&points, &views, &config))
        };
        let found = run(1);
        assert_eq!(found, run(3));
        let (expected, removed) = twin(points.clone(), &views, &config);
        assert_eq!(found.removed, removed);
        assert!(found.cloud == expected);
        assert!(removed.len() > 1 && removed[0] > 40, "{removed:?}");
        // One photograph a little brighter makes a difference.
        let mut other = views.clone();
        other[1].image.rgb.iter_mut().for_each(|v| *v += 40);
        assert!(carved(&points, &other, &config).cloud != expected);
    }
}

fn builtin() -> Scene {
    scene(&BuiltinOptions {
        width: 120,
        n_test: 8,
        ..BuiltinOptions::default()
    })
}

#[test]
fn carving_brings_the_cloud_nearer_to_photographs_that_it_has_not_seen() {
    let scene = builtin();
    let cameras: Vec<Camera> = scene.train.iter().map(|v| v.camera.clone()).collect();
    let frame = Focus::find(&cameras, &scene.cloud).unwrap().frame();
    let result = carve(&scene.cloud, &frame, &scene.train, &config(), NEAR).unwrap();
    assert_eq!(result.warning, None);
    let score =
        |cloud: &PointCloud| score_point_splat(cloud, &frame, &scene.test, &paper()).unwrap();
    let (before, after) = (score(&scene.cloud), score(&result.cloud));
    eprintln!(
        "{:?} of {}: {before:?} -> {after:?}",
        result.removed,
        scene.cloud.len()
    );
    let n_removed: usize = result.removed.iter().sum();
    assert!(n_removed > 0 && n_removed < scene.cloud.len() / 5);
    assert!(after.psnr_covered.unwrap() > before.psnr_covered.unwrap() + 0.1);
    // What is left agrees with all photographs that see it.
    let again = carve(&result.cloud, &frame, &scene.train, &config(), NEAR).unwrap();
    assert_eq!(again.removed, Vec::<usize>::new());
    assert!(again.cloud == result.cloud);
}

#[test]
fn a_run_starts_and_splats_from_the_carved_cloud() {
    let mut scene = builtin();
    // A magenta curtain right before the first camera.
    let first = scene.train[0].camera.clone();
    let before = first.center() + first.forward() * 0.5;
    let curtain = (0..400).map(|i| {
        let (x, y) = (f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5);
        before + 0.01 * (x * first.rotation.row(0) + y * first.rotation.row(1))
    });
    let curtain = colored(curtain.collect(), [255, 0, 255]);
    scene.cloud.positions.extend(curtain.positions);
    scene.cloud.colors.extend(curtain.colors);
    scene.cloud.confidence = None;
    let mut config = paper();
    config.views.count = 6;
    config.field.n_candidates = 64;
    config.scene.max_points = Some(usize::MAX);
    let plain = prepare(&scene, &config, &mut Seconds::default()).unwrap();
    assert!(plain.carved.is_none());
    assert_eq!(plain.start.len(), scene.cloud.len());

    config.carve.enabled = true;
    let mut seconds = Seconds::default();
    let prepared = prepare(&scene, &config, &mut seconds).unwrap();
    assert!(seconds.carve.is_some());
    let cloud = &prepared.carved.as_ref().expect("a carved cloud").cloud;
    // A window that holds black and white excuses any colour, so a few points stay.
    let magenta = |c: &PointCloud| c.colors.iter().filter(|c| **c == [255, 0, 255]).count();
    assert_eq!(magenta(&scene.cloud), 400);
    assert!(magenta(cloud) < 40, "{}", magenta(cloud));
    assert_eq!(prepared.start.len(), cloud.len());
    // The same places, other goals: the splats changed with the cloud.
    assert_eq!(prepared.virtual_cameras, plain.virtual_cameras);
    let goals = |p: &gspotential::pipeline::Prepared| -> Vec<Vec<u32>> {
        p.supervision
            .virtual_views
            .iter()
            .map(|v| v.goal.texels())
            .collect()
    };
    assert_ne!(goals(&prepared), goals(&plain));
}
