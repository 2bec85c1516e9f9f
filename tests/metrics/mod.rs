//! PSNR and SSIM against a brute-force implementation and values worked out by hand.

mod errors;
mod lpips;
pub(crate) mod lpips_reference;

use gspotential::metrics::{FloatImage, masked_psnr, masked_ssim, psnr, quantize, ssim};
use gspotential::scene::Image;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Two implementations in f64 that sum in different orders.
const TOLERANCE: f64 = 1e-12;

fn noise(width: u32, height: u32, seed: u64) -> Image {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    Image {
        width,
        height,
        rgb: (0..width * height * 3).map(|_| rng.random()).collect(),
    }
}

/// A smoother pair: a gradient, and the same with some noise.
fn pair(width: u32, height: u32) -> (Image, Image) {
    let truth = Image {
        width,
        height,
        rgb: (0..width * height * 3)
            .map(|i| ((i % (width * 3)) * 200 / (width * 3) + i % 3 * 20) as u8)
            .collect(),
    };
    let mut render = truth.clone();
    for (value, jitter) in render.rgb.iter_mut().zip(noise(width, height, 5).rgb) {
        *value = value.saturating_add(jitter / 8);
    }
    (render, truth)
}

/// SSIM of each pixel from its definition, mean over the channels: all 121 neighbours, zeros
/// outside. `x` and `y` give value `i` of `[height][width][3]` in `[0, 1]`.
fn direct_ssim_map(
    (width, height): (u32, u32),
    x: &dyn Fn(usize) -> f64,
    y: &dyn Fn(usize) -> f64,
) -> Vec<f64> {
    let (w, h) = (i64::from(width), i64::from(height));
    let at = |image: &dyn Fn(usize) -> f64, i: i64, j: i64, c: i64| {
        if i < 0 || j < 0 || i >= h || j >= w {
            0.0
        } else {
            image(((i * w + j) * 3 + c) as usize)
        }
    };
    let weight = |di: i64, dj: i64| (-((di * di + dj * dj) as f64) / 4.5).exp();
    let offsets: Vec<(i64, i64)> = (-5..=5)
        .flat_map(|di| (-5..=5).map(move |dj| (di, dj)))
        .collect();
    let norm: f64 = offsets.iter().map(|&(di, dj)| weight(di, dj)).sum();
    let mut map = Vec::new();
    for i in 0..h {
        for j in 0..w {
            let mut total = 0.0;
            for c in 0..3 {
                let mean = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
                    offsets
                        .iter()
                        .map(|&(di, dj)| {
                            let (a, b) = (at(x, i + di, j + dj, c), at(y, i + di, j + dj, c));
                            weight(di, dj) * f(a, b)
                        })
                        .sum::<f64>()
                        / norm
                };
                let (mx, my) = (mean(&|a, _| a), mean(&|_, b| b));
                let var_x = mean(&|a, _| a * a) - mx.powi(2);
                let var_y = mean(&|_, b| b * b) - my.powi(2);
                let cov = mean(&|a, b| a * b) - mx * my;
                let luminance = (2.0 * mx * my + 1e-4) / (mx.powi(2) + my.powi(2) + 1e-4);
                total += luminance * (2.0 * cov + 9e-4) / (var_x + var_y + 9e-4);
            }
            map.push(total / 3.0);
        }
    }
    map
}

fn direct_ssim(x: &Image, y: &Image) -> f64 {
    let value = |image: &Image, i: usize| f64::from(image.rgb[i]) / 255.0;
    let size = (x.width, x.height);
    let map = direct_ssim_map(size, &|i| value(x, i), &|i| value(y, i));
    map.iter().sum::<f64>() / map.len() as f64
}

#[test]
fn ssim_agrees_with_the_direct_window() {
    let cases = [
        pair(31, 17),
        (noise(23, 14, 1), noise(23, 14, 2)),
        // Smaller than the window.
        pair(4, 7),
        pair(1, 1),
        pair(64, 1),
    ];
    for (render, truth) in &cases {
        let (ours, direct) = (ssim(render, truth).unwrap(), direct_ssim(render, truth));
        assert!((ours - direct).abs() < TOLERANCE, "{ours} and {direct}");
    }
}

