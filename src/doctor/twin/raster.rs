//! Compositing by brute force, pixel by pixel, and its derivative.

use rayon::prelude::*;

use super::linalg::{Vec3, dot};
use super::model::{SplatGradient, TwinCamera, TwinGaussians, TwinGradients, TwinSplat};
use super::project::{project, project_backward};
use super::tolerance;

/// Cap of a splat's alpha.
pub const ALPHA_MAX: f64 = 0.999;
/// Alpha below which a splat is skipped at a pixel.
pub const ALPHA_MIN: f64 = 1.0 / 255.0;
/// A pixel ends before its transmittance falls to this.
pub const TRANSMITTANCE_MIN: f64 = 1e-4;

/// Image rows that one task accumulates: fixed, so that sums do not depend on the threads.
pub(super) const BAND: usize = 16;

/// A rendered view; per-pixel arrays are row-major from the top.
#[derive(Clone, Debug)]
pub struct TwinRender {
    /// `height * width * 3`, not clamped.
    pub rgb: Vec<f64>,
    /// `height * width`, 1 - final transmittance.
    pub alpha: Vec<f64>,
    /// Pixels at which a decision (skip, stop, cap, order) hangs on less than the tolerance: single
    /// precision may decide otherwise.
    pub fragile: Vec<bool>,
    /// Number of Gaussians blended.
    pub count: Vec<u32>,
    /// One entry a Gaussian, in the Gaussians' order.
    pub projected: Vec<TwinSplat>,
}

/// A splat that takes part, with a bound of where it can reach `alpha = 1/255`.
pub(super) struct Active {
    id: usize,
    splat: TwinSplat,
    /// Half the bounding box of the ellipse on which alpha falls below the threshold, pixels.
    extent: [f64; 2],
}

/// One blended Gaussian at one pixel.
pub(super) struct Blend {
    pub(super) id: usize,
    pub(super) splat: TwinSplat,
    delta: [f64; 2],
    /// `exp(-q / 2)`.
    falloff: f64,
    pub(super) alpha: f64,
    /// Before this Gaussian.
    pub(super) transmittance: f64,
}

/// Returns valid splats by increasing depth, equal depths by index.
pub fn depth_order(splats: &[TwinSplat]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..splats.len()).filter(|&i| splats[i].valid).collect();
    order.sort_by(|&a, &b| splats[a].depth.total_cmp(&splats[b].depth).then(a.cmp(&b)));
    order
}

/// Returns splats that can reach `1/255` less the tolerance somewhere: `q <= 2 ln(255 o)`, the box
/// of which is `sqrt(q cov)` in each axis.
pub(super) fn active(splats: &[TwinSplat], tolerance: f64) -> Vec<Active> {
    depth_order(splats)
        .into_iter()
        .filter_map(|id| {
            let splat = splats[id];
            let q = 2.0 * (splat.opacity / ALPHA_MIN * (1.0 + 2.0 * tolerance)).ln();
            let extent = [splat.cov2d[0], splat.cov2d[2]].map(|c| (q * c).sqrt() * (1.0 + 1e-9));
            (q >= 0.0).then_some(Active { id, splat, extent })
        })
        .collect()
}

/// Walks one pixel front to back. Leaves what was blended in `blends`; returns the final
/// transmittance and whether a decision was close.
pub(super) fn walk(
    row: &[&Active],
    (x, y): (usize, usize),
    tolerance: f64,
    blends: &mut Vec<Blend>,
) -> (f64, bool) {
    let close = |value: f64, threshold: f64, tolerance: f64| {
        (value - threshold).abs() <= tolerance * threshold
    };
    blends.clear();
    let (mut transmittance, mut fragile) = (1.0, false);
    for Active { id, splat, extent } in row {
        let dx = x as f64 + 0.5 - splat.mean2d[0];
        if dx.abs() > extent[0] {
            continue;
        }
        let dy = y as f64 + 0.5 - splat.mean2d[1];
        let [a, b, c] = splat.conic;
        let falloff = (-0.5 * (a * dx * dx + 2.0 * b * dx * dy + c * dy * dy)).exp();
        let raw = splat.opacity * falloff;
        let alpha = raw.min(ALPHA_MAX);
        fragile |= close(raw, ALPHA_MIN, tolerance);
        if alpha < ALPHA_MIN {
            continue;
        }
        fragile |= close(raw, ALPHA_MAX, 0.1 * tolerance);
        if let Some(last) = blends.last() {
            let gap = splat.depth - last.splat.depth;
            fragile |= gap > 0.0 && gap <= tolerance::DEPTH_GAP * splat.depth;
        }
        let next = transmittance * (1.0 - alpha);
        fragile |= close(next, TRANSMITTANCE_MIN, tolerance);
        if next <= TRANSMITTANCE_MIN {
            break;
        }
        blends.push(Blend {
            id: *id,
            splat: *splat,
            delta: [dx, dy],
            falloff,
            alpha,
            transmittance,
        });
        transmittance = next;
    }
    (transmittance, fragile)
}

/// Returns the active splats whose box meets the pixel centres of row `y`.
pub(super) fn row_of(active: &[Active], y: usize) -> Vec<&Active> {
    active
        .iter()
        .filter(|s| (y as f64 + 0.5 - s.splat.mean2d[1]).abs() <= s.extent[1])
        .collect()
}

