//! The built-in object, the visual hull of its masks, and the Gaussians that lie apart from it.

use glam::{DVec3, Vec3};
use gspotential::camera::Camera;
use gspotential::cloud::hull::visual_hull;
use gspotential::cloud::outline::Outline;
use gspotential::cloud::splat::splat_views;
use gspotential::config::{Config, OutsideMask};
use gspotential::pipeline::{Prepared, focus_of, load_scene, prepare};
use gspotential::run::Seconds;
use gspotential::scene::{CloudSource, LoadOptions, Outside, Scene, SceneSource, View};
use gspotential::train::outliers::{lambda, outliers};
use gspotential::train::{Trained, Trainer};

use crate::gpu::rig::context;
use crate::kit::program::{run, succeed};

const WIDTH: u32 = 60;

fn options() -> LoadOptions {
    let mut config = Config::preset("paper").expect("a preset");
    config.scene.n_test = 6;
    LoadOptions::new(&config)
}

fn object_with(options: &LoadOptions) -> Scene {
    load_scene(&SceneSource::Object { width: WIDTH }, options).expect("a scene")
}

fn object() -> Scene {
    object_with(&options())
}

fn views(scene: &Scene) -> impl Iterator<Item = &View> {
    scene.train.iter().chain(&scene.test)
}

fn set(view: &View) -> &[bool] {
    &view.mask.as_ref().expect("a mask").set
}

fn pixel(view: &View, i: usize) -> [u8; 3] {
    [0, 1, 2].map(|c| view.image.rgb[3 * i + c])
}

#[test]
fn the_object_is_whole_in_every_view_and_stands_before_one_ground() {
    let white = |outside_mask| LoadOptions {
        outside_mask,
        ..options()
    };
    for (scene, outside, ground) in [
        (object(), Outside::Background, [0; 3]),
        (
            object_with(&white(OutsideMask::Ignored)),
            Outside::Ignored,
            [255; 3],
        ),
        (
            object_with(&white(OutsideMask::Kept)),
            Outside::Kept,
            [255; 3],
        ),
    ] {
        assert_eq!((scene.train.len(), scene.test.len()), (4, 6));
        assert!(scene.warnings.iter().all(|w| !w.contains("width")));
        for view in views(&scene) {
            let name = &view.camera.name;
            assert_eq!(view.mask.as_ref().expect("a mask").outside, outside);
            let (width, height) = (view.image.width as usize, view.image.height as usize);
            let share =
                set(view).iter().filter(|set| **set).count() as f64 / (width * height) as f64;
            assert!((0.08..0.4).contains(&share), "{name}: {share}");
            for (i, is_set) in set(view).iter().enumerate() {
                let (x, y) = (i % width, i / width);
                let at_rim = x == 0 || y == 0 || x == width - 1 || y == height - 1;
                assert!(!(at_rim && *is_set), "{name} is cut off at {x}, {y}");
                if at_rim {
                    assert_eq!(pixel(view, i), ground, "{name}");
                }
            }
        }
    }
}

#[test]
fn the_same_bits_on_one_and_two_threads_and_for_any_number_of_test_views() {
    let on = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads);
        pool.build().unwrap().install(object)
    };
    let (one, two) = (on(1), on(2));
    assert_eq!(one.cloud, two.cloud);
    for (a, b) in views(&one).zip(views(&two)) {
        assert_eq!(
            (&a.camera, &a.image, &a.mask),
            (&b.camera, &b.image, &b.mask)
        );
    }
}

/// The object turns under a light that stays: what faces the camera is lit alike from all sides.
#[test]
fn light_stays_with_the_camera() {
    let scene = object();
    let brightness = |view: &View| {
        let own = (0..set(view).len()).filter(|i| set(view)[*i]);
        let sums = own.map(|i| pixel(view, i).map(f64::from).iter().sum::<f64>());
        let sums: Vec<f64> = sums.collect();
        sums.iter().sum::<f64>() / (3.0 * sums.len() as f64)
    };
    let all: Vec<f64> = scene.train.iter().map(brightness).collect();
    let (least, most) = all
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(l, m), b| (l.min(*b), m.max(*b)));
    // A light that stood by the object would leave a side in the dark.
    assert!(most < 1.25 * least, "{all:?}");
}

