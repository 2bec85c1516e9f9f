//! This module writes and reads `.spz` files: Niantic's compressed format, version 2, a tenth of a PLY or
//! less.
//!
//! A gzip stream of a header of 16 bytes and then, each for all Gaussians: means as 24-bit fixed
//! point, opacities, colours of degree 0, scales, rotations (x, y, z of the unit quaternion with
//! w >= 0) and the other SH coefficients, as u8. x right, y up, z back (RUB), where a 3DGS PLY has
//! x right, y down, z forward. <https://github.com/nianticlabs/spz>

mod fit;
mod read;

pub use read::read_spz;

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::{Gaussians, SH_0};
use crate::camera::Similarity;
use crate::error::{Error, Result};
use crate::files::write_file;
use fit::{Grid, fit};

const MAGIC: u32 = 0x5053_474e;
const VERSION: u32 = 2;

/// Largest magnitude of a 24-bit coordinate.
const MAX_FIXED: f64 = 8_388_607.0;

/// Share of the stored range that 1 of degree 0's coefficient takes.
const COLOR_SCALE: f32 = 0.15;

/// Steps of 1/128 to which SH coefficients are rounded: 3 bits less of 8 for degree 1, 4 for
/// the others, so that they compress.
const SH_STEP: [i32; 2] = [8, 16];

/// Sign of every SH coefficient but the first where y and z change theirs.
const SH_SIGN: [f32; 15] = [
    -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0,
];

/// Natural logarithms of the scales that a byte holds, in steps of 1/16.
const SCALE_LOG: std::ops::RangeInclusive<f32> = -10.0..=5.9375;

/// A size counts as cut off where it is by more than this, in per cent of the Gaussian's largest:
/// rounding to steps of 1/16 of its logarithm takes 3.
const MAX_SIZE_ERROR: f32 = 5.0;

/// Writes all that is finite and visible, in the frame that it is in, or that frame times a power
/// of 2 where its numbers would not fit; returns their number. What becomes of what the format
/// cannot hold as it is goes to `warnings`.
///
/// # Errors
/// What keeps the file from being written.
pub fn write_spz(path: &Path, gaussians: &Gaussians, warnings: &mut Vec<String>) -> Result<usize> {
    let mut chosen = gaussians.heaviest(gaussians.len());
    let grid = fit(gaussians, &mut chosen, warnings);
    warnings.extend(losses(gaussians, &chosen, grid));
    let bytes = packed(gaussians, &chosen, grid).map_err(|e| e.at_path(path))?;
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    let zipped = encoder.write_all(&bytes).and_then(|()| encoder.finish());
    let zipped = zipped.map_err(|e| Error::new(format!("cannot compress: {e}")).at_path(path))?;
    write_file(path, &zipped)?;
    Ok(chosen.len())
}

/// Returns how [`write_spz`] moves the frame of these Gaussians.
pub fn moved(gaussians: &Gaussians) -> Similarity {
    let mut chosen = gaussians.heaviest(gaussians.len());
    let grid = fit(gaussians, &mut chosen, &mut Vec::new());
    let scale = f64::from(grid.scale_log()).exp();
    Similarity {
        scale,
        translation: -scale * grid.origin,
        ..Similarity::IDENTITY
    }
}

