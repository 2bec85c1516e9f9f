//! Depths and normals against central differences and by hand, and their losses likewise.

use gspotential::doctor::twin::cases::{self, TwinCase};
use gspotential::doctor::twin::compare::relative_l2;
use gspotential::doctor::twin::depth::{
    TwinDepth, TwinDepths, depth_weights, depths_backward, linear_loss, render_depths,
};
use gspotential::doctor::twin::depth_loss::{
    TwinDepthKind, TwinDepthLoss, TwinDepthOf, TwinTarget, depth_loss_gradient, depth_losses,
};
use gspotential::doctor::twin::model::{TwinCamera, TwinGaussians};
use gspotential::doctor::twin::pose::moved;
use gspotential::doctor::twin::random::Random;
use gspotential::doctor::twin::raster::{render, render_with_tolerance};
use gspotential::doctor::twin::tolerance;

use super::project::{CLASSES, central_difference, parameter};

fn depths(gaussians: &TwinGaussians, camera: &TwinCamera, tolerance: f64) -> TwinDepths {
    let image = render_with_tolerance(gaussians, camera, tolerance);
    render_depths(gaussians, camera, &image, tolerance)
}

/// Central differences of every parameter that depths depend on, and of the camera's motion.
fn check_case(name: &str, case: &TwinCase) {
    let mut n_weighted = [0; 3];
    for (index, camera) in case.cameras.iter().enumerate() {
        let camera = camera.resized(26, 17);
        let gaussians = &case.gaussians;
        let reference = depths(gaussians, &camera, tolerance::FRAGILE_STEP);
        let d = depth_weights(&reference, 100 + index as u64);
        for (p, d) in reference.pixels.iter().zip(&d) {
            let counts = [p.sum * d.sum, p.median * d.median, p.mode * d.mode];
            for (n, x) in n_weighted.iter_mut().zip(counts) {
                *n += usize::from(x != 0.0);
            }
        }
        let image = render(gaussians, &camera);
        let ours = depths_backward(gaussians, &camera, &image, &d);
        let loss = |gaussians: &TwinGaussians, camera: &TwinCamera| {
            linear_loss(&depths(gaussians, camera, tolerance::FRAGILE), &d)
        };
        for (class, range) in CLASSES {
            if class == "sh" {
                continue;
            }
            let difference = |(i, k): (usize, usize)| {
                central_difference(|h| {
                    let mut moved = gaussians.clone();
                    *parameter(&mut moved, i, k) += h;
                    loss(&moved, &camera)
                })
            };
            let places = (0..gaussians.n()).flat_map(|i| range.clone().map(move |k| (i, k)));
            let differences: Vec<f64> = places.map(difference).collect();
            let values: Vec<f64> = ours
                .raw
                .iter()
                .flat_map(|raw| match class {
                    "mean" => raw.mean.to_vec(),
                    "opacity_logit" => vec![raw.opacity_logit],
                    "scale_log" => raw.scale_log.to_vec(),
                    _ => raw.rotation_wxyz.to_vec(),
                })
                .collect();
            let off = relative_l2(&values, &differences);
            let bound = tolerance::FINITE_DIFFERENCE;
            assert!(off <= bound, "{name}, camera {index}, {class}: {off:e}");
            let most = values.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            let slip: Vec<f64> = values
                .iter()
                .map(|x| if x.abs() == most { -x } else { *x })
                .collect();
            assert!(most == 0.0 || relative_l2(&slip, &differences) > bound);
        }
        let differences: [f64; 6] = std::array::from_fn(|k| {
            central_difference(|h| {
                let motion = std::array::from_fn(|i| if i == k { h } else { 0.0 });
                loss(gaussians, &moved(&camera, &motion))
            })
        });
        let pose = ours.raw.iter().fold([0.0; 6], |sum, raw| -> [f64; 6] {
            std::array::from_fn(|k| sum[k] + raw.pose[k])
        });
        let off = relative_l2(&pose, &differences);
        assert!(
            off <= tolerance::FINITE_DIFFERENCE,
            "{name}, camera {index}, pose: {off:e}"
        );
    }
    assert!(
        n_weighted.iter().all(|n| *n > 100),
        "{name}: {n_weighted:?} pixels weigh"
    );
}

#[test]
fn gradients_of_depths_and_normals_match_central_differences() {
    check_case("ordinary", &cases::random_scene(14, 0, 41));
    check_case("huge", &cases::huge(8, 60));
}

