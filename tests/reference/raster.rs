//! Compositing end to end against central differences and against scenes worked out by hand;
//! tile lists.

use gspotential::doctor::twin::bin::{TileGrid, tile_lists, tiles_of};
use gspotential::doctor::twin::cases::{self, TwinCase};
use gspotential::doctor::twin::compare::relative_l2;
use gspotential::doctor::twin::model::{TwinCamera, TwinGaussians, TwinSplat};
use gspotential::doctor::twin::raster::{ALPHA_MIN, backward, render, render_with_tolerance};
use gspotential::doctor::twin::tolerance;

use super::project::{CLASSES, N_RAW, central_difference, parameter};

/// Central differences of every raw parameter against the backward pass, per class, in images
/// small enough for it.
fn check_case(name: &str, case: &TwinCase) {
    let mut n_weighted = 0;
    for (index, camera) in case.cameras.iter().enumerate() {
        let camera = camera.resized(26, 17);
        let reference = render_with_tolerance(&case.gaussians, &camera, tolerance::FRAGILE_STEP);
        let (d_rgb, d_alpha) = cases::loss_weights(&reference, 100 + index as u64);
        n_weighted += d_alpha
            .iter()
            .zip(&reference.count)
            .filter(|&(&d, &count)| d != 0.0 && count > 0)
            .count();
        let loss = |gaussians: &TwinGaussians| {
            let image = render(gaussians, &camera);
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            dot(&image.rgb, &d_rgb) + dot(&image.alpha, &d_alpha)
        };
        let gradients = backward(&case.gaussians, &camera, &reference, &d_rgb, &d_alpha);
        let n = case.gaussians.n();
        for ((class, values), (_, range)) in gradients.classes().into_iter().zip(CLASSES) {
            let differences: Vec<f64> = (0..n)
                .flat_map(|i| range.clone().map(move |k| (i, k)))
                .map(|(i, k)| {
                    central_difference(|h| {
                        let mut moved = case.gaussians.clone();
                        *parameter(&mut moved, i, k) += h;
                        loss(&moved)
                    })
                })
                .collect();
            let off = relative_l2(&values, &differences);
            assert!(
                off <= tolerance::FINITE_DIFFERENCE,
                "{name}, camera {index}, {class}: relative L2 {off:e}"
            );
        }
    }
    assert!(n_weighted > 300, "{name}: only {n_weighted} pixels weigh");
    assert_eq!(
        N_RAW,
        CLASSES.iter().map(|(_, range)| range.len()).sum::<usize>()
    );
}

#[test]
fn gradients_match_central_differences_at_every_sh_degree() {
    for sh_degree in 0..4 {
        let case = cases::random_scene(10, sh_degree, 40 + sh_degree as u64);
        check_case(&format!("degree {sh_degree}"), &case);
    }
}

#[test]
fn gradients_of_needles_match_central_differences() {
    check_case("needles", &cases::needles(12, 50));
}

#[test]
fn gradients_of_huge_off_screen_gaussians_match_central_differences() {
    check_case("huge", &cases::huge(8, 60));
}

#[test]
fn renders_do_not_depend_on_the_number_of_threads() {
    let case = cases::random_scene(200, 3, 70);
    let camera = &case.cameras[1];
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a pool").install(|| {
            let image = render(&case.gaussians, camera);
            let (d_rgb, d_alpha) = cases::loss_weights(&image, 1);
            let gradients = backward(&case.gaussians, camera, &image, &d_rgb, &d_alpha);
            (image.rgb, gradients.splats)
        })
    };
    assert_eq!(run(1), run(3));
}

