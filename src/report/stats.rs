//! This module has means, spreads and rank correlation.

use serde::Serialize;

/// Mean and spread of what several runs measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Arithmetic mean.
    pub mean: f64,
    /// Sample standard deviation; `None` for a single value.
    pub deviation: Option<f64>,
}

impl Figure {
    /// Returns mean and deviation; `None` if a value is missing or there is none.
    pub fn of(values: impl Iterator<Item = Option<f64>>) -> Option<Figure> {
        let values = values.collect::<Option<Vec<f64>>>()?;
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        (!values.is_empty()).then_some(Figure {
            mean,
            // An infinite value has none.
            deviation: (n > 1.0 && mean.is_finite()).then(|| (squares / (n - 1.0)).sqrt()),
        })
    }

    /// Returns a figure without a deviation, for what no chance decides.
    pub fn exact(value: f64) -> Figure {
        Figure {
            mean: value,
            deviation: None,
        }
    }

    /// Returns whether the difference of the means is no larger than the standard deviation of the
    /// difference between two single runs, `sqrt(s_a^2 + s_b^2)`; `None` where a deviation is not
    /// known.
    pub fn is_within_noise_of(&self, other: &Figure) -> Option<bool> {
        let noise = self.deviation?.hypot(other.deviation?);
        Some((self.mean - other.mean).abs() <= noise)
    }
}

/// Returns Spearman's rank correlation, -1 to 1: Pearson's of the ranks, equal values sharing the
/// mean of theirs. `None` where there is no order: fewer than two pairs, all of one value, or a
/// NaN.
pub fn spearman(pairs: &[(f64, f64)]) -> Option<f64> {
    if pairs.iter().any(|(x, y)| x.is_nan() || y.is_nan()) {
        return None;
    }
    let xs = ranks(pairs.iter().map(|pair| pair.0).collect());
    let ys = ranks(pairs.iter().map(|pair| pair.1).collect());
    pearson(&xs, &ys)
}

/// Returns the ranks, from 1; equal values share the mean of theirs.
fn ranks(values: Vec<f64>) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    for tied in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let mean = first as f64 + 0.5 * (tied.len() + 1) as f64;
        tied.iter().for_each(|&i| ranks[i] = mean);
        first += tied.len();
    }
    ranks
}

fn pearson(xs: &[f64], ys: &[f64]) -> Option<f64> {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_x, mean_y) = (mean(xs), mean(ys));
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (x, y) in xs.iter().zip(ys) {
        let (dx, dy) = (x - mean_x, y - mean_y);
        xx += dx * dx;
        yy += dy * dy;
        xy += dx * dy;
    }
    (xx > 0.0 && yy > 0.0).then(|| xy / (xx * yy).sqrt())
}

/// Returns Spearman's rank correlation of `xs` and `ys` where `zs` is held constant: the partial
/// correlation of the ranks. `None` as for [`spearman`], and where `zs` orders either alike.
pub fn partial_spearman(xs: &[f64], ys: &[f64], zs: &[f64]) -> Option<f64> {
    let correlation = |a: &[f64], b: &[f64]| {
        let pairs: Vec<(f64, f64)> = a.iter().copied().zip(b.iter().copied()).collect();
        spearman(&pairs)
    };
    let (xy, xz, yz) = (
        correlation(xs, ys)?,
        correlation(xs, zs)?,
        correlation(ys, zs)?,
    );
    let left = (1.0 - xz * xz) * (1.0 - yz * yz);
    // Below this only rounding is left of either order.
    (left > 1e-12).then(|| (xy - xz * yz) / left.sqrt())
}