#[test]
fn its_cloud_lies_on_the_object_and_clouds_of_more_views_have_more() {
    let of = |cloud| object_with(&LoadOptions { cloud, ..options() });
    let exact = of(Some(CloudSource::Exact));
    for view in &exact.train {
        for p in &exact.cloud.positions {
            let (at, depth) = view.camera.project(*p);
            assert!(depth > 0.0);
            let (x, y) = (at.x as usize, at.y as usize);
            let width = view.image.width as usize;
            let near = |x: usize, y: usize| set(view).get(y * width + x).copied().unwrap_or(false);
            let is_near = (y.saturating_sub(1)..y + 2)
                .any(|y| (x.saturating_sub(1)..x + 2).any(|x| near(x, y)));
            assert!(is_near, "{p} beside the mask of {}", view.camera.name);
        }
    }
    assert!(
        exact
            .cloud
            .positions
            .iter()
            .all(|p| p.z > -1e-9 && p.z < 1.4)
    );
    let n = |cloud| of(cloud).cloud.len();
    let own = n(None);
    assert!(own > 1000, "{own}");
    assert!(
        n(Some(CloudSource::Views(1))) < own / 2 && n(Some(CloudSource::Views(8))) > own * 3 / 2
    );
    assert_eq!(n(Some(CloudSource::Random)), of(None).cloud.len());
}

#[test]
fn its_name_is_taken_wherever_a_scene_is_named() {
    for (text, width) in [("builtin:object", 320), ("builtin:object:64", 64)] {
        let source: SceneSource = text.parse().expect("a source");
        assert_eq!(source, SceneSource::Object { width });
        assert_eq!(
            source.to_string().parse::<SceneSource>().expect("a source"),
            source
        );
        assert_eq!(source.name(), "builtin-object");
        assert_eq!(source.at_most(40), SceneSource::Object { width: 40 });
    }
    for wrong in ["builtin:object:7", "builtin:objects", "builtin:object:"] {
        assert!(wrong.parse::<SceneSource>().is_err(), "{wrong}");
    }
    let stamp = |width| SceneSource::Object { width }.stamp(None);
    assert!(stamp(64) != stamp(65) && stamp(64) != SceneSource::Builtin { width: 64 }.stamp(None));
}

/// The pixel of a view that a point falls into; `None` beyond its frame.
fn pixel_of(view: &View, point: DVec3) -> Option<(usize, usize)> {
    let (at, depth) = view.camera.project(point);
    let (width, height) = (f64::from(view.image.width), f64::from(view.image.height));
    let is_in = depth > 0.0 && (0.0..width).contains(&at.x) && (0.0..height).contains(&at.y);
    is_in.then_some((at.x as usize, at.y as usize))
}

/// Whether a view has a point in its frame and within its mask.
fn agrees(view: &View, point: DVec3) -> bool {
    let width = view.image.width as usize;
    pixel_of(view, point).is_some_and(|(x, y)| set(view)[y * width + x])
}

/// The share of a mask that these points cover, seen from its view, each with the pixels around its own.
fn cover(view: &View, points: &[DVec3]) -> f64 {
    let (width, height) = (view.image.width as usize, view.image.height as usize);
    let mut covered = vec![false; width * height];
    for (x, y) in points.iter().filter_map(|p| pixel_of(view, *p)) {
        for y in y.saturating_sub(1)..(y + 2).min(height) {
            for x in x.saturating_sub(1)..(x + 2).min(width) {
                covered[y * width + x] = true;
            }
        }
    }
    let inside = set(view).iter().zip(&covered).filter(|(set, _)| **set);
    let n_covered = inside.clone().filter(|(_, covered)| **covered).count();
    n_covered as f64 / inside.count() as f64
}