/// Spheres on the axis of a camera at the origin; `(z, opacity, grey)` each.
fn stack(entries: &[(f64, f64, f64)]) -> (TwinGaussians, TwinCamera) {
    let y0 = 0.28209479177387814;
    let gaussians = TwinGaussians {
        means: entries.iter().map(|e| [0.0, 0.0, e.0]).collect(),
        sh: entries
            .iter()
            .map(|e| {
                let mut sh = [[0.0; 3]; 16];
                sh[0] = [(e.2 - 0.5) / y0; 3];
                sh
            })
            .collect(),
        opacity_logit: entries.iter().map(|e| (e.1 / (1.0 - e.1)).ln()).collect(),
        scale_log: vec![[0.2f64.ln(); 3]; entries.len()],
        rotation_wxyz: vec![[1.0, 0.0, 0.0, 0.0]; entries.len()],
        sh_degree: 0,
    };
    // One pixel, its centre on the axis.
    let camera = TwinCamera {
        cx: 0.5,
        cy: 0.5,
        width: 1,
        height: 1,
        ..cases::looking_at([0.0; 3], [0.0, 0.0, 1.0])
    };
    (gaussians, camera)
}

fn grey(entries: &[(f64, f64, f64)], background: f64) -> (f64, f64, u32, bool) {
    let (gaussians, camera) = stack(entries);
    let camera = TwinCamera {
        background: [background; 3],
        ..camera
    };
    let image = render(&gaussians, &camera);
    (
        image.rgb[1],
        image.alpha[0],
        image.count[0],
        image.fragile[0],
    )
}

fn assert_near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12, "{a} against {b}");
}

#[test]
fn compositing_runs_front_to_back_over_the_background() {
    let (value, alpha, count, fragile) = grey(&[(3.0, 0.5, 0.8), (2.0, 0.25, 0.4)], 0.6);
    assert_near(value, 0.25 * 0.4 + 0.75 * 0.5 * 0.8 + 0.75 * 0.5 * 0.6);
    assert_near(alpha, 1.0 - 0.75 * 0.5);
    assert_eq!((count, fragile), (2, false));
}

#[test]
fn equal_depths_are_blended_by_index() {
    let (value, ..) = grey(&[(2.0, 0.9, 1.0), (2.0, 0.9, 0.0)], 0.0);
    assert_near(value, 0.9);
    let (value, ..) = grey(&[(2.0, 0.9, 0.0), (2.0, 0.9, 1.0)], 0.0);
    assert_near(value, 0.09);
}

#[test]
fn alpha_below_one_in_255_is_skipped_and_its_pixel_is_fragile_only_nearby() {
    assert_eq!(
        grey(&[(2.0, 0.99 * ALPHA_MIN, 1.0)], 0.0),
        (0.0, 0.0, 0, false)
    );
    let (_, alpha, count, fragile) = grey(&[(2.0, 1.01 * ALPHA_MIN, 1.0)], 0.0);
    assert_near(alpha, 1.01 * ALPHA_MIN);
    assert_eq!((count, fragile), (1, false));
    assert!(grey(&[(2.0, (1.0 - 1e-3) * ALPHA_MIN, 1.0)], 0.0).3);
    assert!(grey(&[(2.0, (1.0 + 1e-3) * ALPHA_MIN, 1.0)], 0.0).3);
}

#[test]
fn alpha_is_capped_and_the_cap_stops_the_gradient() {
    let entries = [(2.0, 0.9999, 0.7)];
    let (_, alpha, _, fragile) = grey(&entries, 0.0);
    assert_near(alpha, 0.999);
    assert!(!fragile);
    let (gaussians, camera) = stack(&entries);
    let image = render(&gaussians, &camera);
    let gradients = backward(&gaussians, &camera, &image, &[1.0; 3], &[1.0]);
    assert_eq!(gradients.opacity_logit, [0.0]);
    assert_near(gradients.splats[0][5], 0.999);
}

