//! Dropout: which Gaussians a view leaves out, and what the others' opacity is multiplied by.

/// Probability in steps of 2^-32, and the key that decides which.
#[derive(Clone, Copy, Debug)]
pub struct TwinDropout {
    pub threshold: u32,
    pub key: u32,
}

impl TwinDropout {
    /// Factor of Gaussian `i`'s opacity: 0 where it is left out, else 1 / (1 - p).
    pub fn factor(&self, i: usize) -> f64 {
        if pcg(pcg(i as u32) ^ self.key) < self.threshold {
            return 0.0;
        }
        1.0 / (1.0 - f64::from(self.threshold) / 2f64.powi(32))
    }
}

/// PCG hash with 64-bit arithmetic modulo 2^32.
pub fn pcg(v: u32) -> u32 {
    let modulo = |x: u64| x % (1 << 32);
    let state = modulo(u64::from(v) * 747_796_405 + 2_891_336_453);
    let shift = state / (1 << 28) + 4;
    let word = modulo(((state >> shift) ^ state) * 277_803_737);
    ((word >> 22) ^ word) as u32
}
