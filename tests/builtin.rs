//! The built-in scene: determinism, exact geometry, and each imperfection on its own.

use glam::DVec2;
use gspotential::camera::Camera;
use gspotential::config::Config;
use gspotential::scene::builtin::{
    self, BuiltinOptions, CENTER, Hit, Imperfections, Traced, is_depth_edge, point_cloud,
    surface_distance, test_cameras, trace, train_cameras, unproject,
};
use gspotential::scene::{Image, LoadOptions, PointCloud, Scene, load_builtin};

const WIDTH: u32 = 96;

/// The training views and, pixel by pixel in the order of a cloud without imperfections, what
/// the truth says.
struct Truth {
    cameras: Vec<Camera>,
    traced: Vec<Traced>,
    pixels: Vec<Pixel>,
}

struct Pixel {
    view: usize,
    x: u32,
    y: u32,
    depth: f64,
    hit: Hit,
    is_edge: bool,
}

impl Truth {
    fn new() -> Self {
        let cameras = train_cameras(WIDTH);
        let traced: Vec<Traced> = cameras.iter().map(trace).collect();
        let mut pixels = Vec::new();
        for (view, (camera, traced)) in cameras.iter().zip(&traced).enumerate() {
            for y in 0..camera.height {
                for x in 0..camera.width {
                    let i = (y * camera.width + x) as usize;
                    pixels.push(Pixel {
                        view,
                        x,
                        y,
                        depth: traced.depth[i],
                        hit: traced.hit[i],
                        is_edge: is_depth_edge(traced, x, y),
                    });
                }
            }
        }
        Self {
            cameras,
            traced,
            pixels,
        }
    }

    fn cloud(&self, imperfections: Imperfections) -> PointCloud {
        point_cloud(&self.cameras, &self.traced, 1, 7, &imperfections)
    }

    /// Depth of each point over the true one of its pixel, for a cloud with a point a pixel.
    fn depth_ratios(&self, cloud: &PointCloud) -> Vec<f64> {
        assert_eq!(cloud.len(), self.pixels.len());
        self.pixels
            .iter()
            .zip(&cloud.positions)
            .map(|(pixel, &p)| {
                let (DVec2 { x: u, y: v }, z) = self.cameras[pixel.view].project(p);
                assert!((u - f64::from(pixel.x) - 0.5).abs() < 1e-9, "off its ray");
                assert!((v - f64::from(pixel.y) - 0.5).abs() < 1e-9, "off its ray");
                z / pixel.depth
            })
            .collect()
    }

    /// Which pixels have a point in a cloud that only lost some.
    fn kept(&self, cloud: &PointCloud) -> Vec<bool> {
        let exact = self.cloud(Imperfections::NONE);
        let mut left = cloud.positions.iter().peekable();
        let kept = exact
            .positions
            .iter()
            .map(|p| left.next_if_eq(&p).is_some())
            .collect();
        assert_eq!(left.count(), 0, "a point is not where its pixel was");
        kept
    }
}

fn share(of: impl Iterator<Item = bool>) -> f64 {
    let (mut n, mut yes) = (0usize, 0usize);
    for is in of {
        n += 1;
        yes += usize::from(is);
    }
    assert!(n > 0);
    yes as f64 / n as f64
}

fn mean(of: impl Iterator<Item = f32>) -> f64 {
    let (n, sum) = of.fold((0usize, 0.0), |(n, sum), v| (n + 1, sum + f64::from(v)));
    assert!(n > 0);
    sum / n as f64
}

fn small(width: u32, seed: u64) -> Scene {
    builtin::scene(&BuiltinOptions {
        width,
        seed,
        n_test: 5,
        ..BuiltinOptions::default()
    })
}

#[test]
fn builtin_scene_has_the_same_bits_on_one_and_two_threads() {
    let on = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads);
        pool.build().unwrap().install(|| small(48, 3))
    };
    let (one, two) = (on(1), on(2));
    assert_eq!(one.cloud, two.cloud);
    assert_eq!(one.train.len(), 4);
    assert_eq!(one.test.len(), 5);
    let views = |s: &Scene| [s.train.clone(), s.test.clone()].concat();
    for (a, b) in views(&one).iter().zip(&views(&two)) {
        assert_eq!(a.camera, b.camera);
        assert_eq!(a.image, b.image);
        assert_eq!(a.image.rgb.len(), 48 * 32 * 3);
    }
}