#[test]
fn the_gaussian_that_would_exhaust_transmittance_is_not_blended() {
    // T: 0.1, 0.01, then 5e-5 would follow; what lies behind does not show either.
    let open = [(1.0, 0.9, 0.0), (1.5, 0.9, 0.0)];
    let (value, alpha, count, fragile) = grey(
        &[&open[..], &[(2.0, 0.995, 1.0), (3.0, 0.5, 1.0)]].concat(),
        0.0,
    );
    assert_near(value, 0.0);
    assert_near(alpha, 0.99);
    assert_eq!((count, fragile), (2, false));
    // T = 1.00005e-4 stays above the stop, by less than single precision can be trusted with.
    let (value, _, count, fragile) = grey(&[&open[..], &[(2.0, 0.9899995, 1.0)]].concat(), 0.0);
    assert_near(value, 0.01 * 0.9899995);
    assert_eq!((count, fragile), (3, true));
}

#[test]
fn neighbours_too_close_in_depth_make_a_pixel_fragile() {
    assert!(grey(&[(2.0, 0.5, 1.0), (2.0 + 2e-7, 0.5, 0.0)], 0.0).3);
    assert!(!grey(&[(2.0, 0.5, 1.0), (2.0 + 1e-5, 0.5, 0.0)], 0.0).3);
}

#[test]
fn the_layers_case_has_equal_depths_in_index_order_and_reaches_the_stop() {
    let case = cases::layers(8, 60, 80);
    let image = render(&case.gaussians, &case.cameras[0]);
    let depths = |i: usize| image.projected[i].depth;
    assert!((0..60).all(|k| depths(8 * k + 3) == 1.375));
    assert!(image.alpha.iter().any(|&a| a > 0.9985), "no pixel stops");
    // The same planes with the index order turned round are another picture.
    let mut turned = case.gaussians.clone();
    let order: Vec<usize> = (0..60)
        .rev()
        .flat_map(|k| (0..8).map(move |l| 8 * k + l))
        .collect();
    turned.means = order.iter().map(|&i| case.gaussians.means[i]).collect();
    turned.sh = order.iter().map(|&i| case.gaussians.sh[i]).collect();
    turned.opacity_logit = order
        .iter()
        .map(|&i| case.gaussians.opacity_logit[i])
        .collect();
    turned.scale_log = order.iter().map(|&i| case.gaussians.scale_log[i]).collect();
    turned.rotation_wxyz = order
        .iter()
        .map(|&i| case.gaussians.rotation_wxyz[i])
        .collect();
    let other = render(&turned, &case.cameras[0]);
    assert!(relative_l2(&other.rgb, &image.rgb) > 1e-2);
}

#[test]
fn cases_reach_what_they_are_for() {
    let scene = cases::random_scene(300, 3, 90);
    let again = cases::random_scene(300, 3, 90);
    assert_eq!(scene.gaussians.means, again.gaussians.means);
    assert_ne!(
        scene.gaussians.means,
        cases::random_scene(300, 3, 91).gaussians.means
    );
    for camera in &scene.cameras {
        let image = render(&scene.gaussians, camera);
        let share = |n: usize| n as f64 / image.alpha.len() as f64;
        let fragile = share(image.fragile.iter().filter(|&&f| f).count());
        assert!(fragile < 0.05, "{fragile} of the pixels are fragile");
        let covered = share(image.alpha.iter().filter(|&&a| a > 0.3).count());
        assert!(covered > 0.15, "only {covered} of the pixels are covered");
        let n_valid = image.projected.iter().filter(|s| s.valid).count();
        assert!(n_valid > 50, "only {n_valid} lie in front");
    }
    let inside = render(&scene.gaussians, &scene.cameras[1]);
    assert!(inside.projected.iter().any(|s| !s.valid));
    // An ellipse far larger than the image whose centre lies off it.
    let huge = cases::huge(40, 92);
    let image = render(&huge.gaussians, &huge.cameras[0]);
    assert!(image.projected.iter().any(|s| {
        s.valid && (s.mean2d[0] < -160.0 || s.mean2d[0] > 320.0) && s.cov2d[0] > 160.0 * 160.0
    }));
    assert!(image.count.iter().any(|&n| n > 3));
}

