//! Losses of depths and normals, and their derivative with respect to what is rendered.

use super::depth::TwinDepth;
use super::linalg::{Vec3, dot};

/// Squared ratio of deviation to mean at or below which depths do not correlate with anything.
const LEAST_VARIATION: f64 = 1e-6;

/// The loss over the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TwinDepthKind {
    /// 1 less Pearson's correlation.
    Pearson,
    /// Mean L1 after the target's best scale and shift by least squares.
    ScaleShift,
    /// Mean L1.
    L1,
}

/// The depth that is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TwinDepthOf {
    /// The mean by weight.
    Expected,
    /// The median.
    Median,
    /// The mode.
    Mode,
}

/// Losses and their weights.
#[derive(Clone, Copy, Debug)]
pub struct TwinDepthLoss {
    /// What is compared over the image.
    pub kind: TwinDepthKind,
    /// Which depth is compared.
    pub of: TwinDepthOf,
    /// Whether inverse depths are compared.
    pub inverse: bool,
    /// Weight of the loss over the image.
    pub weight: f64,
    /// Weight of the mean over patches.
    pub patch_weight: f64,
    /// Weight of the normals' loss.
    pub normal_weight: f64,
    /// Side of a patch, pixels.
    pub patch: usize,
}

/// A pixel's target.
#[derive(Clone, Copy, Debug, Default)]
pub struct TwinTarget {
    /// Depth, in the form that is compared.
    pub depth: f64,
    /// Weight of the depth.
    pub weight: f64,
    /// Normal in the camera's axes, times its weight.
    pub normal: Vec3,
}

/// A pixel that counts: its number, rendered and target depth, weight.
type Pair = (usize, f64, f64, f64);

/// Sums of a set of pixels.
struct Sums {
    m: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Sums {
    fn of(pairs: &[Pair]) -> Sums {
        let m: f64 = pairs.iter().map(|p| p.3).sum();
        let mean = |of: &dyn Fn(&Pair) -> f64| pairs.iter().map(|p| p.3 * of(p)).sum::<f64>() / m;
        let (x, y) = (mean(&|p| p.1), mean(&|p| p.2));
        let about = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            pairs.iter().map(|p| p.3 * of(p.1 - x, p.2 - y)).sum()
        };
        Sums {
            m,
            x,
            y,
            xx: about(&|x, _| x * x),
            xy: about(&|x, y| x * y),
            yy: about(&|_, y| y * y),
        }
    }

    fn correlates(&self) -> bool {
        let varies = |square: f64, mean: f64| square > LEAST_VARIATION * self.m * mean * mean;
        self.m > 0.0 && varies(self.xx, self.x) && varies(self.yy, self.y)
    }

    fn correlation(&self) -> f64 {
        self.xy / (self.xx * self.yy).sqrt()
    }

    /// Returns the derivative of the correlation by a pixel's rendered depth.
    fn slope(&self, (_, x, y, m): &Pair) -> f64 {
        let by_product = (y - self.y) / (self.xx * self.yy).sqrt();
        m * (by_product - self.correlation() * (x - self.x) / self.xx)
    }
}

/// Pixels that count, with what their rendered depth follows from.
fn pairs(pixels: &[TwinDepth], target: &[TwinTarget], loss: &TwinDepthLoss) -> Vec<Pair> {
    let pair = |(i, (p, t)): (usize, (&TwinDepth, &TwinTarget))| {
        let depth = depth_of(p, loss);
        let counts = p.alpha >= 0.5 && t.weight > 0.0 && depth > 0.0;
        let x = if loss.inverse { 1.0 / depth } else { depth };
        counts.then_some((i, x, t.depth, t.weight))
    };
    pixels
        .iter()
        .zip(target)
        .enumerate()
        .filter_map(pair)
        .collect()
}

fn depth_of(p: &TwinDepth, loss: &TwinDepthLoss) -> f64 {
    match loss.of {
        TwinDepthOf::Expected => p.sum / p.alpha,
        TwinDepthOf::Median => p.median,
        TwinDepthOf::Mode => p.mode,
    }
}

/// Returns the pairs of each patch whose depths correlate, row by row.
fn patches(pairs: &[Pair], width: usize, patch: usize) -> Vec<Vec<Pair>> {
    let across = width.div_ceil(patch);
    let place = |p: &Pair| (p.0 / width / patch) * across + p.0 % width / patch;
    let n = pairs.iter().map(place).max().map_or(0, |most| most + 1);
    let mut patches = vec![Vec::new(); n];
    pairs.iter().for_each(|p| patches[place(p)].push(*p));
    patches.retain(|patch| Sums::of(patch).correlates());
    patches
}

