//! Dropout of a view: the Gaussians that it leaves out, and the factor of the others' opacity.

use super::linalg::{Vec3, dot, sub};

/// A view's dropout: a probability, and the key that decides which Gaussians are left out.
#[derive(Clone, Debug)]
pub struct TwinDropout {
    /// Probability in steps of 2^-32.
    pub threshold: u32,
    /// Number that is mixed into each Gaussian's hash.
    pub key: u32,
    /// Each Gaussian's share of the probability; `None`: all of it, and the others' opacity makes
    /// up.
    pub guide: Option<TwinGuide>,
}

/// A guide of dropout by depth and density (Song et al. 2026, eqs. 1 and 2).
#[derive(Clone, Debug)]
pub struct TwinGuide {
    /// Weights of depth and of density.
    pub weights: [f64; 2],
    /// Density of each Gaussian, 0 to 1.
    pub densities: Vec<f64>,
    /// Share of the probability of each Gaussian.
    shares: Vec<f64>,
}

impl TwinGuide {
    /// Finds the shares for a camera at `center`; there is at least one Gaussian.
    pub fn new(weights: [f64; 2], densities: Vec<f64>, means: &[Vec3], center: &Vec3) -> TwinGuide {
        let distance = |mean: &Vec3| {
            let offset = sub(mean, center);
            dot(&offset, &offset).sqrt()
        };
        let distances: Vec<f64> = means.iter().map(distance).collect();
        let mut sorted = distances.clone();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        let (first, last) = (sorted[0], sorted[n - 1]);
        let share = |(d, density): (&f64, &f64)| {
            let score = weights[0] * (last - d) / (last - first) + weights[1] * density;
            let layer = if *d <= sorted[n / 3] {
                1.0
            } else if *d <= sorted[2 * n / 3] {
                0.7
            } else {
                0.3
            };
            layer * score
        };
        TwinGuide {
            shares: distances.iter().zip(&densities).map(share).collect(),
            weights,
            densities,
        }
    }
}

impl TwinDropout {
    /// Returns the factor of Gaussian `i`'s opacity: 0 if it is left out, else 1 / (1 - p), or 1
    /// with a guide.
    pub fn factor(&self, i: usize) -> f64 {
        let hash = f64::from(pcg(pcg(i as u32) ^ self.key));
        let threshold = f64::from(self.threshold);
        let (threshold, kept) = match &self.guide {
            Some(guide) => (threshold * guide.shares[i], 1.0),
            None => (threshold, 1.0 - threshold / 2f64.powi(32)),
        };
        if hash < threshold { 0.0 } else { 1.0 / kept }
    }
}

/// Returns the PCG hash with 64-bit arithmetic modulo 2^32.
pub fn pcg(v: u32) -> u32 {
    let modulo = |x: u64| x % (1 << 32);
    let state = modulo(u64::from(v) * 747_796_405 + 2_891_336_453);
    let shift = state / (1 << 28) + 4;
    let word = modulo(((state >> shift) ^ state) * 277_803_737);
    ((word >> 22) ^ word) as u32
}