#[test]
fn builtin_seed_changes_the_cloud_and_nothing_else() {
    let (a, b) = (small(48, 3), small(48, 4));
    assert_ne!(a.cloud, b.cloud);
    assert_eq!(a.train[2].image, b.train[2].image);
    assert_eq!(a.train[2].camera, b.train[2].camera);
    assert_eq!(a.test[2].image, b.test[2].image);
    assert_eq!(a.test[2].camera, b.test[2].camera);
}

#[test]
fn builtin_cameras_only_scale_with_the_image_size() {
    let at = |width| [train_cameras(width), test_cameras(width, 60)].concat();
    for (large, small) in at(480).iter().zip(at(96)) {
        let scaled = large.resized(96, 64);
        assert_eq!(scaled.rotation, small.rotation);
        assert_eq!(scaled.translation, small.translation);
        assert_eq!(scaled.name, small.name);
        for (a, b) in [
            (scaled.fx, small.fx),
            (scaled.fy, small.fy),
            (scaled.cx, small.cx),
            (scaled.cy, small.cy),
        ] {
            assert!((a - b).abs() < 1e-12 * a);
        }
    }
}

#[test]
fn builtin_width_out_of_range_is_clamped_with_a_warning() {
    let scene = builtin::scene(&BuiltinOptions {
        width: 0,
        n_test: 0,
        ..BuiltinOptions::default()
    });
    assert_eq!(scene.train[0].image.width, 16);
    assert_eq!(scene.warnings.len(), 1);
    assert!(small(48, 0).warnings.is_empty());
}

#[test]
fn exact_builtin_cloud_lies_on_the_surface_and_projects_to_its_pixel() {
    let truth = Truth::new();
    let cloud = truth.cloud(Imperfections::NONE);
    assert_eq!(cloud.confidence, None);
    for (ratio, (pixel, &p)) in truth
        .depth_ratios(&cloud)
        .into_iter()
        .zip(truth.pixels.iter().zip(&cloud.positions))
    {
        assert!((ratio - 1.0).abs() < 1e-12);
        assert!(surface_distance(p).abs() < 1e-9 * pixel.depth);
        let camera = &truth.cameras[pixel.view];
        let (u, v) = (f64::from(pixel.x) + 0.5, f64::from(pixel.y) + 0.5);
        let off = unproject(camera, u, v, pixel.depth * (1.0 - 1e-5));
        assert!(surface_distance(off) > 1e-9 * pixel.depth);
        let i = (pixel.y * camera.width + pixel.x) as usize;
        let normal = truth.traced[pixel.view].normal[i];
        assert!((normal.length() - 1.0).abs() < 1e-9);
        assert!(normal.dot(p - camera.center()) <= 0.0, "faces away");
    }
    let colors = |view: usize| truth.traced[view].image.rgb.chunks_exact(3);
    let expected: Vec<[u8; 3]> = (0..4)
        .flat_map(colors)
        .map(|c| [c[0], c[1], c[2]])
        .collect();
    assert_eq!(cloud.colors, expected);
}

/// Sphere tracing of the distance knows nothing of the intersections that `trace` solves for.
#[test]
fn builtin_depth_is_that_of_the_first_surface() {
    let mut n_slow = 0;
    for camera in test_cameras(WIDTH, 3).iter().chain(&train_cameras(WIDTH)) {
        let traced = trace(camera);
        for (i, &depth) in traced.depth.iter().enumerate() {
            let i = i as u32;
            let (u, v) = (f64::from(i % WIDTH) + 0.5, f64::from(i / WIDTH) + 0.5);
            let per_unit = unproject(camera, u, v, 1.0).distance(camera.center());
            let mut z = 0.0;
            let mut distance = f64::INFINITY;
            for _ in 0..400 {
                distance = surface_distance(unproject(camera, u, v, z));
                z += distance / per_unit;
                if distance < 1e-10 {
                    break;
                }
            }
            // Marching stalls along grazing rays, short of the surface.
            assert!(z <= depth + 1e-9, "({u}, {v}): {z} is behind {depth}");
            if distance >= 1e-10 {
                n_slow += 1;
            } else {
                assert!(z > depth - 1e-6, "({u}, {v}): {z} is before {depth}");
            }
        }
    }
    assert!(n_slow < 20, "{n_slow} rays did not arrive");
}

