//! Warped photographs against ray-traced views, and what the errors measured at photographs decide.

use glam::{DVec3, dvec3};
use gspotential::camera::{Camera, Frame};
use gspotential::cloud::splat::{SplatImage, splat_views};
use gspotential::cloud::warp::Warp;
use gspotential::config::{ColorSource, Config, Footprint};
use gspotential::pipeline::prepare;
use gspotential::run::Seconds;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{Image, Mask, Outside, PointCloud, View};

use crate::geometry::{Random, camera, paper};

const NEAR: f64 = 0.01;

fn config(colors: ColorSource) -> Config {
    let mut config = paper();
    config.splat.colors = colors;
    config
}

/// A world that is ray-traced: the colour and the place where a ray from `eye` ends.
type World = fn(eye: DVec3, ray: DVec3) -> (DVec3, [f64; 3]);

/// A slanted plane through the origin, in soft colours.
fn plane(eye: DVec3, ray: DVec3) -> (DVec3, [f64; 3]) {
    let normal = dvec3(0.3, -0.2, 1.0);
    let p = eye - ray * (eye.dot(normal) / ray.dot(normal));
    (p, soft(p))
}

fn soft(p: DVec3) -> [f64; 3] {
    [
        128.0 + 60.0 * (1.5 * p.x).sin() + 50.0 * (p.y + 1.0).cos(),
        128.0 + 90.0 * (p.x - 1.5 * p.y).sin(),
        60.0 + 40.0 * (0.5 * p.x + p.y).cos(),
    ]
}

/// A red square at z = 1 over a green floor at z = 0, each without a texture.
fn square(eye: DVec3, ray: DVec3) -> (DVec3, [f64; 3]) {
    let at = |z: f64| eye + ray * ((z - eye.z) / ray.z);
    match at(1.0) {
        p if p.x.abs() < 0.4 && p.y.abs() < 0.4 => (p, [220.0, 0.0, 0.0]),
        _ => (at(0.0), [0.0, 200.0, 0.0]),
    }
}

/// The place in the world that the camera shows at a place in its image, with its colour.
fn traced(world: World, camera: &Camera, u: f64, v: f64) -> (DVec3, [f64; 3]) {
    let local = dvec3(
        (u - camera.cx) / camera.fx,
        (v - camera.cy) / camera.fy,
        1.0,
    );
    world(camera.center(), camera.rotation.transpose() * local)
}

fn photograph(world: World, camera: Camera) -> View {
    let centers = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    let colors = centers.map(|(x, y)| {
        let (_, color) = traced(world, &camera, f64::from(x) + 0.5, f64::from(y) + 0.5);
        color.map(|c| c.round() as u8)
    });
    let rgb = colors.flatten().collect();
    View {
        image: Image {
            width: camera.width,
            height: camera.height,
            rgb,
        },
        camera,
        mask: None,
        prior: None,
    }
}

/// Points where rays through random places of the photographs end, in grey: `n` of each.
fn seen_points(world: World, views: &[View], n: usize) -> PointCloud {
    let mut random = Random::new(5);
    let mut points = PointCloud::default();
    for View { camera, .. } in views {
        for _ in 0..n {
            let u = random.in_range(0.0, f64::from(camera.width));
            let v = random.in_range(0.0, f64::from(camera.height));
            points.positions.push(traced(world, camera, u, v).0);
            points.colors.push([90; 3]);
        }
    }
    points
}

fn views(world: World) -> Vec<View> {
    let eyes = [
        dvec3(2.0, 0.5, 3.0),
        dvec3(-1.5, 1.5, 3.0),
        dvec3(0.0, -2.0, 3.5),
    ];
    let look = |eye: &DVec3| camera(*eye, dvec3(0.05, 0.0, 0.0)).resized(96, 72);
    eyes.iter()
        .map(|eye| photograph(world, look(eye)))
        .collect()
}

fn cameras(views: &[View]) -> Vec<Camera> {
    views.iter().map(|view| view.camera.clone()).collect()
}

/// The splats of `cameras`, and what the warp makes of them with what it painted.
fn painted(
    points: &PointCloud,
    views: &[View],
    targets: &[Camera],
    config: &Config,
) -> (Vec<SplatImage>, Vec<SplatImage>, Vec<Vec<bool>>) {
    let frame = Frame::IDENTITY;
    let sources = cameras(views);
    let splats = splat_views(points, &frame, (targets, &sources), &config.splat, NEAR).unwrap();
    let warp = Warp::new(points, &frame, views, config, NEAR).unwrap();
    let mut images = splats.clone();
    let seen = warp.unwrap().paint(targets, &mut images).unwrap();
    (splats, images, seen)
}