#[test]
fn the_hull_fills_every_mask_and_each_of_its_points_is_denied_by_one_view_at_most() {
    let scene = object();
    let (_, frame) = focus_of(&scene).expect("a focus");
    let hull = visual_hull(&scene.train, &frame).expect("a hull");
    assert!((500..60_000).contains(&hull.len()), "{}", hull.len());
    assert_eq!(hull.colors.len(), hull.len());
    let n_denied = |p: &DVec3| scene.train.iter().filter(|view| !agrees(view, *p)).count();
    let denied: Vec<usize> = hull.positions.iter().map(n_denied).collect();
    assert!(denied.iter().all(|n| *n <= 1));
    assert!(denied.contains(&1), "one view may deny a point");
    for view in views(&scene) {
        let share = cover(view, &hull.positions);
        assert!(share > 0.97, "{}: {share}", view.camera.name);
    }
    // The hull of one view fewer reaches as far at least, but for a cell's size; that of a scene without a place in common
    // is none.
    let three = visual_hull(&scene.train[..3], &frame).expect("a hull");
    let size = |points: &[DVec3]| {
        let low = points.iter().copied().reduce(DVec3::min).expect("a point");
        let high = points.iter().copied().reduce(DVec3::max).expect("a point");
        high - low
    };
    let (fewer, all) = (size(&three.positions), size(&hull.positions));
    assert!(fewer.cmpge(0.9 * all).all(), "{fewer} {all}");
    let mut none = scene.train.clone();
    for view in &mut none[..3] {
        view.mask.as_mut().expect("a mask").set.fill(false);
    }
    let error = visual_hull(&none, &frame)
        .expect_err("no place")
        .to_string();
    assert!(error.contains("no place in common"), "{error}");
    none[2].mask = None;
    let error = visual_hull(&none, &frame).expect_err("no mask").to_string();
    assert!(
        error.contains("train_02.png") && error.contains("no mask"),
        "{error}"
    );
}

fn config(settings: &[&str]) -> Config {
    let mut config = Config::preset("gaussianobject").expect("a preset");
    config.iterations = 60;
    config.scene.max_points = Some(600);
    let set = |config: Config, setting: &&str| config.set(setting);
    settings.iter().try_fold(config, set).expect("settings")
}

fn prepared(scene: &Scene, config: &Config) -> Prepared {
    prepare(scene, config, &mut Seconds::default()).expect("prepares")
}

fn trained(scene: &Scene, config: &Config) -> Trained {
    let ctx = context();
    let prepared = prepared(scene, config);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, config)
        .and_then(|mut trainer| trainer.run(&mut ()))
        .expect("trains")
}

#[test]
fn gaussianobjects_coarse_stage_starts_from_the_hull_and_learns() {
    let scene = object();
    let prepared = prepared(&scene, &config(&["scene.max_points=null"]));
    let (_, frame) = focus_of(&scene).expect("a focus");
    let hull = visual_hull(&scene.train, &frame).expect("a hull");
    assert_eq!(prepared.start.len(), hull.len());
    assert_eq!(prepared.start.sh_degree, 2);
    let first = frame.to_canonical(hull.positions[0]).as_vec3();
    assert!(prepared.start.means.contains(&first));
    assert!(
        prepared
            .supervision
            .real
            .iter()
            .all(|view| view.n_outlined > 0)
    );
    let trained = trained(&scene, &config(&[]));
    let l1 = |k: usize| trained.samples[k].real.l1;
    assert!(l1(trained.samples.len() - 1) < l1(0));
    assert_eq!(trained.gaussians.n_broken(), 0);
}

#[test]
fn a_scene_without_masks_has_no_hull_and_says_the_way_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let line = "train --scene builtin:32 --preset gaussianobject --iterations 5 --out r";
    let ended = run(folder.path(), line);
    assert_eq!(ended.code, Some(1), "{}", ended.log);
    for part in ["train_00.png", "no mask says", "model.start=cloud"] {
        assert!(ended.log.contains(part), "no `{part}` in: {}", ended.log);
    }
    let line = "train --scene builtin:object:48 --preset gaussianobject --iterations 5 --set scene.n_test=2 --out s";
    succeed(folder.path(), line);
}

