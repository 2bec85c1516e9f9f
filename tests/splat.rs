//! Point splatting against brute force.

use glam::{DMat3, DVec3, dvec3};
use gspotential::camera::{Camera, Frame};
use gspotential::cloud::splat::{SplatImage, splat_depths, splat_views};
use gspotential::config::{ColorSource, Footprint, SplatConfig};
use gspotential::doctor::twin::splat::{filtered, nearest_points};
use gspotential::doctor::{SplatCase, examine_splat, twin_of};
use gspotential::scene::PointCloud;

use crate::geometry::{Random, camera, cloud};

const NEAR: f64 = 0.01;

fn config(footprint: Footprint, filter_window_px: u32, filter_min_neighbors: u32) -> SplatConfig {
    SplatConfig {
        footprint,
        max_radius_px: 4.0,
        depth_tolerance: 0.02,
        filter_window_px,
        filter_min_neighbors,
        colors: ColorSource::Points,
        outline: false,
    }
}

fn splat(cloud: &PointCloud, camera: &Camera, config: &SplatConfig) -> SplatImage {
    splat_views(
        cloud,
        &Frame::IDENTITY,
        (std::slice::from_ref(camera), &[source()]),
        config,
        NEAR,
    )
    .unwrap()
    .remove(0)
}

/// What discs take their radii from.
fn source() -> Camera {
    camera(dvec3(0.5, -2.5, 1.0), DVec3::ZERO)
}

/// A camera at the origin that looks along +z; `u = x / z + 8`, `v = y / z + 6`.
fn plain_camera() -> Camera {
    Camera {
        name: "plain".into(),
        width: 16,
        height: 12,
        fx: 1.0,
        fy: 1.0,
        cx: 8.0,
        cy: 6.0,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    }
}

/// The nearest point of every pixel by looking at all points for each pixel.
pub(crate) fn brute_force(cloud: &PointCloud, camera: &Camera, near: f64) -> Vec<Option<usize>> {
    let points: Vec<[f64; 3]> = cloud.positions.iter().map(DVec3::to_array).collect();
    nearest_points(&points, &twin_of(camera, near))
}

fn random_cloud(seed: u64, n: usize) -> PointCloud {
    let mut random = Random::new(seed);
    let mut positions: Vec<DVec3> = (0..n).map(|_| random.in_cube(1.0)).collect();
    // Some coincide: the lower index has to win.
    for _ in 0..n / 4 {
        let (from, to) = (random.index(n), random.index(n));
        positions[to] = positions[from];
    }
    cloud(positions)
}

fn expected(cloud: &PointCloud, nearest: &[Option<usize>]) -> Vec<u8> {
    nearest
        .iter()
        .flat_map(|nearest| match nearest {
            Some(i) => {
                let [r, g, b] = cloud.colors[*i];
                [r, g, b, 255]
            }
            None => [0; 4],
        })
        .collect()
}

const EYES: [DVec3; 3] = [
    dvec3(2.0, 1.0, 0.5),
    dvec3(0.1, 0.0, -0.2),
    dvec3(-0.9, 0.9, 0.9),
];

fn disc_case(eye: DVec3) -> SplatCase {
    SplatCase {
        cloud: random_cloud(1, 700),
        camera: camera(eye, dvec3(0.05, -0.1, 0.0)),
        source: source(),
        near: NEAR,
    }
}

#[test]
fn discs_equal_their_brute_force_twin() {
    for eye in EYES {
        for (max_radius_px, depth_tolerance, min_neighbors) in [
            (4.0, 0.02, 0),
            (0.708, 0.0, 2),
            (9.0, 0.3, 2),
            (64.0, 1.0, 0),
        ] {
            let config = SplatConfig {
                max_radius_px,
                depth_tolerance,
                ..config(Footprint::Disc, 5, min_neighbors)
            };
            let found = examine_splat(&disc_case(eye), &config).unwrap().list;
            assert!(
                found.iter().all(|f| f.holds()),
                "{eye} {config:?}: {found:?}"
            );
        }
    }
}