/// Discs on the axis of a camera at the origin; depth, opacity and the angle about y of each.
fn discs(entries: &[(f64, f64, f64)]) -> (TwinGaussians, TwinCamera) {
    let gaussians = TwinGaussians {
        means: entries.iter().map(|e| [0.0, 0.0, e.0]).collect(),
        sh: vec![[[0.0; 3]; 16]; entries.len()],
        opacity_logit: entries.iter().map(|e| (e.1 / (1.0 - e.1)).ln()).collect(),
        // Flat along z.
        scale_log: vec![[0.3f64.ln(), 0.2f64.ln(), 0.01f64.ln()]; entries.len()],
        rotation_wxyz: entries
            .iter()
            .map(|e| [(0.5 * e.2).cos(), 0.0, (0.5 * e.2).sin(), 0.0])
            .collect(),
        sh_degree: 0,
    };
    let camera = TwinCamera {
        cx: 0.5,
        cy: 0.5,
        width: 1,
        height: 1,
        ..cases::looking_at([0.0; 3], [0.0, 0.0, 1.0])
    };
    (gaussians, camera)
}

#[test]
fn depths_and_normals_are_those_worked_out_by_hand() {
    let tilt: f64 = 0.3;
    let (gaussians, camera) = discs(&[(3.0, 0.9, tilt), (2.0, 0.3, 0.0), (2.5, 0.4, 0.0)]);
    let found = depths(&gaussians, &camera, tolerance::FRAGILE);
    let pixel = found.pixels[0];
    // Weights front to back: .3, .7 .4, .7 .6 .9; the half is passed by the second.
    let weights = [0.3, 0.7 * 0.4, 0.7 * 0.6 * 0.9];
    let sum: f64 = weights
        .iter()
        .zip([2.0, 2.5, 3.0])
        .map(|(w, z)| w * z)
        .sum();
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} against {b}");
    near(pixel.sum, sum);
    near(pixel.alpha, weights.iter().sum());
    near(pixel.median, 2.5);
    near(pixel.mode, 3.0);
    // The axis that looks to the camera, -z, turned about y for the last.
    near(pixel.normal[0], -weights[2] * tilt.sin());
    near(pixel.normal[1], 0.0);
    near(
        pixel.normal[2],
        -weights[0] - weights[1] - weights[2] * tilt.cos(),
    );
    assert!(!found.fragile[0]);
    // Nothing takes half of the light.
    let (gaussians, camera) = discs(&[(2.0, 0.3, 0.0)]);
    let pixel = depths(&gaussians, &camera, tolerance::FRAGILE).pixels[0];
    near(pixel.median, 0.0);
    near(pixel.mode, 2.0);
    // Another may be the median or the mode.
    let (gaussians, camera) = discs(&[(2.0, 0.5001, 0.0)]);
    assert!(depths(&gaussians, &camera, tolerance::FRAGILE).fragile[0]);
    let (gaussians, camera) = discs(&[(2.0, 0.4, 0.0), (3.0, 0.4 / 0.6, 0.0)]);
    assert!(depths(&gaussians, &camera, tolerance::FRAGILE).fragile[0]);
}

const W: usize = 13;
const H: usize = 9;

/// Rendered depths and normals about targets, a hole in either, no error close to a kink.
fn pixels(seed: u64, loss: &TwinDepthLoss) -> (Vec<TwinDepth>, Vec<TwinTarget>) {
    let mut random = Random::new(seed);
    let pixel = |i: usize| {
        let alpha = if i % 7 == 3 {
            0.4
        } else {
            random.uniform(0.55, 1.0)
        };
        let depth = 2.0 + (0.3 * i as f64).sin() + random.uniform(-0.3, 0.3);
        let x = if loss.inverse { 1.0 / depth } else { depth };
        let unit = |random: &mut Random| [(); 3].map(|()| random.uniform(-1.0, 1.0));
        let error = random.uniform(0.05, 0.2) * if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let pixel = TwinDepth {
            sum: alpha * depth,
            normal: unit(&mut random),
            median: depth,
            mode: depth,
            alpha,
        };
        let target = TwinTarget {
            depth: x * (1.0 + error),
            weight: if i % 11 == 5 {
                0.0
            } else {
                random.uniform(0.1, 1.0)
            },
            normal: unit(&mut random),
        };
        (pixel, target)
    };
    (0..W * H).map(pixel).unzip()
}