#[test]
fn builtin_points_are_at_or_behind_what_another_view_sees_there() {
    let truth = Truth::new();
    let cloud = truth.cloud(Imperfections::NONE);
    let (mut n_seen, mut n_hidden) = (0, 0);
    for (pixel, &p) in truth.pixels.iter().zip(&cloud.positions).step_by(7) {
        let other = &truth.cameras[(pixel.view + 1) % 4];
        let (DVec2 { x: u, y: v }, z) = other.project(p);
        if z <= 0.0 || u < 0.0 || v < 0.0 || u >= 96.0 || v >= 64.0 {
            continue;
        }
        // One pixel of the other view whose centre is the point's image.
        let through_point = Camera {
            width: 1,
            height: 1,
            cx: other.cx - u + 0.5,
            cy: other.cy - v + 0.5,
            ..other.clone()
        };
        let seen = trace(&through_point).depth[0];
        assert!(seen <= z * (1.0 + 1e-6), "{seen} is behind {z}");
        if seen > z * (1.0 - 1e-6) {
            n_seen += 1;
        } else {
            n_hidden += 1;
        }
    }
    assert!(n_seen > 500, "{n_seen}");
    assert!(n_hidden > 100, "no occlusion to learn from: {n_hidden}");
}

#[test]
fn depth_bias_is_smooth_and_reaches_its_peak() {
    let truth = Truth::new();
    let cloud = truth.cloud(Imperfections {
        depth_bias: 0.02,
        ..Imperfections::NONE
    });
    let ratios = truth.depth_ratios(&cloud);
    for view in ratios.chunks(ratios.len() / 4) {
        let peak = view.iter().map(|r| (r - 1.0).abs()).fold(0.0, f64::max);
        assert!((0.018..0.0202).contains(&peak), "{peak}");
        for (i, pair) in view.windows(2).enumerate() {
            if (i + 1) % WIDTH as usize != 0 {
                assert!((pair[1] - pair[0]).abs() < 0.003);
            }
        }
    }
    assert_ne!(ratios[0], ratios[ratios.len() / 4], "views share a bias");
}

#[test]
fn flying_pixels_lie_between_the_sides_of_depth_edges() {
    let truth = Truth::new();
    let cloud = truth.cloud(Imperfections {
        flying_pixels: 0.3,
        ..Imperfections::NONE
    });
    let ratios = truth.depth_ratios(&cloud);
    let is_off = |i: usize| (ratios[i] - 1.0).abs() > 1e-9;
    let edges = || (0..ratios.len()).filter(|&i| truth.pixels[i].is_edge);
    assert!(edges().count() > 1500, "{}", edges().count());
    let flying = share(edges().map(is_off));
    assert!((flying - 0.3).abs() < 0.04, "{flying}");
    for (i, pixel) in truth.pixels.iter().enumerate().filter(|(i, _)| is_off(*i)) {
        assert!(pixel.is_edge);
        let w = WIDTH as usize;
        let around = [
            (pixel.x > 0).then(|| i - 1),
            (pixel.x + 1 < WIDTH).then_some(i + 1),
            (pixel.y > 0).then(|| i - w),
            (pixel.y + 1 < 64).then_some(i + w),
        ];
        let z = ratios[i] * pixel.depth;
        assert!(around.into_iter().flatten().any(|j| {
            let other = truth.pixels[j].depth;
            z > pixel.depth.min(other) && z < pixel.depth.max(other)
        }));
    }
}

#[test]
fn outliers_are_gross_and_as_many_as_asked_for() {
    let truth = Truth::new();
    let cloud = truth.cloud(Imperfections {
        outliers: 0.05,
        ..Imperfections::NONE
    });
    let ratios = truth.depth_ratios(&cloud);
    let is_off = |r: &f64| (r - 1.0).abs() > 1e-9;
    let off = share(ratios.iter().map(is_off));
    assert!((off - 0.05).abs() < 0.006, "{off}");
    for r in ratios.iter().copied().filter(|r| is_off(r)) {
        assert!(
            (0.499..=0.851).contains(&r) || (1.199..=2.001).contains(&r),
            "{r}"
        );
    }
}