#[test]
fn the_comparison_of_discs_sees_one_moved_point_and_other_settings() {
    let case = disc_case(EYES[0]);
    let config = config(Footprint::Disc, 5, 0);
    let frame = Frame::IDENTITY;
    let views = (
        std::slice::from_ref(&case.camera),
        std::slice::from_ref(&case.source),
    );
    let image = |cloud: &PointCloud, config: &SplatConfig| {
        splat_views(cloud, &frame, views, config, NEAR)
            .unwrap()
            .remove(0)
    };
    let before = image(&case.cloud, &config);
    let nearest = brute_force(&case.cloud, &case.camera, NEAR);
    let mut moved = case.cloud.clone();
    moved.positions[nearest.iter().flatten().next().copied().unwrap()] += dvec3(0.0, 0.0, 0.1);
    assert!(image(&moved, &config) != before);
    for other in [
        SplatConfig {
            depth_tolerance: 0.2,
            ..config.clone()
        },
        SplatConfig {
            max_radius_px: 1.0,
            ..config.clone()
        },
    ] {
        assert!(image(&case.cloud, &other) != before, "{other:?}");
        // The twin follows them as well.
        assert!(
            examine_splat(&case, &other)
                .unwrap()
                .list
                .iter()
                .all(|f| f.holds())
        );
    }
}

#[test]
fn discs_hide_what_lies_behind_a_sparse_surface_and_single_pixels_do_not() {
    // A wall with a point every 2.5 pixels before a wall of another colour.
    let mut points = PointCloud::default();
    for (depth, color) in [(2.0, [255, 0, 0]), (3.0, [0, 255, 0])] {
        for row in -60..60 {
            for column in -80..80 {
                let step = 2.5 * 2.0 / 50.0;
                points.positions.push(dvec3(
                    f64::from(column) * step,
                    f64::from(row) * step,
                    depth,
                ));
                points.colors.push(color);
            }
        }
    }
    let view = Camera {
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
        ..source()
    };
    let sources = [Camera {
        fx: 50.0,
        fy: 50.0,
        width: 400,
        height: 300,
        ..view.clone()
    }];
    let shares = |footprint: Footprint| {
        let views = (std::slice::from_ref(&view), &sources[..]);
        let config = config(footprint, 5, 2);
        let image = splat_views(&points, &Frame::IDENTITY, views, &config, NEAR)
            .unwrap()
            .remove(0);
        let green = image.rgba.chunks_exact(4).filter(|p| p[1] > 0).count() as f64;
        let depths = splat_depths(&points, &Frame::IDENTITY, views, &config, NEAR).unwrap();
        // The image holds the same depths where it is covered.
        let own = |(depth, covered): (&f32, bool)| if covered { *depth } else { 0.0 };
        let expected: Vec<f32> = depths[0].iter().zip(image.mask()).map(own).collect();
        assert_eq!(image.depths, expected);
        let behind = depths[0]
            .iter()
            .filter(|d| d.is_finite() && **d > 2.5)
            .count() as f64;
        assert_eq!(green, behind);
        (image.coverage(), green / (64.0 * 48.0))
    };
    let (covered, hidden) = shares(Footprint::Pixel);
    assert!(covered < 0.6 && hidden > 0.1, "{covered} {hidden}");
    assert_eq!(shares(Footprint::Disc), (1.0, 0.0));
}

#[test]
fn discs_at_the_front_blend_by_their_distance_and_stop_at_the_tolerance() {
    // Pixel (8, 6), centre (8.5, 6.5): a black disc on it, a white one half its radius away.
    let color = |depth: f64, radius: f64| {
        let points = PointCloud {
            positions: vec![
                dvec3(0.5, 0.5, 1.0),
                dvec3(0.5 + 0.5 * radius, 0.5, 1.0) * depth,
            ],
            colors: vec![[0; 3], [200; 3]],
            confidence: None,
        };
        let settings = SplatConfig {
            max_radius_px: radius,
            ..config(Footprint::Disc, 1, 0)
        };
        // Without a source every disc is as large as allowed.
        let views = ([plain_camera()], []);
        let views = (&views.0[..], &views.1[..]);
        let image = splat_views(&points, &Frame::IDENTITY, views, &settings, NEAR).unwrap();
        image[0].rgba[(6 * 16 + 8) * 4]
    };
    // Weights 1 and (1 - 1/8)^2.
    let blended = (200.0 * 0.765625 / 1.765625_f64).round() as u8;
    assert_eq!(color(1.0, 2.0), blended);
    assert_eq!(color(1.019, 2.0), blended);
    assert_eq!(color(1.021, 2.0), 0, "hidden");
    assert_eq!(color(0.97, 2.0), 200, "in front");
}