fn parts(d: &TwinDepth) -> [f64; 7] {
    let [x, y, z] = d.normal;
    [d.sum, x, y, z, d.median, d.mode, d.alpha]
}

fn part(d: &mut TwinDepth, k: usize) -> &mut f64 {
    match k {
        0 => &mut d.sum,
        1..4 => &mut d.normal[k - 1],
        4 => &mut d.median,
        5 => &mut d.mode,
        _ => &mut d.alpha,
    }
}

const LOSS: TwinDepthLoss = TwinDepthLoss {
    kind: TwinDepthKind::Pearson,
    of: TwinDepthOf::Expected,
    inverse: false,
    weight: 0.7,
    patch_weight: 0.4,
    normal_weight: 0.3,
    patch: 5,
};

#[test]
fn gradients_of_depth_losses_match_central_differences() {
    use {TwinDepthKind::*, TwinDepthOf::*};
    for kind in [Pearson, ScaleShift, L1] {
        for (of, inverse) in [
            (Expected, false),
            (Expected, true),
            (Median, true),
            (Mode, false),
        ] {
            let loss = TwinDepthLoss {
                kind,
                of,
                inverse,
                ..LOSS
            };
            let (pixels, target) = pixels(3, &loss);
            let total = |pixels: &[TwinDepth]| {
                let [image, patches, normals, _] = depth_losses(pixels, &target, &loss, W);
                loss.weight * image + loss.patch_weight * patches + loss.normal_weight * normals
            };
            let difference = |i: usize, k: usize| {
                central_difference(|h| {
                    let mut moved = pixels.clone();
                    *part(&mut moved[i], k) += h;
                    total(&moved)
                })
            };
            let places = (0..W * H).flat_map(|i| (0..7).map(move |k| (i, k)));
            let differences: Vec<f64> = places.map(|(i, k)| difference(i, k)).collect();
            let ours = depth_loss_gradient(&pixels, &target, &loss, W);
            let ours: Vec<f64> = ours.iter().flat_map(parts).collect();
            let off = relative_l2(&ours, &differences);
            let bound = tolerance::FINITE_DIFFERENCE;
            assert!(
                off <= bound,
                "{kind:?} of {of:?}, inverse {inverse}: {off:e}"
            );
            let slip: Vec<f64> = ours.iter().map(|x| 1.001 * x).collect();
            assert!(relative_l2(&slip, &differences) > bound);
        }
    }
}

#[test]
fn depth_losses_are_0_for_what_they_do_not_see_and_1_for_noise() {
    let (mut pixels, mut target) = pixels(5, &LOSS);
    for (p, t) in pixels.iter_mut().zip(&mut target) {
        let depth = p.sum / p.alpha;
        // Another scale and shift.
        t.depth = 3.0 * depth - 1.0;
        p.normal = [0.0, 0.6, -0.8];
        t.normal = p.normal.map(|n| 0.5 * n);
    }
    let at = |loss: &TwinDepthLoss, target: &[TwinTarget]| depth_losses(&pixels, target, loss, W);
    let fitted = TwinDepthLoss {
        kind: TwinDepthKind::ScaleShift,
        ..LOSS
    };
    let l1 = TwinDepthLoss {
        kind: TwinDepthKind::L1,
        ..LOSS
    };
    for loss in [LOSS, fitted] {
        let [image, patches, normals, share] = at(&loss, &target);
        assert!(image.abs() < 1e-12 && patches.abs() < 1e-12 && normals.abs() < 1e-12);
        assert!((0.3..0.6).contains(&share), "{share}");
    }
    assert!(at(&l1, &target)[0] > 1.0);
    let turned: Vec<TwinTarget> = target
        .iter()
        .map(|t| TwinTarget {
            depth: -t.depth,
            normal: t.normal.map(|n| -n),
            ..*t
        })
        .collect();
    let [image, patches, normals, _] = at(&LOSS, &turned);
    for loss in [image, patches, normals] {
        assert!((loss - 2.0).abs() < 1e-12, "{loss}");
    }
    // What does not vary correlates with nothing.
    let flat: Vec<TwinTarget> = target
        .iter()
        .map(|t| TwinTarget { depth: 2.0, ..*t })
        .collect();
    assert_eq!(at(&LOSS, &flat)[..2], [0.0, 0.0]);
}