#[test]
fn tiles_of_a_splat_are_those_with_a_pixel_centre_inside() {
    let grid = TileGrid {
        width: 20,
        height: 12,
        tile_width: 8,
        tile_height: 4,
    };
    let splat = |x: f64, y: f64, radius: f64| {
        // Opacity such that alpha reaches 1/255 at one and a half standard deviations.
        let sd = radius / 1.5;
        TwinSplat {
            valid: true,
            mean2d: [x, y],
            cov2d: [sd * sd, 0.0, sd * sd],
            opacity: ALPHA_MIN * (0.5f64 * 1.5 * 1.5).exp(),
            ..TwinSplat::default()
        }
    };
    assert_eq!((grid.columns(), grid.n_tiles()), (3, 9));
    let tiles = |s: TwinSplat| tiles_of(&s, &grid, ALPHA_MIN);
    // Reaches over the tile's edge at x = 8, but not to the pixel centre at 8.5.
    assert_eq!(tiles(splat(7.5, 1.5, 0.9)), [0]);
    assert_eq!(tiles(splat(7.5, 1.5, 1.1)), [0, 1]);
    assert_eq!(tiles(splat(7.5, 3.5, 1.1)), [0, 1, 3]);
    assert_eq!(tiles(splat(7.5, 3.5, 1.5)), [0, 1, 3, 4]);
    // The last column is cut by the image; off it nothing counts.
    assert_eq!(tiles(splat(25.0, 6.0, 3.0)), [] as [usize; 0]);
    assert_eq!(tiles(splat(21.0, 6.0, 2.0)), [5]);
    let hidden = TwinSplat {
        valid: false,
        ..splat(7.5, 1.5, 0.9)
    };
    assert_eq!(tiles(hidden), [] as [usize; 0]);
    // A diagonal ellipse leaves out tiles that its bounding box meets (2, 5, 6, 8).
    let mut diagonal = splat(8.0, 4.0, 9.0);
    diagonal.cov2d[1] = 0.98 * diagonal.cov2d[0];
    assert_eq!(tiles(diagonal), [0, 1, 3, 4, 7]);
}

#[test]
fn tile_lists_name_exactly_the_splats_that_are_blended() {
    let case = cases::random_scene(60, 0, 95);
    let camera = case.cameras[0].resized(52, 33);
    // Thin, so that nothing stops before the end of a list.
    let mut gaussians = case.gaussians.clone();
    gaussians.opacity_logit.fill(-3.0);
    let image = render(&gaussians, &camera);
    let grid = TileGrid {
        width: 52,
        height: 33,
        tile_width: 8,
        tile_height: 8,
    };
    let lists = tile_lists(&image.projected, &grid, ALPHA_MIN);
    let mut d_rgb = vec![0.0; image.rgb.len()];
    for (tile, list) in lists.iter().enumerate() {
        assert!(list.windows(2).all(|pair| {
            let depth = |i: usize| image.projected[i].depth;
            (depth(pair[0]), pair[0]) < (depth(pair[1]), pair[1])
        }));
        // Who has a colour gradient from a tile's pixels is who is blended there.
        for (pixel, d) in d_rgb.chunks_mut(3).enumerate() {
            let own = pixel / 52 / 8 * grid.columns() + pixel % 52 / 8 == tile;
            d.fill(f64::from(u8::from(own)));
        }
        let zero = vec![0.0; image.alpha.len()];
        let gradients = backward(&gaussians, &camera, &image, &d_rgb, &zero);
        let mut sorted = list.clone();
        sorted.sort_unstable();
        let blended: Vec<usize> = (0..60).filter(|&i| gradients.splats[i][5] > 0.0).collect();
        assert_eq!(sorted, blended, "tile {tile}");
    }
    assert!(lists.iter().map(Vec::len).sum::<usize>() > 200);
}