#[test]
fn splat_equals_the_brute_force_z_buffer() {
    // More points than one block, cameras outside and within the cloud.
    let points = random_cloud(1, 700);
    for eye in EYES {
        let camera = camera(eye, dvec3(0.05, -0.1, 0.0));
        let image = splat(&points, &camera, &config(Footprint::Pixel, 5, 0));
        let nearest = brute_force(&points, &camera, NEAR);
        let expected = expected(&points, &nearest);
        assert!(nearest.iter().any(Option::is_some));
        assert!(image.rgba == expected, "from {eye}");
    }
}

#[test]
fn the_comparison_with_brute_force_sees_one_changed_point() {
    let mut points = random_cloud(1, 700);
    let camera = camera(dvec3(2.0, 1.0, 0.5), DVec3::ZERO);
    let nearest = brute_force(&points, &camera, NEAR);
    let seen = nearest.iter().flatten().next().copied().unwrap();
    let before = expected(&points, &nearest);
    points.positions[seen] += dvec3(0.0, 0.0, 0.1);
    assert!(splat(&points, &camera, &config(Footprint::Pixel, 5, 0)).rgba != before);
}

#[test]
fn equal_depths_go_to_the_lower_index_and_nearer_points_win() {
    let camera = plain_camera();
    let red_of = |depths: &[f64]| {
        let positions = depths.iter().map(|z| dvec3(0.0, 0.0, *z)).collect();
        splat(&cloud(positions), &camera, &config(Footprint::Pixel, 5, 0)).rgba[(6 * 16 + 8) * 4]
    };
    assert_eq!(red_of(&[2.0, 2.0, 2.0]), 0);
    assert_eq!(red_of(&[3.0, 2.0, 2.0, 4.0]), 1);
    // Depths that only f64 tells apart count as equal.
    assert_eq!(red_of(&[2.0 + 1e-12, 2.0]), 0);
    assert_eq!(red_of(&[2.0 + 1e-6, 2.0]), 1);
}

#[test]
fn a_point_falls_into_the_pixel_that_contains_it() {
    let camera = plain_camera();
    for (x, y, column, row) in [
        (0.0, 0.0, 8, 6),
        (-0.01, 0.0, 7, 6),
        (0.99, 0.5, 8, 6),
        (-8.0, -6.0, 0, 0),
        (7.99, 5.99, 15, 11),
    ] {
        let image = splat(
            &cloud(vec![dvec3(x, y, 1.0)]),
            &camera,
            &config(Footprint::Pixel, 5, 0),
        );
        let covered: Vec<usize> = image
            .mask()
            .enumerate()
            .filter(|m| m.1)
            .map(|m| m.0)
            .collect();
        assert_eq!(covered, [row * 16 + column], "{x} {y}");
    }
    for (x, y) in [(-8.01, 0.0), (8.0, 0.0), (0.0, -6.01), (0.0, 6.0)] {
        let image = splat(
            &cloud(vec![dvec3(x, y, 1.0)]),
            &camera,
            &config(Footprint::Pixel, 5, 0),
        );
        assert_eq!(image.coverage(), 0.0, "{x} {y}");
    }
}

#[test]
fn the_near_plane_scales_with_the_sphere_and_nothing_behind_it_is_drawn() {
    let frame = Frame {
        center: dvec3(7.0, 0.0, 0.0),
        radius: 100.0,
        extent: 100.0,
    };
    let camera = plain_camera();
    for (z, drawn) in [
        (1.01, true),
        (0.99, false),
        (0.0, false),
        (-5.0, false),
        (f64::INFINITY, false),
    ] {
        let image = &splat_views(
            &cloud(vec![dvec3(0.0, 0.0, z)]),
            &frame,
            (std::slice::from_ref(&camera), &[]),
            &config(Footprint::Pixel, 5, 0),
            NEAR,
        )
        .unwrap()[0];
        assert_eq!(image.coverage() > 0.0, drawn, "{z}");
    }
}

#[test]
fn the_image_does_not_depend_on_the_scenes_unit_or_origin() {
    let points = random_cloud(3, 400);
    let view = camera(dvec3(2.0, 1.0, 0.5), DVec3::ZERO);
    let reference = splat(&points, &view, &config(Footprint::Disc, 5, 2));
    for unit in [1e-6, 1e6] {
        for shift in [DVec3::ZERO, dvec3(1e5, -2e5, 3e5)] {
            let frame = Frame {
                center: shift * unit,
                radius: unit,
                extent: unit,
            };
            let mut moved = points.clone();
            moved
                .positions
                .iter_mut()
                .for_each(|p| *p = frame.to_world(*p));
            let eye = frame.to_world(view.center());
            let camera = Camera {
                translation: -(view.rotation * eye),
                ..view.clone()
            };
            let moved_source = frame.camera_to_world(&source());
            let image = splat_views(
                &moved,
                &frame,
                (&[camera], &[moved_source]),
                &config(Footprint::Disc, 5, 2),
                NEAR,
            )
            .unwrap();
            assert!(
                image[0].rgba == reference.rgba,
                "unit {unit}, shift {shift}"
            );
        }
    }
}

