//! Gaussians in 16 bytes each, for the page's own viewer.
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

use glam::Vec3;

use crate::gaussians::{Gaussians, SH_0};

/// Most Gaussians that a page holds: 1.6 MB, 2.1 MB as text.
pub const MAX_PACKED: usize = 100_000;

/// Bytes a Gaussian.
pub const PACKED_BYTES: usize = 16;

/// Range of a scale's logarithm, steps of 6 %; in `R`, from 6e-6 to 55.
pub const SCALE_LOG: RangeInclusive<f32> = -12.0..=4.0;

/// Opacities below this are never drawn, as in training.
const MIN_OPACITY: f32 = 1.0 / 255.0;

/// The `limit` Gaussians of most weight, those equal in the model's order. Weight is opacity times
/// the area of the largest section: about what a Gaussian covers in an image.
pub fn pack(gaussians: &Gaussians, limit: usize) -> Vec<u8> {
    let opacity = |i: usize| 1.0 / (1.0 + (-gaussians.opacity_logits[i]).exp());
    let is_drawn = |i: &usize| {
        gaussians.means[*i].is_finite()
            && gaussians.scales_log[*i].is_finite()
            && rotation(gaussians.rotations_wxyz[*i]).is_some()
            && opacity(*i) >= MIN_OPACITY
    };
    let mut chosen: Vec<usize> = (0..gaussians.len()).filter(is_drawn).collect();
    if chosen.len() > limit {
        let weight = |i: usize| {
            let s = gaussians.scales_log[i];
            opacity(i).ln() + s.element_sum() - s.min_element()
        };
        chosen.sort_by(|a, b| weight(*b).total_cmp(&weight(*a)));
        chosen.truncate(limit);
        chosen.sort_unstable();
    }
    let mut bytes = Vec::with_capacity(PACKED_BYTES * chosen.len());
    for i in chosen {
        for x in gaussians.means[i].to_array() {
            bytes.extend(share(0.5 + 0.5 * x / (1.0 + x.abs()), u16::MAX.into()).to_le_bytes());
        }
        let (low, high) = (*SCALE_LOG.start(), *SCALE_LOG.end());
        let scales = gaussians.scales_log[i].to_array();
        bytes.extend(scales.map(|s| share((s - low) / (high - low), 255.0) as u8));
        // Those without a rotation were left out above.
        let [x, y, z] = rotation(gaussians.rotations_wxyz[i]).unwrap_or_default();
        bytes.extend([x, y, z].map(|q| (127.0 * q).round() as i8 as u8));
        let at = i * gaussians.n_sh() * 3;
        let dc = Vec3::from_slice(&gaussians.sh[at..at + 3]);
        let rgb = (Vec3::splat(0.5) + SH_0 as f32 * dc).to_array();
        bytes.extend(rgb.map(|c| share(c, 255.0) as u8));
        bytes.push(share(opacity(i), 255.0) as u8);
    }
    bytes
}

/// `value` in [0, 1] as a whole share of `steps`; what is outside is clamped, NaN is 0.
fn share(value: f32, steps: f32) -> u16 {
    (value.clamp(0.0, 1.0) * steps).round() as u16
}

/// x, y, z of the unit quaternion with a w that is not negative; None for no rotation.
fn rotation(wxyz: [f32; 4]) -> Option<[f32; 3]> {
    let [w, x, y, z] = wxyz;
    let length = wxyz.iter().map(|q| q * q).sum::<f32>().sqrt();
    let unit = if w < 0.0 { -1.0 } else { 1.0 } / length;
    (length.is_finite() && length > 1e-12).then(|| [x, y, z].map(|q| q * unit))
}