/// A ball of Gaussians, some of them far from it.
fn ball(n_apart: usize) -> Vec<Vec3> {
    let mut means: Vec<Vec3> = (0..400)
        .map(|i| {
            let [a, b, c] =
                [1.0, 0.618_034, 0.414_214].map(|step: f32| (i as f32 * step).fract() - 0.5);
            0.2 * Vec3::new(a + (i as f32 * 0.303).fract(), b, c)
        })
        .collect();
    means.extend((0..n_apart).map(|i| Vec3::new(2.0 + i as f32, 3.0, -1.0)));
    means
}

/// The rule in words, one by one.
fn apart_by_hand(means: &[Vec3], lambda: f64) -> Vec<bool> {
    let n = means.len();
    let k = (n as f64).sqrt() as usize;
    let near: Vec<Vec<f64>> = means
        .iter()
        .map(|a| {
            let mut all: Vec<f64> = means
                .iter()
                .map(|b| a.as_dvec3().distance_squared(b.as_dvec3()))
                .collect();
            all.sort_unstable_by(f64::total_cmp);
            all.truncate(k);
            all
        })
        .collect();
    let all: Vec<f64> = near.concat();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let variance =
        all.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / (all.len() - 1) as f64;
    let own = |near: &Vec<f64>| near.iter().sum::<f64>() / k as f64;
    near.iter()
        .map(|near| own(near) >= mean + lambda * variance.sqrt())
        .collect()
}

#[test]
fn gaussians_that_lie_apart_are_those_of_the_rule() {
    for n_apart in [1, 3, 7] {
        for lambda in [1.0, 2.326] {
            let means = ball(n_apart);
            let found = outliers(&means, lambda);
            assert_eq!(
                found,
                apart_by_hand(&means, lambda),
                "{n_apart} at {lambda}"
            );
            assert!(
                found[..400].iter().all(|apart| !apart),
                "{n_apart} at {lambda}"
            );
        }
    }
    assert!(outliers(&ball(3), 1.0)[400..].iter().all(|apart| *apart));
    // Few are too few to tell, and among equals none is apart.
    assert_eq!(outliers(&[], 1.0), Vec::<bool>::new());
    assert_eq!(
        outliers(&[Vec3::X, Vec3::Y, 9.0 * Vec3::Z], 1.0),
        [false; 3]
    );
    assert_eq!(outliers(&[Vec3::X; 30], 1.0), [false; 30]);
}

#[test]
fn lambda_rises_while_it_densifies() {
    let config = Config::preset("gaussianobject").expect("a preset");
    assert_eq!(lambda(&config, 500), 1.0);
    assert!((lambda(&config, 6000) - 2.326_347_874).abs() < 1e-9);
    assert!((lambda(&config, 3250) - 0.5 * (1.0 + 2.326_347_874)).abs() < 1e-9);
}

#[test]
fn outliers_go_in_training_and_are_counted_and_without_the_key_none_does() {
    let scene = object();
    let settings = [
        "densify.outlier_interval=10",
        "densify.start=5",
        "densify.end=55",
        "densify.interval=1000",
    ];
    let with = trained(&scene, &config(&settings));
    let gone: Vec<usize> = with
        .plans
        .iter()
        .map(|plan| plan.counts.pruned_outliers)
        .collect();
    assert!(!gone.is_empty() && gone.iter().all(|n| *n > 0), "{gone:?}");
    assert_eq!(with.gaussians.len() + gone.iter().sum::<usize>(), 600);
    let without = trained(
        &scene,
        &config(&["densify.outlier_interval=null", "densify.interval=1000"]),
    );
    assert!(
        without
            .plans
            .iter()
            .all(|plan| plan.counts.pruned_outliers == 0)
    );
    assert_eq!(without.gaussians.len(), 600);
}

fn cameras(views: &[View]) -> Vec<Camera> {
    views.iter().map(|view| view.camera.clone()).collect()
}