#[test]
fn holes_are_patches_of_the_share_asked_for() {
    let truth = Truth::new();
    let kept = truth.kept(&truth.cloud(Imperfections {
        holes: 0.1,
        ..Imperfections::NONE
    }));
    let off_backdrop = |i: &usize| truth.pixels[*i].hit != Hit::Backdrop;
    let lost = share((0..kept.len()).filter(off_backdrop).map(|i| !kept[i]));
    assert!((lost - 0.1).abs() < 0.001, "{lost}");
    assert!((0..kept.len()).all(|i| kept[i] || off_backdrop(&i)));
    // Single pixels would have lost one neighbour in ten.
    let together = share((1..kept.len()).filter(|&i| !kept[i]).map(|i| !kept[i - 1]));
    assert!(together > 0.6, "{together}");
}

#[test]
fn backdrop_loss_spares_everything_else() {
    let truth = Truth::new();
    let kept = truth.kept(&truth.cloud(Imperfections {
        backdrop_loss: 0.9,
        ..Imperfections::NONE
    }));
    let is_backdrop = |i: &usize| truth.pixels[*i].hit == Hit::Backdrop;
    let lost = share((0..kept.len()).filter(is_backdrop).map(|i| !kept[i]));
    assert!((lost - 0.9).abs() < 0.05, "{lost}");
    assert!((0..kept.len()).all(|i| kept[i] || is_backdrop(&i)));
}

#[test]
fn confidence_is_low_where_the_cloud_is_poor() {
    let truth = Truth::new();
    let with = |flying_pixels, outliers| {
        truth.cloud(Imperfections {
            flying_pixels,
            outliers,
            confidence: true,
            ..Imperfections::NONE
        })
    };
    let clean = with(0.0, 0.0);
    assert_eq!(clean.positions, truth.cloud(Imperfections::NONE).positions);
    let confidence = clean.confidence.unwrap();
    assert!(confidence.iter().all(|c| (1.0..=20.0).contains(c)));
    let of = |wanted: &dyn Fn(&Pixel) -> bool| {
        let pairs = truth.pixels.iter().zip(&confidence);
        mean(pairs.filter(|(p, _)| wanted(p)).map(|(_, &c)| c))
    };
    let is_object = |p: &Pixel| matches!(p.hit, Hit::Object(_));
    let good = of(&|p| is_object(p) && !p.is_edge);
    assert!(good > 10.0, "{good}");
    assert!(of(&|p| is_object(p) && p.is_edge) < 0.5 * good);
    assert!(of(&|p| p.hit == Hit::Floor && p.depth > 7.0) < 0.5 * good);
    assert!(of(&|p| p.hit == Hit::Backdrop) < 1.5);

    let poor = with(0.3, 0.05);
    let ratios = truth.depth_ratios(&poor);
    let worse = poor.confidence.unwrap();
    for i in 0..ratios.len() {
        if (ratios[i] - 1.0).abs() > 1e-9 {
            assert!(worse[i] < 0.7 * confidence[i] + 0.3, "{i}");
        } else {
            assert_eq!(worse[i], confidence[i]);
        }
    }
}

#[test]
fn builtin_imperfections_do_not_disturb_each_other() {
    let truth = Truth::new();
    let both = truth.cloud(Imperfections {
        depth_bias: 0.02,
        outliers: 0.05,
        ..Imperfections::NONE
    });
    let bias = truth.cloud(Imperfections {
        depth_bias: 0.02,
        ..Imperfections::NONE
    });
    let outliers = truth.cloud(Imperfections {
        outliers: 0.05,
        ..Imperfections::NONE
    });
    let [both, bias, outliers] = [both, bias, outliers].map(|c| truth.depth_ratios(&c));
    for i in 0..both.len() {
        assert!((both[i] - bias[i] * outliers[i]).abs() < 1e-9);
    }
}

#[test]
fn pixel_step_thins_the_builtin_cloud() {
    let truth = Truth::new();
    let cloud = |step| point_cloud(&truth.cameras, &truth.traced, step, 7, &Imperfections::NONE);
    assert_eq!(cloud(4).len(), 4 * 24 * 16);
    assert_eq!(cloud(0).len(), 4 * 96 * 64);
    assert_eq!(cloud(4).positions[1], cloud(1).positions[4]);
}

