//! The losses against values worked out by hand and central differences; Adam.

use gspotential::doctor::twin::adam::TwinAdam;
use gspotential::doctor::twin::loss::{TwinLoss, far_l1, loss, silhouette, window};
use gspotential::doctor::twin::random::Random;
use gspotential::doctor::twin::tolerance;

use super::assert_relative_l2;
use super::project::central_difference;

const W: usize = 13;
const H: usize = 11;

/// Two images nowhere closer than 1e-3, where L1 has its kink.
fn images(seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut random = Random::new(seed);
    (0..W * H * 3)
        .map(|i| {
            let y = 0.5 + 0.4 * (i as f64 * 0.07).sin();
            let sign = if random.uniform(0.0, 1.0) < 0.5 {
                -1.0
            } else {
                1.0
            };
            (y + sign * random.uniform(1e-3, 0.3), y)
        })
        .unzip()
}

/// Half of the pixels at random, a hole wider than the window, one pixel alone in it.
fn mask(seed: u64) -> Vec<f64> {
    let mut random = Random::new(seed);
    let mut mask: Vec<f64> = (0..W * H)
        .map(|_| random.uniform(0.0, 2.0).floor())
        .collect();
    for pixel in (0..W * H).filter(|p| p % W >= 5) {
        mask[pixel] = 0.0;
    }
    mask[5 * W + 12] = 1.0;
    mask
}

/// That mask with its other pixels at a weight below 1, or some of them.
fn filled_mask(seed: u64) -> Vec<f64> {
    let mut random = Random::new(seed + 1);
    let filled = |m: &f64| match random.uniform(0.0, 1.0) {
        u if *m == 0.0 && u < 0.8 => 0.3 * u,
        _ => *m,
    };
    mask(seed).iter().map(filled).collect()
}

fn check(mask: Option<&[f64]>, ssim_weight: f64, seed: u64) {
    let (x, y) = images(seed);
    let at = |x: &[f64]| loss(x, &y, mask, W, H, ssim_weight);
    let differences: Vec<f64> = (0..x.len())
        .map(|i| {
            central_difference(|h| {
                let mut moved = x.clone();
                moved[i] += h;
                at(&moved).loss
            })
        })
        .collect();
    let TwinLoss { d_render, .. } = at(&x);
    let what = format!("weight {ssim_weight}, masked {}", mask.is_some());
    assert_relative_l2(&what, &d_render, &differences, tolerance::FINITE_DIFFERENCE);
}

#[test]
fn loss_gradients_match_central_differences() {
    for ssim_weight in [0.2, 1.0] {
        check(None, ssim_weight, 1);
    }
}

#[test]
fn losses_of_marked_pixels_match_values_by_hand_and_central_differences() {
    // Off by 0.5, 0.25 and 0.125 in the channels of the second of two pixels.
    let (render, target) = (
        [0.9, 0.9, 0.9, 0.5, 0.75, 0.0],
        [0.1, 0.1, 0.1, 0.0, 0.5, 0.125],
    );
    let (l1, gradient) = far_l1(&render, &target, &[false, true]);
    assert_eq!(l1, (0.5 + 0.25 + 0.125) / 3.0);
    let third = 1.0 / 3.0;
    assert_eq!(gradient, [0.0, 0.0, 0.0, third, third, -third]);
    assert_eq!(far_l1(&render, &target, &[false; 2]), (0.0, vec![0.0; 6]));
    // -ln 1/2 and -ln 3/4, halved.
    let (entropy, _) = silhouette(&[0.5, 0.25], &[true, false]);
    assert!((entropy - 0.5 * (2f64.ln() + (4.0 / 3.0_f64).ln())).abs() < 1e-15);

    let (x, y) = images(4);
    let far: Vec<bool> = (0..W * H).map(|i| i % 3 == 0).collect();
    let differences: Vec<f64> = (0..x.len())
        .map(|i| {
            central_difference(|h| {
                let mut moved = x.clone();
                moved[i] += h;
                far_l1(&moved, &y, &far).0
            })
        })
        .collect();
    let (_, gradient) = far_l1(&x, &y, &far);
    assert_relative_l2(
        "far pixels",
        &gradient,
        &differences,
        tolerance::FINITE_DIFFERENCE,
    );
    let mut random = Random::new(5);
    let opacity: Vec<f64> = (0..40).map(|_| random.uniform(0.02, 0.98)).collect();
    let differences: Vec<f64> = (0..opacity.len())
        .map(|i| {
            central_difference(|h| {
                let mut moved = opacity.clone();
                moved[i] += h;
                silhouette(&moved, &far[..40]).0
            })
        })
        .collect();
    let (_, gradient) = silhouette(&opacity, &far[..40]);
    assert_relative_l2(
        "silhouette",
        &gradient,
        &differences,
        tolerance::FINITE_DIFFERENCE,
    );
}

#[test]
fn masked_loss_gradients_match_central_differences() {
    for ssim_weight in [0.2, 1.0] {
        check(Some(&mask(2)), ssim_weight, 1);
        check(Some(&filled_mask(2)), ssim_weight, 1);
    }
}

fn assert_near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12, "{a} against {b}");
}

#[test]
fn the_window_is_gaussian_with_sum_one() {
    let w = window();
    assert_eq!(w.len(), 121);
    assert_near(w.iter().sum(), 1.0);
    // Neighbours of the centre (60): one and two steps away, and the corner at 5^2 + 5^2.
    let falloff = |r2: f64| (-r2 / 4.5).exp();
    for (k, r2) in [
        (61, 1.0),
        (71, 1.0),
        (62, 4.0),
        (72, 2.0),
        (0, 50.0),
        (10, 50.0),
    ] {
        assert_near(w[k] / w[60], falloff(r2));
    }
}