/// Greatest difference, levels, from the ray-traced view over the painted pixels, and their share.
fn worst(world: World, points: &PointCloud, views: &[View], target: &Camera) -> (f64, f64) {
    let targets = std::slice::from_ref(target);
    let (_, images, seen) = painted(points, views, targets, &config(ColorSource::Photographs));
    let width = target.width as usize;
    let mut worst = 0.0_f64;
    for pixel in (0..seen[0].len()).filter(|pixel| seen[0][*pixel]) {
        let (u, v) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        let (_, color) = traced(world, target, u, v);
        for (c, truth) in color.iter().enumerate() {
            worst = worst.max((f64::from(images[0].rgba[4 * pixel + c]) - truth).abs());
        }
    }
    let n = seen[0].iter().filter(|seen| **seen).count();
    (worst, n as f64 / seen[0].len() as f64)
}

#[test]
fn a_warped_plane_is_the_ray_traced_view_up_to_interpolation() {
    let finer = |view: View| photograph(plane, view.camera.resized(192, 144));
    let views: Vec<View> = views(plane).into_iter().map(finer).collect();
    let points = seen_points(plane, &views, 14_000);
    // The middle, where points lie dense: a pixel with a single disc has no slope.
    let wide = camera(dvec3(0.4, 0.8, 2.6), DVec3::ZERO).resized(192, 144);
    let target = Camera {
        fx: 1.5 * wide.fx,
        fy: 1.5 * wide.fy,
        ..wide
    };
    let (off, share) = worst(plane, &points, &views, &target);
    // Half a level of rounding in the photographs and in the result. Between pixels an eighth of the
    // second derivative over a pixel, across and down: where a pixel is 0.07 wide,
    // 2 / 8 * 90 * (1.8 * 0.07)^2 or 0.4 levels.
    assert!(share > 0.95, "{share}");
    assert!(off < 1.5, "{off}");

    // A photograph that is a pixel off, and points that lie below the plane.
    let mut shifted = views.clone();
    for view in &mut shifted {
        view.camera.cx += 1.0;
    }
    assert!(worst(plane, &points, &shifted, &target).0 > 1.5);
    let mut sunken = points.clone();
    sunken.positions.iter_mut().for_each(|p| p.z -= 0.05);
    assert!(worst(plane, &sunken, &views, &target).0 > 1.5);
}

#[test]
fn what_is_hidden_from_a_photograph_does_not_take_the_occluders_color() {
    let views = views(square);
    let points = seen_points(square, &views, 7000);
    // From the far side of the third photograph, the square hides other floor.
    let target = camera(dvec3(0.3, 2.0, 3.5), DVec3::ZERO).resized(96, 72);
    let targets = std::slice::from_ref(&target);
    let red_on_floor = |depth_tolerance: f64| {
        let mut config = config(ColorSource::Photographs);
        config.views.visibility.depth_tolerance = depth_tolerance;
        let (_, images, seen) = painted(&points, &views, targets, &config);
        let (mut red, mut floor) = (0, 0);
        for (pixel, seen) in seen[0].iter().enumerate() {
            let (u, v) = ((pixel % 96) as f64 + 0.5, (pixel / 96) as f64 + 0.5);
            if *seen && traced(square, &target, u, v).0.z == 0.0 {
                floor += 1;
                red += u32::from(images[0].rgba[4 * pixel] > 0);
            }
        }
        assert!(floor > 3000, "{floor}");
        red
    };
    assert_eq!(red_on_floor(0.05), 0);
    // A photograph that sees through the square.
    assert!(red_on_floor(0.9) > 50);
}

#[test]
fn the_splat_stays_where_no_photograph_sees_the_surface() {
    let views = views(plane);
    let points = seen_points(plane, &views, 3000);
    // From below, and photographs that look elsewhere or that masks hide.
    let below = Camera {
        fx: 150.0,
        fy: 150.0,
        ..camera(dvec3(0.4, 0.8, -2.6), DVec3::ZERO)
    };
    let above = camera(dvec3(0.4, 0.8, 2.6), DVec3::ZERO);
    let away: Vec<View> = views
        .iter()
        .map(|view| {
            let eye = view.camera.center();
            photograph(plane, camera(eye, eye * 2.0 + DVec3::Z))
        })
        .collect();
    let mut hidden = views.clone();
    for view in &mut hidden {
        view.mask = Some(Mask {
            set: vec![false; 96 * 72],
            outside: Outside::Ignored,
        });
    }
    let config = config(ColorSource::Photographs);
    for (views, target, is_seen) in [
        (&views, &above, true),
        (&views, &below, false),
        (&away, &above, false),
        (&hidden, &above, false),
    ] {
        let (before, after, seen) = painted(&points, views, std::slice::from_ref(target), &config);
        assert!(before[0].coverage() > 0.1);
        assert_eq!(before[0] != after[0], is_seen);
        assert_eq!(seen[0].contains(&true), is_seen);
        assert!(before[0].mask().eq(after[0].mask()));
    }
}