/// Renders with the doctor's own fragile tolerance.
pub fn render(gaussians: &TwinGaussians, camera: &TwinCamera) -> TwinRender {
    render_with_tolerance(gaussians, camera, tolerance::FRAGILE)
}

/// Renders the view; pixels with a decision within relative `tolerance` are marked fragile.
pub fn render_with_tolerance(
    gaussians: &TwinGaussians,
    camera: &TwinCamera,
    tolerance: f64,
) -> TwinRender {
    let projected: Vec<TwinSplat> = (0..gaussians.n())
        .into_par_iter()
        .map(|i| project(gaussians, i, camera))
        .collect();
    let active = active(&projected, tolerance);
    let pixels: Vec<(Vec3, f64, bool, u32)> = (0..camera.height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let row = row_of(&active, y);
            let mut blends = Vec::new();
            (0..camera.width).map(move |x| {
                let (transmittance, fragile) = walk(&row, (x, y), tolerance, &mut blends);
                let mut rgb = camera.background.map(|c| transmittance * c);
                for blend in &blends {
                    for (sum, c) in rgb.iter_mut().zip(blend.splat.rgb) {
                        *sum += blend.alpha * blend.transmittance * c;
                    }
                }
                (rgb, 1.0 - transmittance, fragile, blends.len() as u32)
            })
        })
        .collect();
    TwinRender {
        rgb: pixels.iter().flat_map(|p| p.0).collect(),
        alpha: pixels.iter().map(|p| p.1).collect(),
        fragile: pixels.iter().map(|p| p.2).collect(),
        count: pixels.iter().map(|p| p.3).collect(),
        projected,
    }
}

/// Returns the gradient of `sum(d_rgb * rgb) + sum(d_alpha * alpha)`, with skip, stop, cap and
/// order held. `d_rgb`: `height * width * 3`, `d_alpha`: `height * width`.
pub fn backward(
    gaussians: &TwinGaussians,
    camera: &TwinCamera,
    render: &TwinRender,
    d_rgb: &[f64],
    d_alpha: &[f64],
) -> TwinGradients {
    let n = gaussians.n();
    let active = active(&render.projected, 0.0);
    let bands: Vec<Vec<SplatGradient>> = (0..camera.height.div_ceil(BAND))
        .into_par_iter()
        .map(|band| {
            let mut sums = vec![[0.0; 9]; n];
            let mut blends = Vec::new();
            for y in band * BAND..camera.height.min((band + 1) * BAND) {
                let row = row_of(&active, y);
                for x in 0..camera.width {
                    let pixel = y * camera.width + x;
                    let d_color = std::array::from_fn(|c| d_rgb[pixel * 3 + c]);
                    let (transmittance, _) = walk(&row, (x, y), 0.0, &mut blends);
                    let background = camera.background;
                    let out = (d_color, d_alpha[pixel]);
                    pixel_backward(&blends, transmittance, background, out, &mut sums);
                }
            }
            sums
        })
        .collect();
    let mut splats = vec![[0.0; 9]; n];
    for band in &bands {
        for (sum, part) in splats.iter_mut().zip(band) {
            for (s, p) in sum.iter_mut().zip(part) {
                *s += p;
            }
        }
    }
    let raw: Vec<_> = (0..n)
        .into_par_iter()
        .map(|i| project_backward(gaussians, i, camera, &splats[i]))
        .collect();
    TwinGradients {
        means: raw.iter().map(|g| g.mean).collect(),
        sh: raw.iter().map(|g| g.sh).collect(),
        opacity_logit: raw.iter().map(|g| g.opacity_logit).collect(),
        scale_log: raw.iter().map(|g| g.scale_log).collect(),
        rotation_wxyz: raw.iter().map(|g| g.rotation_wxyz).collect(),
        splats,
    }
}

/// Adds one pixel's gradient `(d_rgb, d_alpha)` to the splats', back to front.
fn pixel_backward(
    blends: &[Blend],
    final_transmittance: f64,
    background: Vec3,
    (d_color, d_alpha): (Vec3, f64),
    sums: &mut [SplatGradient],
) {
    // The part of the loss that passes through everything behind the current Gaussian:
    // it is proportional to 1 - alpha.
    let mut behind = final_transmittance * (dot(&background, &d_color) - d_alpha);
    for blend in blends.iter().rev() {
        let sum = &mut sums[blend.id];
        let weight = blend.alpha * blend.transmittance;
        for c in 0..3 {
            sum[5 + c] += weight * d_color[c];
        }
        let own = dot(&blend.splat.rgb, &d_color);
        let d = blend.transmittance * own - behind / (1.0 - blend.alpha);
        behind += weight * own;
        alpha_backward(blend, d, sum);
    }
}

/// Adds what the gradient `d` to a splat's alpha at a pixel is to the splat.
pub(super) fn alpha_backward(blend: &Blend, d: f64, sum: &mut SplatGradient) {
    if blend.splat.opacity * blend.falloff > ALPHA_MAX {
        return;
    }
    sum[8] += blend.falloff * d;
    let d_q = -0.5 * blend.alpha * d;
    let [a, b, c] = blend.splat.conic;
    let [dx, dy] = blend.delta;
    // delta = pixel - mean2d, hence the sign.
    sum[0] -= d_q * 2.0 * (a * dx + b * dy);
    sum[1] -= d_q * 2.0 * (b * dx + c * dy);
    sum[2] += d_q * dx * dx;
    sum[3] += d_q * 2.0 * dx * dy;
    sum[4] += d_q * dy * dy;
}