#[test]
fn the_filter_equals_its_brute_force_twin() {
    let points = random_cloud(2, 260);
    for (width, height) in [(64, 48), (1, 1), (7, 5), (3, 90), (90, 2)] {
        let view = camera(dvec3(1.6, 1.0, 0.5), DVec3::ZERO).resized(width, height);
        let unfiltered = splat(&points, &view, &config(Footprint::Pixel, 5, 0));
        let mask: Vec<bool> = unfiltered.mask().collect();
        for (window, min) in [
            (5, 1),
            (5, 2),
            (5, 4),
            (3, 1),
            (1, 0),
            (1, 1),
            (9, 6),
            (201, 30),
        ] {
            let image = splat(&points, &view, &config(Footprint::Pixel, window, min));
            let kept = filtered(&mask, width as usize, window as usize, min as usize);
            assert!(
                image.mask().eq(kept.iter().copied()),
                "{width}x{height} {window} {min}"
            );
            // Kept pixels keep their colour; removed ones lose it.
            for (i, keep) in kept.iter().enumerate() {
                let pixel = &image.rgba[i * 4..][..4];
                let before = &unfiltered.rgba[i * 4..][..4];
                assert_eq!(pixel, if *keep { before } else { &[0; 4] });
            }
        }
    }
}

#[test]
fn a_lone_pair_is_removed_and_a_trio_stays() {
    // Points two pixels apart see each other in a 5x5 window; a pair has one neighbour each.
    let at = |x: f64, y: f64| dvec3(x + 0.5, y + 0.5, 1.0);
    let positions = vec![
        at(-6.0, 0.0),
        at(-4.0, 0.0),
        at(2.0, 0.0),
        at(4.0, 0.0),
        at(3.0, 2.0),
    ];
    let image = splat(
        &cloud(positions),
        &plain_camera(),
        &config(Footprint::Pixel, 5, 2),
    );
    let covered: Vec<usize> = image
        .mask()
        .enumerate()
        .filter(|m| m.1)
        .map(|m| m.0)
        .collect();
    assert_eq!(covered, [6 * 16 + 10, 6 * 16 + 12, 8 * 16 + 11]);
}

#[test]
fn splats_do_not_depend_on_the_number_of_threads() {
    let points = random_cloud(4, 3000);
    let mut random = Random::new(9);
    let cameras: Vec<Camera> = (0..20)
        .map(|i| camera(random.in_cube(1.0) * 3.0, DVec3::ZERO).resized(40 + i, 60 - i))
        .collect();
    let run = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .build()
            .unwrap();
        pool.install(|| {
            splat_views(
                &points,
                &Frame::IDENTITY,
                (&cameras, &cameras),
                &config(Footprint::Disc, 5, 2),
                NEAR,
            )
        })
        .unwrap()
    };
    let one = run(1);
    assert!(one.iter().any(|image| image.coverage() > 0.1));
    assert!(one == run(3));
}

#[test]
fn settings_without_meaning_are_usage_errors() {
    for (bad, name) in [
        (
            SplatConfig {
                max_radius_px: 0.7,
                ..config(Footprint::Disc, 5, 2)
            },
            "splat.max_radius_px",
        ),
        (config(Footprint::Pixel, 4, 2), "splat.filter_window_px"),
        (config(Footprint::Pixel, 0, 2), "splat.filter_window_px"),
    ] {
        let cameras = [plain_camera()];
        let points = cloud(vec![DVec3::Z]);
        let error =
            splat_views(&points, &Frame::IDENTITY, (&cameras, &[]), &bad, NEAR).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains(name), "{error}");
    }
}

#[test]
fn an_empty_cloud_gives_empty_masks() {
    let image = splat(
        &PointCloud::default(),
        &plain_camera(),
        &config(Footprint::Disc, 5, 2),
    );
    assert_eq!(image.rgba, vec![0; 16 * 12 * 4]);
}