#[test]
fn the_nearest_ray_counts_most_by_the_eighth_power_of_the_cosine() {
    let eyes = [dvec3(0.0, 0.0, 3.0), dvec3(1.2, 0.0, 3.0)];
    let mut views: Vec<View> = eyes
        .iter()
        .map(|eye| photograph(plane, camera(*eye, DVec3::ZERO)))
        .collect();
    for (view, level) in views.iter_mut().zip([40, 200]) {
        view.image.rgb.fill(level);
    }
    let points = seen_points(plane, &views, 5000);
    let target = camera(dvec3(0.3, 0.1, 2.0), DVec3::ZERO);
    let targets = std::slice::from_ref(&target);
    let (_, images, seen) = painted(&points, &views, targets, &config(ColorSource::Photographs));
    let pixel = 24 * 64 + 32;
    assert!(seen[0][pixel]);
    let (p, _) = traced(plane, &target, 32.5, 24.5);
    let weights = eyes.map(|eye| {
        let [a, b] = [eye - p, target.center() - p].map(DVec3::normalize);
        a.dot(b).powi(8)
    });
    let mean = (40.0 * weights[0] + 200.0 * weights[1]) / (weights[0] + weights[1]);
    let found = f64::from(images[0].rgba[4 * pixel]);
    assert!((found - mean).abs() <= 1.0, "{found} {mean}");
    assert!(mean > 45.0 && mean < 130.0, "{mean}");
}

/// The ray-traced plane with points in the photographs' own colours.
fn colored(views: &[View], n: usize) -> PointCloud {
    let mut points = seen_points(plane, views, n);
    points.colors = points
        .positions
        .iter()
        .map(|p| soft(*p).map(|c| c as u8))
        .collect();
    points
}

#[test]
fn pixels_weigh_less_where_photographs_and_splat_disagree() {
    let views = views(plane);
    let target = camera(dvec3(0.4, 0.8, 2.6), DVec3::ZERO).resized(96, 72);
    let targets = std::slice::from_ref(&target);
    let is_near = |p: DVec3, reach: f64| p.x.abs() < reach && p.y.abs() < reach;
    // In a square about the middle, points of each photograph have another colour; nowhere else do
    // the photographs and the points contradict one another.
    let weights = |levels: [u8; 3]| {
        let mut points = colored(&views, 7000);
        for (i, color) in points.colors.iter_mut().enumerate() {
            if is_near(points.positions[i], 0.6) {
                *color = color.map(|c| c.saturating_add(levels[i / 7000]));
            }
        }
        let mut disagreeing = views.clone();
        for (view, level) in disagreeing.iter_mut().zip(levels) {
            for pixel in 0..96 * 72 {
                let (u, v) = ((pixel % 96) as f64 + 0.5, (pixel / 96) as f64 + 0.5);
                if is_near(traced(plane, &view.camera, u, v).0, 0.6) {
                    for c in &mut view.image.rgb[3 * pixel..3 * pixel + 3] {
                        *c = c.saturating_add(level);
                    }
                }
            }
        }
        let blend = config(ColorSource::Blend);
        let (_, images, _) = painted(&points, &disagreeing, targets, &blend);
        let mut sums = [(0.0, 0.0); 2];
        for (pixel, rgba) in images[0].rgba.chunks_exact(4).enumerate() {
            let (u, v) = ((pixel % 96) as f64 + 0.5, (pixel / 96) as f64 + 0.5);
            let (p, _) = traced(plane, &target, u, v);
            // Beside the border of the square both count.
            if rgba[3] > 0 && (is_near(p, 0.4) || !is_near(p, 0.8)) {
                let sum = &mut sums[usize::from(is_near(p, 0.6))];
                *sum = (sum.0 + f64::from(rgba[3]) / 255.0, sum.1 + 1.0);
            }
        }
        sums.map(|(sum, n)| sum / n)
    };
    let [around, within] = weights([0, 40, 80]);
    assert!(around > 0.95 && within < around - 0.1, "{around} {within}");
    let [around, within] = weights([0; 3]);
    assert!((around - within).abs() < 0.1, "{around} {within}");
}