#[test]
fn builtin_views_are_in_free_space_and_look_at_the_centre() {
    let test = test_cameras(WIDTH, 60);
    let train = train_cameras(WIDTH);
    for camera in test.iter().chain(&train) {
        let eye = camera.center();
        let to_center = CENTER - eye;
        assert!(surface_distance(eye) > 0.3, "{}", camera.name);
        assert!((3.6..4.2).contains(&to_center.length()), "{}", camera.name);
        let off_axis = camera.forward().angle_between(to_center);
        assert!(off_axis.to_degrees() < 2.0, "{}", camera.name);
        assert!(camera.up().z > 0.0, "{}", camera.name);
        assert!((camera.rotation.determinant() - 1.0).abs() < 1e-12);
    }
    let elevation = |c: &Camera| {
        let outward = c.center() - CENTER;
        (outward.z / outward.length()).asin().to_degrees()
    };
    assert!(test.iter().all(|c| (4.9..75.1).contains(&elevation(c))));
    assert!(train.iter().all(|c| (15.0..40.0).contains(&elevation(c))));
    let low = test.iter().filter(|c| elevation(c) < 29.0).count();
    assert!(
        (26..=30).contains(&low),
        "uneven in area: {low} of 60 are low"
    );
    let azimuth = |c: &Camera| (c.center().y).atan2(c.center().x).to_degrees();
    for quarter in 0..4 {
        let from = -180.0 + 90.0 * f64::from(quarter);
        let inside = |c: &&Camera| (from..from + 90.0).contains(&azimuth(c));
        let n = test.iter().filter(inside).count();
        assert!((13..=17).contains(&n), "{n} in the quarter from {from}");
    }
    let mut ring: Vec<f64> = train.iter().map(azimuth).collect();
    ring.sort_by(f64::total_cmp);
    ring.push(ring[0] + 360.0);
    let gaps: Vec<f64> = ring.windows(2).map(|w| w[1] - w[0]).collect();
    assert!(gaps.iter().all(|g| (55.0..130.0).contains(g)), "{gaps:?}");
    assert_eq!(test[7].name, "test_07.png");
    assert_eq!(train[3].name, "train_03.png");
}

#[test]
fn builtin_images_show_every_object_with_contrast() {
    let deviation = |image: &Image| {
        let values = || image.rgb.iter().map(|&c| f64::from(c));
        let n = image.rgb.len() as f64;
        let mean = values().sum::<f64>() / n;
        (
            mean,
            (values().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt(),
        )
    };
    let scene = small(WIDTH, 0);
    for view in scene.train.iter().chain(&scene.test) {
        let (mean, deviation) = deviation(&view.image);
        let name = &view.camera.name;
        assert!((70.0..190.0).contains(&mean), "{name}: mean {mean}");
        assert!(deviation > 35.0, "{name}: deviation {deviation}");
        let clipped = share(view.image.rgb.iter().map(|&c| c == 255));
        assert!(clipped < 0.03, "{name}: {clipped} clipped");
    }
    let mut seen = [false; 19];
    for traced in train_cameras(240).iter().map(trace) {
        for hit in traced.hit {
            if let Hit::Object(id) = hit {
                seen[usize::from(id)] = true;
            }
        }
    }
    assert!(seen.iter().all(|&s| s), "{seen:?}");
}

#[test]
fn as_many_training_views_as_the_config_asks_for() {
    let views = |n_train: usize| {
        let mut config = Config::preset("3dgs").unwrap();
        config.scene.n_train = n_train;
        config.scene.n_test = 2;
        let scene = load_builtin(48, &LoadOptions::new(&config)).unwrap();
        let names = scene.train.iter().map(|v| v.camera.name.clone());
        (names.collect::<Vec<_>>(), scene.warnings.len())
    };
    let named = |numbers: &[usize]| {
        numbers
            .iter()
            .map(|i| format!("train_{i:02}.png"))
            .collect()
    };
    assert_eq!(views(1), (named(&[0]), 0));
    assert_eq!(views(2), (named(&[0, 3]), 0));
    assert_eq!(views(4), (named(&[0, 1, 2, 3]), 0));
    assert_eq!(views(9), (named(&[0, 1, 2, 3]), 1));
}
