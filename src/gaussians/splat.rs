//! This module writes `.splat` files: 32 bytes a Gaussian, for viewers on the web.
//!
//! Mean and scales as six f32; red, green, blue and opacity as u8, the colour that of degree 0;
//! the unit rotation w, x, y, z as u8, `128 + 128 q`. Little-endian, no header, those of most
//! weight first, as such viewers draw what has arrived.

use std::path::Path;

use super::Gaussians;
use crate::error::Result;
use crate::files::write_file;

/// Writes all that is finite and visible, in the frame that it is in; returns their number.
///
/// # Errors
/// What keeps the file from being written.
pub fn write_splat(path: &Path, gaussians: &Gaussians, _: &mut Vec<String>) -> Result<usize> {
    let chosen = gaussians.heaviest(gaussians.len());
    let mut bytes = Vec::with_capacity(32 * chosen.len());
    for &i in &chosen {
        let scales = gaussians.scales_log[i].to_array().map(f32::exp);
        for value in gaussians.means[i].to_array().into_iter().chain(scales) {
            bytes.extend(value.to_le_bytes());
        }
        let [r, g, b] = gaussians.base_color(i).to_array();
        bytes.extend(
            [r, g, b, gaussians.opacity(i)].map(|v| (255.0 * v.clamp(0.0, 1.0)).round() as u8),
        );
        let rotation = gaussians.rotation(i).unwrap_or([1.0, 0.0, 0.0, 0.0]);
        bytes.extend(rotation.map(|q| (128.0 + 128.0 * q).round().clamp(0.0, 255.0) as u8));
    }
    write_file(path, &bytes)?;
    Ok(chosen.len())
}