/// Returns the losses of image, patches and normals, and the share of pixels that count, by weight.
pub fn depth_losses(
    pixels: &[TwinDepth],
    target: &[TwinTarget],
    loss: &TwinDepthLoss,
    width: usize,
) -> [f64; 4] {
    let pairs = pairs(pixels, target, loss);
    let sums = Sums::of(&pairs);
    let (scale, shift) = fit(&sums, loss.kind);
    let of_image = match loss.kind {
        TwinDepthKind::Pearson if sums.correlates() => 1.0 - sums.correlation(),
        TwinDepthKind::Pearson => 0.0,
        _ if pairs.is_empty() => 0.0,
        _ => {
            let error = |(_, x, y, m): &Pair| m * (scale * y + shift - x).abs();
            pairs.iter().map(error).sum::<f64>() / sums.m
        }
    };
    let patches = patches(&pairs, width, loss.patch);
    let of_patches: f64 = patches
        .iter()
        .map(|p| 1.0 - Sums::of(p).correlation())
        .sum();
    let (mut of_normals, mut m_normals) = (0.0, 0.0);
    for (p, t) in pixels.iter().zip(target).filter(|(p, _)| p.alpha >= 0.5) {
        let m = dot(&t.normal, &t.normal).sqrt();
        of_normals += m - dot(&p.normal, &t.normal);
        m_normals += m;
    }
    let mean = |sum: f64, n: f64| if n > 0.0 { sum / n } else { 0.0 };
    [
        of_image,
        mean(of_patches, patches.len() as f64),
        mean(of_normals, m_normals),
        pairs.iter().map(|p| p.3).sum::<f64>() / pixels.len() as f64,
    ]
}

fn fit(sums: &Sums, kind: TwinDepthKind) -> (f64, f64) {
    if kind == TwinDepthKind::L1 {
        return (1.0, 0.0);
    }
    let varies = sums.yy > LEAST_VARIATION * sums.m * sums.y * sums.y;
    let scale = if varies { sums.xy / sums.yy } else { 0.0 };
    (scale, sums.x - scale * sums.y)
}

/// Returns the gradient of the weighted sum of [`depth_losses`] with respect to what is rendered.
pub fn depth_loss_gradient(
    pixels: &[TwinDepth],
    target: &[TwinTarget],
    loss: &TwinDepthLoss,
    width: usize,
) -> Vec<TwinDepth> {
    let pairs = pairs(pixels, target, loss);
    let sums = Sums::of(&pairs);
    let mut d_x = vec![0.0; pixels.len()];
    if loss.kind != TwinDepthKind::Pearson {
        let (scale, shift) = fit(&sums, loss.kind);
        let sign = |p: &Pair| p.3 * (scale * p.2 + shift - p.1).signum();
        // The loss's derivatives by shift and scale.
        let d_shift: f64 = pairs.iter().map(sign).sum::<f64>() / sums.m;
        let d_scale: f64 = pairs.iter().map(|p| sign(p) * p.2).sum::<f64>() / sums.m;
        for p in &pairs {
            let mut d = -sign(p) / sums.m;
            if loss.kind == TwinDepthKind::ScaleShift {
                let by_scale = match scale == 0.0 {
                    true => 0.0,
                    false => p.3 * (p.2 - sums.y) / sums.yy,
                };
                d += d_scale * by_scale + d_shift * (p.3 / sums.m - sums.y * by_scale);
            }
            d_x[p.0] += loss.weight * d;
        }
    } else if sums.correlates() {
        pairs
            .iter()
            .for_each(|p| d_x[p.0] -= loss.weight * sums.slope(p));
    }
    let patches = patches(&pairs, width, loss.patch);
    for patch in &patches {
        let sums = Sums::of(patch);
        for p in patch {
            d_x[p.0] -= loss.patch_weight / patches.len() as f64 * sums.slope(p);
        }
    }
    let covered = pixels.iter().zip(target).filter(|(p, _)| p.alpha >= 0.5);
    let m_normals: f64 = covered.map(|(_, t)| dot(&t.normal, &t.normal).sqrt()).sum();
    let pixel = |((p, t), d_x): ((&TwinDepth, &TwinTarget), f64)| {
        let mut d = TwinDepth::default();
        if p.alpha >= 0.5 && m_normals > 0.0 {
            d.normal = t.normal.map(|n| -loss.normal_weight * n / m_normals);
        }
        if d_x == 0.0 {
            return d;
        }
        let depth = depth_of(p, loss);
        let d_depth = if loss.inverse {
            -d_x / (depth * depth)
        } else {
            d_x
        };
        match loss.of {
            TwinDepthOf::Expected => {
                d.sum = d_depth / p.alpha;
                d.alpha = -d_depth * p.sum / (p.alpha * p.alpha);
            }
            TwinDepthOf::Median => d.median = d_depth,
            TwinDepthOf::Mode => d.mode = d_depth,
        }
        d
    };
    pixels.iter().zip(target).zip(d_x).map(pixel).collect()
}
