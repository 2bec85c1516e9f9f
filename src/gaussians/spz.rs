//! `.spz` files: Niantic's compressed format, version 2, a tenth of a PLY or less.
//!
//! A gzip stream of a header of 16 bytes and then, each for all Gaussians: means as 24-bit fixed
//! point, opacities, colours of degree 0, scales, rotations (x, y, z of the unit quaternion with
//! w >= 0) and the other SH coefficients, as u8. x right, y up, z back (RUB), where a 3DGS PLY has
//! x right, y down, z forward. <https://github.com/nianticlabs/spz>

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::Gaussians;
use crate::error::{Error, Result};
use crate::files::write_file;

const MAGIC: u32 = 0x5053_474e;
const VERSION: u32 = 2;

/// Largest magnitude of a 24-bit coordinate.
const MAX_FIXED: f32 = 8_388_607.0;

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

/// Share of the Gaussians that must lie within the file's reach; what lies farther is left out where
/// it would make the positions of the others coarse.
const WITHIN: f64 = 0.999;
/// Share of the Gaussians that may be smaller than the step of their positions.
const MAX_COARSE: f64 = 0.01;

/// Writes all that is finite and visible, in the frame that it is in; returns their number. What the
/// format cannot hold as it is goes to `warnings`.
///
/// # Errors
/// Means beyond 2^23 units, or what keeps the file from being written.
pub fn write_spz(path: &Path, gaussians: &Gaussians, warnings: &mut Vec<String>) -> Result<usize> {
    let mut chosen = gaussians.heaviest(gaussians.len());
    fit(gaussians, &mut chosen, warnings);
    let bytes = packed(gaussians, &chosen).map_err(|e| e.at_path(path))?;
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    let zipped = encoder.write_all(&bytes).and_then(|()| encoder.finish());
    let zipped = zipped.map_err(|e| Error::new(format!("cannot compress: {e}")).at_path(path))?;
    write_file(path, &zipped)?;
    Ok(chosen.len())
}

/// The stream before it is compressed.
fn packed(gaussians: &Gaussians, chosen: &[usize]) -> Result<Vec<u8>> {
    let n_sh = 3 * gaussians.n_sh();
    let mut bytes = Vec::with_capacity(16 + chosen.len() * (16 + n_sh));
    let count = u32::try_from(chosen.len())
        .map_err(|_| Error::new("more than 2^32 Gaussians do not fit a .spz file"))?;
    let fraction_bits = fraction_bits(gaussians, chosen)?;
    for word in [MAGIC, VERSION, count] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend([gaussians.sh_degree as u8, fraction_bits, 0, 0]);

    let unit = f32::from(fraction_bits).exp2();
    for &i in chosen {
        let [x, y, z] = gaussians.means[i].to_array();
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
        bytes.extend(scales.map(|s| byte(16.0 * (s + 10.0))));
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

/// Leaves out of `chosen` what is so far that the others' positions would be coarse, and tells what
/// rounding does to those that stay.
fn fit(gaussians: &Gaussians, chosen: &mut Vec<usize>, warnings: &mut Vec<String>) {
    let reach = |i: &usize| gaussians.means[*i].abs().max_element();
    let size = |i: &usize| gaussians.scales_log[*i].max_element().exp();
    let coarse = |chosen: &[usize]| {
        let step = fraction_bits(gaussians, chosen).map_or(1.0, |b| (-f32::from(b)).exp2());
        let n = chosen.iter().filter(|i| size(i) < step).count();
        (n as f64 / chosen.len().max(1) as f64, step)
    };
    if coarse(chosen).0 > MAX_COARSE {
        let mut reaches: Vec<f32> = chosen.iter().map(reach).collect();
        reaches.sort_unstable_by(f32::total_cmp);
        let last = (WITHIN * (reaches.len() - 1) as f64).round() as usize;
        let near: Vec<usize> = chosen
            .iter()
            .copied()
            .filter(|i| reach(i) <= reaches[last])
            .collect();
        if coarse(&near).1 < coarse(chosen).1 {
            warnings.push(format!(
                "{} Gaussians beyond {} units are left out: with them a .spz file would round all positions \
                 to steps of {}",
                chosen.len() - near.len(),
                reaches[last],
                coarse(chosen).1
            ));
            *chosen = near;
        }
    }
    let (share, step) = coarse(chosen);
    if share > MAX_COARSE {
        warnings.push(format!(
            "a .spz file rounds these positions to steps of {step}, and {:.1} % of the Gaussians are \
             smaller: scale the scene down, or export .splat",
            100.0 * share
        ));
    }
    let cut = |i: &&usize| {
        let scales = gaussians.scales_log[**i];
        // Less than nothing is nothing.
        scales.max_element() > *SCALE_LOG.end() || scales.max_element() < *SCALE_LOG.start()
    };
    let n_cut = chosen.iter().filter(cut).count();
    if n_cut > 0 {
        warnings.push(format!(
            "a .spz file holds sizes from {:.1e} to {:.0} units: those of {:.1} % of the Gaussians are cut off; \
             scale the scene, or export .splat",
            SCALE_LOG.start().exp(),
            SCALE_LOG.end().exp(),
            100.0 * n_cut as f64 / chosen.len() as f64
        ));
    }
}

/// As many bits behind the point as leave room for the farthest mean.
fn fraction_bits(gaussians: &Gaussians, chosen: &[usize]) -> Result<u8> {
    let coordinates = chosen
        .iter()
        .map(|i| gaussians.means[*i].abs().max_element());
    let farthest = coordinates.fold(0.0, f32::max);
    let fits = |bits: &u8| farthest * f32::from(*bits).exp2() <= MAX_FIXED;
    (0..=20).rev().find(fits).ok_or_else(|| {
        Error::new(format!(
            "a Gaussian lies at {farthest}, but a .spz file reaches {MAX_FIXED} units"
        ))
        .way_out("scale the scene down")
    })
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

fn sh_byte(coefficient: f32, step: i32) -> u8 {
    let level = (coefficient * 128.0).round().clamp(-128.0, 127.0) as i32 + 128;
    ((level + step / 2).div_euclid(step) * step).clamp(0, 255) as u8
}
