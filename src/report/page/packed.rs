//! This module packs Gaussians in 16 bytes each, for the page's own viewer.
//!
//! | bytes | holds |
//! |---|---|
//! | 0..6 | mean, three u16: `x / (1 + |x|)` in (-1, 1), fine at the focus and open to infinity |
//! | 6..9 | natural logarithms of the scales, three u8 over [`SCALE_LOG`] |
//! | 9..12 | x, y, z of the unit rotation whose w is not negative, three i8 |
//! | 12..16 | red, green, blue and opacity, u8; the colour is that of degree 0 |
//!
//! Little-endian, canonical frame: `page/viewer.js` reads the same layout.

use std::ops::RangeInclusive;

use crate::gaussians::Gaussians;

/// Most Gaussians that a page holds: 1.6 MB, 2.1 MB as text.
pub(crate) const MAX_PACKED: usize = 100_000;

/// Bytes a Gaussian.
pub(crate) const PACKED_BYTES: usize = 16;

/// Range of a scale's logarithm, steps of 6 %; in `R`, from 6e-6 to 55.
pub(crate) const SCALE_LOG: RangeInclusive<f32> = -12.0..=4.0;

/// Packs the `limit` Gaussians of most weight ([`Gaussians::heaviest`]).
pub(crate) fn pack(gaussians: &Gaussians, limit: usize) -> Vec<u8> {
    let chosen = gaussians.heaviest(limit);
    let mut bytes = Vec::with_capacity(PACKED_BYTES * chosen.len());
    for i in chosen {
        for x in gaussians.means[i].to_array() {
            bytes.extend(share(0.5 + 0.5 * x / (1.0 + x.abs()), u16::MAX.into()).to_le_bytes());
        }
        let (low, high) = (*SCALE_LOG.start(), *SCALE_LOG.end());
        let scales = gaussians.scales_log[i].to_array();
        bytes.extend(scales.map(|s| share((s - low) / (high - low), 255.0) as u8));
        // Those without a rotation are never drawn.
        let [_, x, y, z] = gaussians.rotation(i).unwrap_or_default();
        bytes.extend([x, y, z].map(|q| (127.0 * q).round() as i8 as u8));
        let rgb = gaussians.base_color(i).to_array();
        bytes.extend(rgb.map(|c| share(c, 255.0) as u8));
        bytes.push(share(gaussians.opacity(i), 255.0) as u8);
    }
    bytes
}

/// Returns `value` in [0, 1] as a whole share of `steps`; what is outside is clamped, NaN is 0.
fn share(value: f32, steps: f32) -> u16 {
    (value.clamp(0.0, 1.0) * steps).round() as u16
}