#[test]
fn comparison_with_the_direct_window_notices_one_altered_pixel() {
    let (mut render, truth) = pair(31, 17);
    let direct = direct_ssim(&render, &truth);
    for index in [0, 31 * 17 * 3 - 1, 31 * 8 * 3 + 40] {
        let before = render.rgb[index];
        render.rgb[index] ^= 1;
        let altered = ssim(&render, &truth).unwrap();
        assert!((altered - direct).abs() > 100.0 * TOLERANCE, "at {index}");
        render.rgb[index] = before;
    }
}

#[test]
fn ssim_of_a_single_pixel_is_as_worked_out_by_hand() {
    // One white pixel against a black one: the window's middle weight is
    // w = (1 / sum exp(-x^2 / 4.5))^2 = 0.2660117^2 = 0.0707622, so mu = w and the variance is
    // w - w^2; SSIM = C1 C2 / ((w^2 + C1) (w - w^2 + C2)).
    let pixel = |v| Image {
        width: 1,
        height: 1,
        rgb: vec![v; 3],
    };
    let w = 0.070_762_237;
    let expected = 1e-4 * 9e-4 / ((w * w + 1e-4) * (w - w * w + 9e-4));
    let ours = ssim(&pixel(255), &pixel(0)).unwrap();
    assert!((ours / expected - 1.0).abs() < 1e-6, "{ours}, {expected}");
}

#[test]
fn psnr_is_as_worked_out_by_hand() {
    let black = Image {
        width: 2,
        height: 2,
        rgb: vec![0; 12],
    };
    // One of 12 values off by the full range: mse = 1/12, 10 log10(12) dB.
    let mut one_off = black.clone();
    one_off.rgb[4] = 255;
    assert!((psnr(&one_off, &black).unwrap() - 10.791_812_460_476_248).abs() < 1e-12);
    // All off by one level: 20 log10(255) dB.
    let mut dim = black.clone();
    dim.rgb.fill(1);
    assert!((psnr(&dim, &black).unwrap() - 48.130_803_608_679_34).abs() < 1e-11);
    // And the two differ, so neither constant could hide the other's fault.
    assert_ne!(psnr(&dim, &black).unwrap(), psnr(&one_off, &black).unwrap());
}

#[test]
fn identical_images_have_infinite_psnr_and_an_ssim_of_one() {
    let image = noise(40, 30, 3);
    assert_eq!(psnr(&image, &image).unwrap(), f64::INFINITY);
    assert!((ssim(&image, &image).unwrap() - 1.0).abs() < 1e-12);
}

#[test]
fn masked_psnr_looks_at_set_pixels_alone() {
    let truth = noise(9, 5, 7);
    let mut render = truth.clone();
    render.rgb[3 * 11 + 2] ^= 0x40;
    render.rgb[3 * 20] ^= 0x10;
    let only = |set: &[usize]| {
        let mask: Vec<bool> = (0..45).map(|i| set.contains(&i)).collect();
        masked_psnr(&render, &truth, &mask).unwrap()
    };
    assert_eq!(only(&[0, 1, 44]), Some(f64::INFINITY));
    // Pixel 20 and another: 16^2 over 6 values.
    let expected = -10.0 * (16.0f64.powi(2) / 255.0f64.powi(2) / 6.0).log10();
    assert!((only(&[20, 3]).unwrap() - expected).abs() < 1e-12);
    let all: Vec<usize> = (0..45).collect();
    assert_eq!(only(&all), Some(psnr(&render, &truth).unwrap()));
    assert_eq!(only(&[]), None);
    assert!(masked_psnr(&render, &truth, &[true; 44]).is_err());
}