#[test]
fn the_outline_is_ground_beyond_the_hull_and_leaves_the_splats_rim_out() {
    const RIM: usize = 4;
    const GROUND: [u8; 4] = [255; 4];
    let scene = object();
    let (_, frame) = focus_of(&scene).expect("a focus");
    let outline = Outline::of(&scene.train, &scene.cloud, &frame, [1.0; 3], RIM as f64);
    let outline = outline.expect("an outline");
    let splat = Config::preset("paper").expect("a preset").splat;
    let of = (&*cameras(&scene.test), &*cameras(&scene.train));
    let splats = splat_views(&scene.cloud, &frame, of, &splat, frame.near(0.01)).expect("splats");
    for (view, splat) in scene.test.iter().zip(splats) {
        let mut drawn = splat.clone();
        outline.draw(&view.camera, &mut drawn);
        let covered: Vec<bool> = splat.mask().collect();
        let width = splat.width as usize;
        let is_rim = |i: usize| {
            let near = |at: usize, limit: usize| at.saturating_sub(RIM)..=(at + RIM).min(limit - 1);
            let mut rows = near(i / width, covered.len() / width);
            rows.any(|y| near(i % width, width).any(|x| !covered[y * width + x]))
        };
        let (mut n_ground, mut n_kept, mut n_kept_within) = (0, 0, 0);
        let texels = drawn.rgba.chunks_exact(4).zip(splat.rgba.chunks_exact(4));
        for (i, (pixel, before)) in texels.enumerate() {
            let name = format!("{} {i}", view.camera.name);
            if pixel[3] == 0 {
                continue;
            } else if pixel == GROUND && before != GROUND {
                assert!(!set(view)[i], "{name} shows the subject");
                n_ground += 1;
            } else {
                assert!(pixel == before && !is_rim(i), "{name} is rim");
                n_kept += 1;
                n_kept_within += usize::from(set(view)[i]);
            }
        }
        let n_empty = set(view).iter().filter(|set| !**set).count();
        assert!(n_ground * 10 > n_empty * 8, "{n_ground} of {n_empty}");
        // Discs of up to four pixels reach beyond the subject; what is left of them hardly does.
        let n_within = covered.iter().zip(set(view)).filter(|(c, s)| **c && **s);
        let before = n_within.count() as f64 / covered.iter().filter(|c| **c).count() as f64;
        let after = n_kept_within as f64 / f64::from(n_kept);
        assert!(
            n_kept > 20 && after > 0.93 && before < 0.8,
            "{n_kept}: {before} {after}"
        );
    }
    // A photograph that has a part of the subject alone bounds that part.
    let mut cropped = scene;
    let width = cropped.train[0].image.width as usize;
    let mask = cropped.train[0].mask.as_mut().expect("a mask");
    let columns = mask.set.iter_mut().enumerate();
    columns.for_each(|(i, set)| *set &= i % width < width / 2);
    let (train, cloud) = (&cropped.train, &cropped.cloud);
    assert!(Outline::of(train, cloud, &frame, [1.0; 3], 4.0).is_none());
}

#[test]
fn virtual_views_have_an_outline_where_it_is_asked_for_and_grounds_are_the_same() {
    let first_texels = |changes: &[&str]| -> Vec<u32> {
        let preset = Config::preset("gspotential").expect("a preset");
        let config = changes.iter().fold(preset, |config, change| {
            config.set(change).expect("a setting")
        });
        let scene = object_with(&LoadOptions::new(&config));
        let prepared = prepare(&scene, &config, &mut Seconds::default()).expect("prepares");
        let views = prepared.supervision.virtual_views.iter();
        views.map(|view| view.goal.texels()[0]).collect()
    };
    let few = ["views.count=8", "scene.n_test=2"];
    let with = |change| first_texels(&[few[0], few[1], "model.background=[1,0,0]", change]);
    let count = |texels: Vec<u32>, texel: u32| texels.into_iter().filter(|t| *t == texel).count();
    assert!(count(with("splat.outline=true"), 0xff00_00ff) > 4);
    assert_eq!(count(with("splat.outline=false"), 0xff00_00ff), 0);
    assert_eq!(count(with("loss.random_background=true"), 0xff00_00ff), 0);
}
