//! The losses against values worked out by hand and central differences; Adam.

use gspotential::reference::adam::TwinAdam;
use gspotential::reference::cases::Random;
use gspotential::reference::loss::{TwinLoss, loss, window};
use gspotential::reference::tolerance;

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
fn mask(seed: u64) -> Vec<bool> {
    let mut random = Random::new(seed);
    let mut mask: Vec<bool> = (0..W * H).map(|_| random.uniform(0.0, 1.0) < 0.5).collect();
    for pixel in (0..W * H).filter(|p| p % W >= 5) {
        mask[pixel] = false;
    }
    mask[5 * W + 12] = true;
    mask
}

fn check(mask: Option<&[bool]>, ssim_weight: f64, seed: u64) {
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
fn masked_loss_gradients_match_central_differences() {
    for ssim_weight in [0.2, 1.0] {
        check(Some(&mask(2)), ssim_weight, 1);
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
fn invalid_pixels_never_matter() {
    let (mut x, mut y) = images(5);
    let mask = mask(6);
    let before = loss(&x, &y, Some(&mask), W, H, 0.2);
    for pixel in (0..W * H).filter(|&p| !mask[p]) {
        x[pixel * 3 + 1] = f64::NAN;
        y[pixel * 3 + 2] = 1e9;
        assert_eq!(before.d_render[pixel * 3..pixel * 3 + 3], [0.0; 3]);
    }
    let after = loss(&x, &y, Some(&mask), W, H, 0.2);
    assert_eq!(before.loss.to_bits(), after.loss.to_bits());
    assert_eq!(before.d_render, after.d_render);
}

#[test]
fn a_mask_with_no_valid_pixel_gives_zero() {
    let (x, y) = images(7);
    let none = loss(&x, &y, Some(&[false; W * H]), W, H, 0.2);
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