#[test]
fn a_blend_lies_between_photographs_and_splat() {
    let views = views(plane);
    let mut points = colored(&views, 7000);
    // Splats of half the contrast have errors that photographs have not: these win.
    for color in points.colors.iter_mut().flatten() {
        *color = 64 + *color / 2;
    }
    let target = camera(dvec3(0.4, 0.8, 2.6), DVec3::ZERO).resized(96, 72);
    let targets = std::slice::from_ref(&target);
    let (splats, warped, seen) =
        painted(&points, &views, targets, &config(ColorSource::Photographs));
    let (_, blended, _) = painted(&points, &views, targets, &config(ColorSource::Blend));
    let off = |image: &SplatImage| {
        let mut sum = 0.0;
        for pixel in (0..seen[0].len()).filter(|pixel| seen[0][*pixel]) {
            let (u, v) = ((pixel % 96) as f64 + 0.5, (pixel / 96) as f64 + 0.5);
            let (_, truth) = traced(plane, &target, u, v);
            sum += (f64::from(image.rgba[4 * pixel]) - truth[0]).abs();
        }
        sum
    };
    let [splat, warp, blend] = [&splats[0], &warped[0], &blended[0]].map(off);
    assert!(
        blend < 0.1 * splat && warp < 0.1 * splat,
        "{splat} {warp} {blend}"
    );
}

#[test]
fn one_photograph_alone_is_warped_without_measured_errors() {
    let views = &views(plane)[..1];
    let points = colored(views, 7000);
    let targets = [camera(dvec3(0.4, 0.8, 2.6), DVec3::ZERO)];
    let warp = |colors| Warp::new(&points, &Frame::IDENTITY, views, &config(colors), NEAR).unwrap();
    let blend = warp(ColorSource::Blend).unwrap();
    assert!(blend.warning.as_ref().unwrap().contains("splat.colors"));
    assert_eq!(warp(ColorSource::Photographs).unwrap().warning, None);
    let (_, one, _) = painted(&points, views, &targets, &config(ColorSource::Blend));
    let (_, other, _) = painted(&points, views, &targets, &config(ColorSource::Photographs));
    assert!(one == other);
}

#[test]
fn warps_do_not_depend_on_the_number_of_threads() {
    let views = views(square);
    let points = seen_points(square, &views, 4000);
    let mut random = Random::new(9);
    let targets: Vec<Camera> = (0..12)
        .map(|i| camera(random.in_cube(1.0) + DVec3::Z * 3.0, DVec3::ZERO).resized(40 + i, 60 - i))
        .collect();
    for colors in [ColorSource::Photographs, ColorSource::Blend] {
        let run = |n_threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(n_threads)
                .build()
                .unwrap();
            pool.install(|| painted(&points, &views, &targets, &config(colors)))
        };
        let (splats, one, seen) = run(1);
        assert!(one != splats);
        assert!((splats, one, seen) == run(3));
    }
}

#[test]
fn targets_are_painted_where_the_config_says_so_and_cover_the_same() {
    let scene = scene(&BuiltinOptions {
        width: 48,
        n_test: 0,
        ..BuiltinOptions::default()
    });
    let goals = |colors: ColorSource| {
        let mut config = config(colors);
        config.views.count = 6;
        let prepared = prepare(&scene, &config, &mut Seconds::default()).unwrap();
        let views = prepared.supervision.virtual_views;
        let goals: Vec<Vec<u32>> = views.iter().map(|view| view.goal.texels()).collect();
        (goals, prepared.frame, prepared.virtual_cameras)
    };
    let (plain, frame, targets) = goals(ColorSource::Points);
    // Those of the splat alone.
    let config = paper();
    let near = frame.near(config.model.near);
    let sources = cameras(&scene.train);
    let splats = splat_views(
        &scene.cloud,
        &frame,
        (&targets, &sources),
        &config.splat,
        near,
    );
    let splats: Vec<Vec<u32>> = splats
        .unwrap()
        .iter()
        .map(|splat| bytemuck::pod_collect_to_vec(&splat.rgba))
        .collect();
    assert!(plain == splats);
    let warp = Warp::new(&scene.cloud, &frame, &scene.train, &config, near).unwrap();
    assert!(warp.is_none());
    let covered = |goals: &[Vec<u32>]| -> Vec<bool> {
        goals
            .iter()
            .flatten()
            .map(|texel| *texel >> 24 != 0)
            .collect()
    };
    let (warped, ..) = goals(ColorSource::Photographs);
    let (blended, ..) = goals(ColorSource::Blend);
    assert!(covered(&warped) == covered(&plain) && covered(&blended) == covered(&plain));
    assert!(warped != plain && blended != plain && blended != warped);
    let is_full = |goals: &[Vec<u32>]| {
        goals
            .iter()
            .flatten()
            .all(|t| [0, 255].contains(&(t >> 24)))
    };
    assert!(is_full(&warped) && !is_full(&blended));
}

#[test]
fn warping_without_discs_is_a_usage_error() {
    let mut config = config(ColorSource::Blend);
    config.validate().unwrap();
    config.splat.footprint = Footprint::Pixel;
    let error = config.validate().unwrap_err().to_string();
    assert!(error.contains("splat.colors"), "{error}");
    config.splat.colors = ColorSource::Points;
    config.validate().unwrap();
}