#[test]
fn losses_have_the_values_worked_out_by_hand() {
    let (c1, c2) = (1e-4, 9e-4);
    // One pixel: its window is the centre's weight, everything else zero padding.
    let (a, b, g) = (0.8, 0.3, window()[60]);
    let luminance = (2.0 * g * g * a * b + c1) / (g * g * (a * a + b * b) + c1);
    let contrast = (2.0 * (g - g * g) * a * b + c2) / ((g - g * g) * (a * a + b * b) + c2);
    let one = loss(&[a; 3], &[b; 3], None, 1, 1, 0.2);
    assert_near(one.l1, 0.5);
    assert_near(one.ssim, luminance * contrast);
    assert_near(one.loss, 0.8 * 0.5 + 0.2 * (1.0 - luminance * contrast));
    // Constant images under a mask of any shape: no variance, no border.
    let flat = loss(&[a; W * H * 3], &[b; W * H * 3], Some(&mask(3)), W, H, 0.2);
    assert_near(flat.l1, 0.5);
    assert_near(flat.ssim, (2.0 * a * b + c1) / (a * a + b * b + c1));
    // Pixels of weight 1 and 0.25, off by 0.5 and 0.1: L1 is (0.5 + 0.25 * 0.1) / 1.25. Both
    // windows hold both pixels, at 1 and f, and 0.25 f and 0.25, f the fall-off of one step.
    let (x, y) = ([0.8, 0.8, 0.8, 0.4, 0.4, 0.4], [0.3; 6]);
    let two = loss(&x, &y, Some(&[1.0, 0.25]), 2, 1, 0.2);
    assert_near(two.l1, 0.42);
    let f = (-1.0f64 / 4.5).exp();
    let at = |[w, v]: [f64; 2]| {
        let [w, v] = [w / (w + v), v / (w + v)];
        let mean = 0.8 * w + 0.4 * v;
        let variance = 0.64 * w + 0.16 * v - mean * mean;
        let luminance = (2.0 * 0.3 * mean + c1) / (mean * mean + 0.09 + c1);
        luminance * c2 / (variance + c2)
    };
    assert_near(
        two.ssim,
        (at([1.0, 0.25 * f]) + 0.25 * at([f, 0.25])) / 1.25,
    );
    // One channel off by 0.3 at one of two pixels.
    let part = loss(&[0.0, 0.3, 0.0, 0.0, 0.0, 0.0], &[0.0; 6], None, 2, 1, 0.0);
    assert_near(part.l1, 0.05);
    assert_near(part.d_render[1], 1.0 / 6.0);
    assert_near(part.d_render[0], 0.0);
    let (x, _) = images(4);
    let same = loss(&x, &x, None, W, H, 0.2);
    assert_near(same.ssim, 1.0);
    assert_near(same.loss, 0.0);
}

#[test]
fn pixels_of_weight_zero_never_matter() {
    let (mut x, mut y) = images(5);
    let mask = filled_mask(6);
    let before = loss(&x, &y, Some(&mask), W, H, 0.2);
    for pixel in (0..W * H).filter(|&p| mask[p] == 0.0) {
        x[pixel * 3 + 1] = f64::NAN;
        y[pixel * 3 + 2] = 1e9;
        assert_eq!(before.d_render[pixel * 3..pixel * 3 + 3], [0.0; 3]);
    }
    let after = loss(&x, &y, Some(&mask), W, H, 0.2);
    assert_eq!(before.loss.to_bits(), after.loss.to_bits());
    assert_eq!(before.d_render, after.d_render);
}

#[test]
fn a_mask_of_nothing_gives_zero() {
    let (x, y) = images(7);
    let none = loss(&x, &y, Some(&[0.0; W * H]), W, H, 0.2);
    assert_eq!(none.loss, 0.0);
    assert!(none.d_render.iter().all(|&d| d == 0.0));
}

#[test]
fn adam_matches_the_sums_that_its_moments_stand_for() {
    let adam = TwinAdam {
        beta1: 0.9,
        beta2: 0.999,
        epsilon: 1e-3,
    };
    let gradients = [0.5, -0.25, 2.0, 0.0, 1e-3, -4.0];
    let (mut parameter, mut moments) = (0.7, [0.0; 2]);
    let mut expected: f64 = 0.7;
    for (t, &gradient) in gradients.iter().enumerate() {
        adam.step(&mut parameter, &mut moments, gradient, 0.01, t as i32 + 1);
        // A bias-corrected moment is the weighted mean of the past with weights beta^age.
        let mean = |beta: f64, power: i32| {
            let weights = (0..=t).map(|i| beta.powi((t - i) as i32));
            let sum: f64 = weights.clone().sum();
            let total: f64 = weights
                .zip(gradients)
                .map(|(w, g): (f64, f64)| w * g.powi(power))
                .sum();
            total / sum
        };
        expected -= 0.01 * mean(0.9, 1) / (mean(0.999, 2).sqrt() + 1e-3);
        assert_near(parameter, expected);
    }
    // The first step is lr g / (|g| + epsilon) whatever the betas.
    let (mut first, mut moments) = (0.0, [0.0; 2]);
    adam.step(&mut first, &mut moments, -0.5, 0.01, 1);
    assert_near(first, 0.01 * 0.5 / 0.501);
}
