//! This module has the random numbers of the view choice, and the weighted draw.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::error::{Error, Result};

/// The random stream of the view choice, apart from those of other consumers of the seed.
const STREAM: u64 = 0x7669_6577;

/// Returns the view choice's own random numbers.
pub(super) fn random(seed: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(STREAM);
    rng
}

/// Draws a number uniform in the open interval (0, 1): neither end has a finite positive logarithm.
pub(super) fn open_unit(rng: &mut impl Rng) -> f64 {
    ((rng.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

/// Returns the indices of `count` entries drawn one after another without replacement, each with
/// probability proportional to its weight among those left; in the order of the draw.
///
/// By exponential keys `-ln(u_j) / w_j`, smallest first (Efraimidis and Spirakis, 2006).
///
/// # Errors
/// `count` beyond the number of weights; a weight that is not a positive finite number.
pub fn draw_without_replacement(weights: &[f64], count: usize, seed: u64) -> Result<Vec<usize>> {
    if count > weights.len() {
        return Err(Error::usage(format!(
            "cannot draw {count} of {} candidates without replacement",
            weights.len()
        )));
    }
    if let Some(j) = weights.iter().position(|w| !(w.is_finite() && *w > 0.0)) {
        return Err(Error::usage(format!(
            "candidate {j} has the sampling weight {}",
            weights[j]
        ))
        .way_out("views.epsilon must be positive and field.lambda not negative"));
    }
    let mut rng = random(seed);
    let mut keys: Vec<(f64, usize)> = weights
        .iter()
        .enumerate()
        .map(|(j, w)| (-open_unit(&mut rng).ln() / w, j))
        .collect();
    keys.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    Ok(keys.into_iter().take(count).map(|(_, j)| j).collect())
}
