//! This module finds 256 values that many are rounded to.

/// Values of a codebook.
const N: usize = 256;
/// Times that the values are moved to the middle of what is nearest to them.
const ROUNDS: usize = 20;

/// Values in ascending order, a number each.
pub(super) struct Codebook {
    pub(super) values: Vec<f32>,
}

impl Codebook {
    /// Fits values to `samples` in the sum of squares: k-means in one dimension, from evenly spread
    /// values on, which leaves room for rare ones.
    pub(super) fn of(samples: &[f32]) -> Codebook {
        let mut sorted = samples.to_vec();
        sorted.sort_unstable_by(f32::total_cmp);
        let sums: Vec<f64> = std::iter::once(0.0)
            .chain(sorted.iter().scan(0.0, |sum, value| {
                *sum += f64::from(*value);
                Some(*sum)
            }))
            .collect();
        let (least, most) = match sorted.as_slice() {
            [] => (0.0, 0.0),
            [first, .., last] => (*first, *last),
            [only] => (*only, *only),
        };
        let spread = |i: usize| least + (most - least) * i as f32 / (N - 1) as f32;
        let mut values: Vec<f32> = (0..N).map(spread).collect();
        for _ in 0..ROUNDS {
            let mut first = 0;
            for i in 0..N {
                let end = match values.get(i + 1) {
                    Some(next) => {
                        let middle = 0.5 * (values[i] + next);
                        sorted.partition_point(|value| *value < middle)
                    }
                    None => sorted.len(),
                };
                if end > first {
                    values[i] = ((sums[end] - sums[first]) / (end - first) as f64) as f32;
                    first = end;
                }
            }
            // Rounding may turn round what lies next to each other.
            values.sort_unstable_by(f32::total_cmp);
        }
        Codebook { values }
    }

    /// Returns the number of the value nearest to `sample`.
    pub(super) fn nearest(&self, sample: f32) -> u8 {
        let above = self
            .values
            .partition_point(|value| *value < sample)
            .min(N - 1);
        let below = above.saturating_sub(1);
        match sample - self.values[below] <= self.values[above] - sample {
            true => below as u8,
            false => above as u8,
        }
    }
}
