//! Randomness is stateless here: the same key gives the same number, on any thread.

use glam::DVec3;

/// Returns a well-mixed 64-bit hash of a key (the finaliser of SplitMix64, Steele et al. 2014).
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Returns a number in `[0, 1)` that belongs to this key.
pub(super) fn random(key: [i64; 3]) -> f64 {
    let mut h = 0x9e37_79b9_7f4a_7c15_u64;
    for part in key {
        h = mix(h
            .wrapping_add(part as u64)
            .wrapping_mul(0x9e37_79b9_7f4a_7c15));
    }
    (h >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// Returns smooth noise in `[0, 1]` with one cell a unit: random values on the integer lattice,
/// interpolated.
pub(super) fn value_noise(p: DVec3) -> f64 {
    let (x, y, z) = (floor(p.x), floor(p.y), floor(p.z));
    let f = p - DVec3::new(x as f64, y as f64, z as f64);
    let w = f * f * (DVec3::splat(3.0) - 2.0 * f);
    // Lighter than `random`, which a texture could not afford eight times a point.
    let lattice = |dx: i64, dy: i64, dz: i64| {
        let key = (x + dx).wrapping_mul(0x9e37_79b9_7f4a_7c15_u64 as i64)
            ^ (y + dy).wrapping_mul(0x85eb_ca6b_27d4_eb4f_u64 as i64)
            ^ (z + dz).wrapping_mul(0xc2b2_ae3d_27d4_eb4f_u64 as i64);
        let key = key as u64;
        ((key ^ (key >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as i32
    };
    // 24 bits a value, so that a 32-bit integer holds it: the cheap conversion.
    let lattice = |dx, dy, dz| f64::from(lattice(dx, dy, dz)) * (1.0 / 16_777_215.0);
    let along_x = |dy, dz| lerp(lattice(0, dy, dz), lattice(1, dy, dz), w.x);
    lerp(
        lerp(along_x(0, 0), along_x(1, 0), w.y),
        lerp(along_x(0, 1), along_x(1, 1), w.y),
        w.z,
    )
}

/// Returns `x.floor() as i64` without the library call that targets lacking SSE 4.1 make of it.
fn floor(x: f64) -> i64 {
    let truncated = x as i64;
    truncated - i64::from(truncated as f64 > x)
}

/// Returns noise in `[0, 1]` with detail at `octaves` scales, each half as large and half as
/// strong.
pub(super) fn fractal_noise(p: DVec3, octaves: u32) -> f64 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    let mut q = p;
    for _ in 0..octaves {
        sum += weight * value_noise(q);
        total += weight;
        weight *= 0.5;
        // The offset keeps the lattices of the octaves apart.
        q = q * 2.0 + DVec3::new(17.3, 9.1, 4.7);
    }
    sum / total
}

pub(super) fn lerp(a: f64, b: f64, w: f64) -> f64 {
    a + (b - a) * w
}

/// Returns 0 below `low`, 1 above `high`, smooth between.
pub(super) fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
