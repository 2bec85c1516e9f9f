//! This module writes and reads `.splat` files: 32 bytes a Gaussian, for viewers on the web.
//!
//! Mean and scales as six f32; red, green, blue and opacity as u8, the colour that of degree 0;
//! the unit rotation w, x, y, z as u8, `128 + 128 q`. Little-endian, no header, those of most
//! weight first, as such viewers draw what has arrived.

use std::path::Path;

use glam::Vec3;

use super::{Gaussians, SH_0};
use crate::error::{Error, Result};
use crate::files::{read_file, write_file};

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

/// Reads Gaussians, in the file's own frame.
///
/// # Errors
/// No such file, or one that is not of whole rows.
pub fn read_splat(path: &Path) -> Result<Gaussians> {
    let bytes = read_file(path)?;
    let (rows, rest) = bytes.as_chunks::<32>();
    if !rest.is_empty() {
        let what = format!("{} bytes are not rows of 32", bytes.len());
        return Err(Error::new(what).at_path(path));
    }
    let mut gaussians = Gaussians::default();
    for row in rows {
        let float = |k: usize| f32::from_le_bytes(std::array::from_fn(|i| row[4 * k + i]));
        gaussians
            .means
            .push(Vec3::new(float(0), float(1), float(2)));
        let scales = Vec3::new(float(3), float(4), float(5)).to_array();
        gaussians
            .scales_log
            .push(Vec3::from_array(scales.map(f32::ln)));
        let color = |c: usize| (f32::from(row[24 + c]) / 255.0 - 0.5) / SH_0 as f32;
        gaussians.sh.extend([0, 1, 2].map(color));
        let opacity = f32::from(row[27]) / 255.0;
        gaussians
            .opacity_logits
            .push((opacity / (1.0 - opacity)).ln());
        let turn = |k: usize| f32::from(row[28 + k]) / 128.0 - 1.0;
        gaussians.rotations_wxyz.push([0, 1, 2, 3].map(turn));
    }
    Ok(gaussians)
}
