//! Image losses and their gradient, found window by window.

use rayon::prelude::*;

const RADIUS: isize = 5;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// `(1 - w) L1 + w (1 - SSIM)` and its parts.
#[derive(Clone, Debug)]
pub struct TwinLoss {
    /// `(1 - w) L1 + w (1 - SSIM)`, `w` the weight of SSIM.
    pub loss: f64,
    /// Mean over pixels, by weight, and channels.
    pub l1: f64,
    /// Mean over pixels, by weight, and channels; 1 if no pixel has weight.
    pub ssim: f64,
    /// Gradient of `loss` to the render, `height * width * 3`.
    pub d_render: Vec<f64>,
}

/// Returns the mean of `|render - target|` over the `far` pixels and its gradient to the render; both images
/// are `height * width * 3`. Without such pixels both are 0.
pub fn far_l1(render: &[f64], target: &[f64], far: &[bool]) -> (f64, Vec<f64>) {
    let total = 3.0 * far.iter().filter(|far| **far).count() as f64;
    let mut d_render = vec![0.0; render.len()];
    let mut sum = 0.0;
    for i in (0..render.len()).filter(|i| far[i / 3]) {
        let difference = render[i] - target[i];
        sum += difference.abs();
        if difference != 0.0 {
            d_render[i] = difference.signum() / total;
        }
    }
    (sum / total.max(1.0), d_render)
}

/// Returns the mean binary cross-entropy between the opacity of every pixel and whether it shows the subject,
/// and its gradient to the opacities, which lie between 0 and 1.
pub fn silhouette(opacity: &[f64], subject: &[bool]) -> (f64, Vec<f64>) {
    let n = opacity.len() as f64;
    let pixels = opacity.iter().zip(subject);
    let entropy = pixels.clone().map(|(a, shows)| match shows {
        true => -a.ln(),
        false => -(1.0 - a).ln(),
    });
    let gradient = pixels.map(|(a, shows)| match shows {
        true => -1.0 / (a * n),
        false => 1.0 / ((1.0 - a) * n),
    });
    (entropy.sum::<f64>() / n, gradient.collect())
}

/// Returns the 11x11 Gaussian window of sigma 1.5, sum 1, row-major.
pub fn window() -> Vec<f64> {
    let mut weights: Vec<f64> = (-RADIUS..=RADIUS)
        .flat_map(|y| (-RADIUS..=RADIUS).map(move |x| (x * x + y * y) as f64))
        .map(|r2| (-r2 / (2.0 * SIGMA * SIGMA)).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights
}

/// Returns the loss of `render` against `target`, both `height * width * 3`, and its gradient to
/// `render`.
///
/// Without a mask the windows are zero-padded and everything is a mean over all values. With one,
/// a weight of every pixel, L1 is the mean over the pixels by weight, a window's weights are
/// multiplied by those of its pixels and normalised, and SSIM is the mean over the centres by
/// weight; pixels of weight 0 are never read. With nothing but those the loss and its gradient
/// are 0.
pub fn loss(
    render: &[f64],
    target: &[f64],
    mask: Option<&[f64]>,
    width: usize,
    height: usize,
    ssim_weight: f64,
) -> TwinLoss {
    assert_eq!(render.len(), width * height * 3);
    assert_eq!(target.len(), render.len());
    let of = |pixel: usize| mask.map_or(1.0, |m| m[pixel]);
    let total = 3.0 * (0..width * height).map(of).sum::<f64>();
    let mut out = TwinLoss {
        loss: 0.0,
        l1: 0.0,
        ssim: 1.0,
        d_render: vec![0.0; render.len()],
    };
    if total == 0.0 {
        return out;
    }
    let mut l1 = 0.0;
    for i in (0..render.len()).filter(|i| of(i / 3) > 0.0) {
        let difference = render[i] - target[i];
        l1 += of(i / 3) * difference.abs();
        if difference != 0.0 {
            out.d_render[i] = (1.0 - ssim_weight) * of(i / 3) * difference.signum() / total;
        }
    }
    out.l1 = l1 / total;

    let weights = window();
    let channels: Vec<(f64, Vec<f64>)> = (0..3)
        .into_par_iter()
        .map(|c| {
            let x: Vec<f64> = render.iter().skip(c).step_by(3).copied().collect();
            let y: Vec<f64> = target.iter().skip(c).step_by(3).copied().collect();
            let mut sum = 0.0;
            let mut d_x = vec![0.0; x.len()];
            for center in (0..x.len()).filter(|&p| of(p) > 0.0) {
                let window = window_at(center, mask, width, height, &weights);
                sum += of(center) * window_ssim(&x, &y, &window, of(center), &mut d_x);
            }
            (sum, d_x)
        })
        .collect();
    out.ssim = channels.iter().map(|(sum, _)| sum).sum::<f64>() / total;
    for (c, (_, d_x)) in channels.iter().enumerate() {
        for (pixel, d) in d_x.iter().enumerate() {
            out.d_render[pixel * 3 + c] -= ssim_weight * d / total;
        }
    }
    out.loss = (1.0 - ssim_weight) * out.l1 + ssim_weight * (1.0 - out.ssim);
    out
}

/// Returns pixels and weights of the window around a pixel: those inside the image and of some
/// weight, normalised if there is a mask.
fn window_at(
    center: usize,
    mask: Option<&[f64]>,
    width: usize,
    height: usize,
    weights: &[f64],
) -> Vec<(usize, f64)> {
    let side = 2 * RADIUS + 1;
    let mut window: Vec<(usize, f64)> = (0..side * side)
        .zip(weights)
        .filter_map(|(k, &weight)| {
            let x = (center % width).checked_add_signed(k % side - RADIUS)?;
            let y = (center / width).checked_add_signed(k / side - RADIUS)?;
            if x >= width || y >= height {
                return None;
            }
            let weight = weight * mask.map_or(1.0, |m| m[y * width + x]);
            (weight > 0.0).then_some((y * width + x, weight))
        })
        .collect();
    if mask.is_some() {
        let sum: f64 = window.iter().map(|(_, w)| w).sum();
        window.iter_mut().for_each(|(_, w)| *w /= sum);
    }
    window
}

/// Returns SSIM of one window of one channel; adds `scale` times its gradient to `d_x`.
fn window_ssim(x: &[f64], y: &[f64], window: &[(usize, f64)], scale: f64, d_x: &mut [f64]) -> f64 {
    let mean = |f: &dyn Fn(usize) -> f64| window.iter().map(|&(p, w)| w * f(p)).sum::<f64>();
    let (mx, my) = (mean(&|p| x[p]), mean(&|p| y[p]));
    let (mxx, myy) = (mean(&|p| x[p] * x[p]), mean(&|p| y[p] * y[p]));
    let mxy = mean(&|p| x[p] * y[p]);
    let luminance = [2.0 * mx * my + C1, mx * mx + my * my + C1];
    let contrast = [
        2.0 * (mxy - mx * my) + C2,
        mxx - mx * mx + myy - my * my + C2,
    ];
    let ssim = luminance[0] / luminance[1] * contrast[0] / contrast[1];
    // To the three moments that depend on x, by the quotient rule.
    let d_mxy = ssim * 2.0 / contrast[0];
    let d_mxx = -ssim / contrast[1];
    let d_mx = ssim
        * (2.0 * my / luminance[0] - 2.0 * mx / luminance[1] - 2.0 * my / contrast[0]
            + 2.0 * mx / contrast[1]);
    for &(p, w) in window {
        d_x[p] += scale * w * (d_mx + 2.0 * x[p] * d_mxx + y[p] * d_mxy);
    }
    ssim
}
