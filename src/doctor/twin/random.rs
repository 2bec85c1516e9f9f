//! This module draws seeded numbers for the cases.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::linalg::{Vec3, dot};

/// Returns the f64 of the nearest f32.
pub fn f32_exact(x: f64) -> f64 {
    f64::from(x as f32)
}

/// Seeded numbers.
pub struct Random(ChaCha8Rng);

impl Random {
    /// Starts the numbers that belong to a seed.
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Draws a number in `[low, high)`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        low + (high - low) * unit
    }

    /// Draws a standard normal number (Box-Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform(0.0, 1.0)).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform(0.0, 1.0)).cos()
    }
}

/// Draws a point uniformly from the ball of `radius` about the origin.
pub(super) fn in_ball(random: &mut Random, radius: f64) -> Vec3 {
    loop {
        let p = [(); 3].map(|()| random.uniform(-1.0, 1.0));
        if dot(&p, &p) <= 1.0 {
            return p.map(|x| x * radius);
        }
    }
}