#[test]
fn masked_ssim_is_the_mean_of_the_map_over_set_pixels() {
    let (render, truth) = pair(31, 17);
    let value = |image: &Image, i: usize| f64::from(image.rgb[i]) / 255.0;
    let map = direct_ssim_map((31, 17), &|i| value(&render, i), &|i| value(&truth, i));
    for only in [&[0][..], &[5, 40, 300, 526], &[526]] {
        let mask: Vec<bool> = (0..31 * 17).map(|i| only.contains(&i)).collect();
        let ours = masked_ssim(&render, &truth, &mask).unwrap().unwrap();
        let direct = only.iter().map(|&i| map[i]).sum::<f64>() / only.len() as f64;
        assert!((ours - direct).abs() < TOLERANCE, "{ours} and {direct}");
        // Another pixel is noticed.
        let moved: Vec<bool> = (0..31 * 17).map(|i| only.contains(&(i + 1))).collect();
        let moved = masked_ssim(&render, &truth, &moved).unwrap();
        assert!(moved.is_none_or(|moved| (moved - direct).abs() > 100.0 * TOLERANCE));
    }
    let all = masked_ssim(&render, &truth, &[true; 31 * 17])
        .unwrap()
        .unwrap();
    assert!((all - ssim(&render, &truth).unwrap()).abs() < TOLERANCE);
    assert_eq!(
        masked_ssim(&render, &truth, &[false; 31 * 17]).unwrap(),
        None
    );
    assert!(masked_ssim(&render, &truth, &[true; 31 * 17 - 1]).is_err());
}

#[test]
fn float_renders_are_clamped_but_not_rounded() {
    let (_, truth) = pair(23, 14);
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut rgb: Vec<f32> = (0..truth.rgb.len())
        .map(|_| rng.random_range(-0.1..1.1))
        .collect();
    rgb[7] = f32::NAN;
    let render = FloatImage {
        width: 23,
        height: 14,
        rgb: &rgb,
    };
    let x = |i: usize| match rgb[i] {
        v if v.is_nan() => 0.0,
        v => f64::from(v.clamp(0.0, 1.0)),
    };
    let y = |i: usize| f64::from(truth.rgb[i]) / 255.0;
    let map = direct_ssim_map((23, 14), &x, &y);
    let direct = map.iter().sum::<f64>() / map.len() as f64;
    assert!((ssim(&render, &truth).unwrap() - direct).abs() < TOLERANCE);
    let n = truth.rgb.len();
    let mse = (0..n).map(|i| (x(i) - y(i)).powi(2)).sum::<f64>() / n as f64;
    assert!((psnr(&render, &truth).unwrap() + 10.0 * mse.log10()).abs() < 1e-11);
    // Rounding is seen by both.
    let rounded = quantize(23, 14, &rgb).unwrap();
    assert!((ssim(&rounded, &truth).unwrap() - direct).abs() > 100.0 * TOLERANCE);
    assert_ne!(
        psnr(&rounded, &truth).unwrap(),
        psnr(&render, &truth).unwrap()
    );
}

#[test]
fn metrics_have_the_same_bits_whatever_the_number_of_threads() {
    let (render, truth) = pair(200, 150);
    let with = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build();
        let ssim = pool.unwrap().install(|| ssim(&render, &truth).unwrap());
        ssim.to_bits()
    };
    let one = with(1);
    assert!([2, 3, 7].into_iter().all(|n| with(n) == one));
}

#[test]
fn renders_are_rounded_to_the_nearest_level_and_clamped() {
    let values = [
        -0.5,
        0.0,
        0.49 / 255.0,
        0.51 / 255.0,
        127.4 / 255.0,
        127.6 / 255.0,
        1.0,
        1.7,
        f32::NAN,
    ];
    let image = quantize(3, 1, &values).unwrap();
    assert_eq!(image.rgb, [0, 0, 0, 1, 127, 128, 255, 255, 0]);
    assert!(quantize(3, 2, &values).is_err());
}

#[test]
fn images_of_different_or_impossible_size_are_refused() {
    let (a, b) = (noise(4, 3, 1), noise(3, 4, 1));
    let text = psnr(&a, &b).unwrap_err().to_string();
    assert!(text.contains("4x3") && text.contains("3x4"), "{text}");
    assert!(ssim(&a, &b).is_err());
    let short = Image {
        width: 4,
        height: 3,
        rgb: vec![0; 35],
    };
    let none = Image {
        width: 0,
        height: 0,
        rgb: vec![],
    };
    for bad in [&short, &none] {
        assert!(psnr(bad, bad).is_err() && ssim(bad, bad).is_err());
    }
}