/// Lists what is stored as something else than it is by more than rounding: for each kind of value
/// the share of the Gaussians and the largest difference.
fn losses(gaussians: &Gaussians, chosen: &[usize], grid: Grid) -> Vec<String> {
    let n_sh = 3 * gaussians.n_sh();
    let clamped = |value: f32, low: f32, high: f32| (value - value.clamp(low, high)).abs();
    let size = |i: usize| {
        let held = |s: f32| {
            let log = s + grid.scale_log();
            (log.exp() - log.clamp(*SCALE_LOG.start(), *SCALE_LOG.end()).exp()).abs()
        };
        let scales = gaussians.scales_log[i];
        let largest = (scales.max_element() + grid.scale_log()).exp();
        let off = scales.to_array().map(held).into_iter().fold(0.0, f32::max);
        100.0 * off / largest.max(SCALE_LOG.start().exp())
    };
    // A colour is 0.5 + SH_0 times its coefficient.
    let color = |i: usize| {
        let reach = 0.5 / COLOR_SCALE;
        let off = |c: &f32| SH_0 as f32 * clamped(*c, -reach, reach);
        gaussians.sh[i * n_sh..][..3]
            .iter()
            .map(off)
            .fold(0.0, f32::max)
    };
    let rest = |i: usize| {
        let off = |c: &f32| clamped(*c, -1.0, 1.0);
        gaussians.sh[i * n_sh..][3..n_sh]
            .iter()
            .map(off)
            .fold(0.0, f32::max)
    };
    let told = |of: &dyn Fn(usize) -> f32, least: f32, what: &str, unit: &str| {
        let off = chosen.iter().map(|i| of(*i)).filter(|off| *off > least);
        let (n, most) = off.fold((0, 0.0_f32), |(n, most), off| (n + 1, most.max(off)));
        (n > 0).then(|| {
            let share = 100.0 * n as f64 / chosen.len() as f64;
            format!(
                "{what} of {share:.2} % of the Gaussians are cut off, by up to {most:.2} {unit}"
            )
        })
    };
    [
        told(&size, MAX_SIZE_ERROR, "sizes", "% of their largest"),
        told(&color, 1.0 / 255.0, "colours", "(white is 1)"),
        told(
            &rest,
            1.0 / 128.0,
            "coefficients of view-dependent colour",
            "(most is 1)",
        ),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Packs the stream before it is compressed.
fn packed(gaussians: &Gaussians, chosen: &[usize], grid: Grid) -> Result<Vec<u8>> {
    let n_sh = 3 * gaussians.n_sh();
    let mut bytes = Vec::with_capacity(16 + chosen.len() * (16 + n_sh));
    let count = u32::try_from(chosen.len())
        .map_err(|_| Error::new("more than 2^32 Gaussians do not fit a .spz file"))?;
    for word in [MAGIC, VERSION, count] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend([gaussians.sh_degree as u8, grid.fraction_bits as u8, 0, 0]);

    let unit = grid.steps_a_unit();
    for &i in chosen {
        let [x, y, z] = (gaussians.means[i].as_dvec3() - grid.origin).to_array();
        for value in [x, -y, -z] {
            bytes.extend(&((value * unit).round() as i32).to_le_bytes()[..3]);
        }
    }
    bytes.extend(chosen.iter().map(|i| byte(255.0 * gaussians.opacity(*i))));
    for &i in chosen {
        let color = gaussians.sh[i * n_sh..][..3].iter();
        bytes.extend(color.map(|c| byte(255.0 * (COLOR_SCALE * c + 0.5))));
    }
    for &i in chosen {
        let scales = gaussians.scales_log[i].to_array();
        bytes.extend(scales.map(|s| byte(16.0 * (s + grid.scale_log() + 10.0))));
    }
    for &i in chosen {
        let [_, x, y, z] = gaussians.rotation(i).unwrap_or([1.0, 0.0, 0.0, 0.0]);
        bytes.extend([x, -y, -z].map(|q| byte(127.5 * (q + 1.0))));
    }
    for &i in chosen {
        let rest = gaussians.sh[i * n_sh..][3..n_sh].chunks_exact(3);
        for (k, (rgb, sign)) in rest.zip(SH_SIGN).enumerate() {
            let step = SH_STEP[usize::from(k >= 3)];
            bytes.extend(rgb.iter().map(|c| sh_byte(sign * c, step)));
        }
    }
    Ok(bytes)
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

fn sh_byte(coefficient: f32, step: i32) -> u8 {
    let level = (coefficient * 128.0).round().clamp(-128.0, 127.0) as i32 + 128;
    ((level + step / 2).div_euclid(step) * step).clamp(0, 255) as u8
}
