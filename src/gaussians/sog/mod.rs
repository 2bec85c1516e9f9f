//! This module writes and reads `.sog` files: the compact format of `PlayCanvas` for the web, version 2.
//!
//! A zip archive of `meta.json` and lossless WebP images, in which one pixel of each belongs to a
//! Gaussian: means as 16 bits of the logarithm of 1 + |x|, the low and the high ones apart; scales and
//! colours of degree 0 as numbers of 256 values that fit them best; rotations without the largest
//! component, whose number is the alpha channel; and for the other SH coefficients the number of an
//! entry in a palette. Neighbours in space are neighbours in the images, which compresses.
//! <https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog>

mod codebook;
mod palette;
mod read;

pub use read::read_sog;

use std::path::Path;

use glam::Vec3;
use image::codecs::webp::WebPEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde::{Deserialize, Serialize};

use super::Gaussians;
use crate::error::{Error, Result};
use crate::files::write_file;
use crate::files::zip::Zip;
use codebook::Codebook;
use palette::Palette;

const VERSION: u32 = 2;

/// Gaussians for each entry of the palette.
const GAUSSIANS_AN_ENTRY: usize = 8;
/// Most entries of the palette: two bytes say which.
const MOST_ENTRIES: usize = 1 << 16;
/// Entries in a row of the palette's image.
const ENTRIES_A_ROW: usize = 64;
/// Alpha of a rotation whose w is largest; x, y and z follow.
const LARGEST_IS_W: u8 = 252;
/// Logarithm of a scale that stands for none.
const LEAST_SCALE_LOG: f32 = -30.0;

/// `meta.json`.
#[derive(Serialize, Deserialize)]
struct Meta {
    version: u32,
    count: usize,
    means: Bounds,
    scales: Coded,
    quats: Files,
    sh0: Coded,
    #[serde(rename = "shN", default, skip_serializing_if = "Option::is_none")]
    rest: Option<Rest>,
}

#[derive(Serialize, Deserialize)]
struct Bounds {
    mins: [f32; 3],
    maxs: [f32; 3],
    files: [String; 2],
}

#[derive(Serialize, Deserialize)]
struct Coded {
    codebook: Vec<f32>,
    files: [String; 1],
}

#[derive(Serialize, Deserialize)]
struct Files {
    files: [String; 1],
}

#[derive(Serialize, Deserialize)]
struct Rest {
    count: usize,
    bands: u32,
    codebook: Vec<f32>,
    files: [String; 2],
}

/// Writes all that is finite and visible, in the frame that it is in; returns their number.
///
/// # Errors
/// What keeps the file from being written.
pub fn write_sog(path: &Path, gaussians: &Gaussians, _: &mut Vec<String>) -> Result<usize> {
    let mut chosen = gaussians.heaviest(gaussians.len());
    let bounds = Extent::of(gaussians, &chosen);
    chosen.sort_by_key(|i| bounds.place_along_curve(gaussians.means[*i]));
    let mut archive = Archive::new(chosen.len());
    let packed = pack(gaussians, &chosen, &mut archive).and_then(|meta| archive.finish(&meta));
    write_file(path, &packed.map_err(|e| e.at_path(path))?)?;
    Ok(chosen.len())
}

fn pack(gaussians: &Gaussians, chosen: &[usize], archive: &mut Archive) -> Result<Meta> {
    let means = pack_means(gaussians, chosen, archive)?;
    let scale = |i: &usize| {
        gaussians.scales_log[*i]
            .max(Vec3::splat(LEAST_SCALE_LOG))
            .to_array()
    };
    let scales: Vec<[f32; 3]> = chosen.iter().map(scale).collect();
    let codebook = Codebook::of(scales.as_flattened());
    let pixels = scales.iter().map(|scale| {
        let [x, y, z] = scale.map(|s| codebook.nearest(s));
        [x, y, z, 255]
    });
    archive.add("scales.webp", pixels)?;
    let scales = Coded {
        codebook: codebook.values,
        files: ["scales.webp".to_owned()],
    };
    archive.add("quats.webp", chosen.iter().map(|i| rotation(gaussians, *i)))?;
    let quats = Files {
        files: ["quats.webp".to_owned()],
    };
    let n_sh = 3 * gaussians.n_sh();
    let color = |i: &usize| &gaussians.sh[i * n_sh..][..3];
    let colors: Vec<f32> = chosen.iter().flat_map(color).copied().collect();
    let codebook = Codebook::of(&colors);
    let pixels = chosen.iter().map(|i| {
        let at = |c: usize| codebook.nearest(color(i)[c]);
        [at(0), at(1), at(2), byte(gaussians.opacity(*i))]
    });
    archive.add("sh0.webp", pixels)?;
    Ok(Meta {
        version: VERSION,
        count: chosen.len(),
        means,
        scales,
        quats,
        sh0: Coded {
            codebook: codebook.values,
            files: ["sh0.webp".to_owned()],
        },
        rest: match gaussians.sh_degree {
            0 => None,
            _ => Some(pack_rest(gaussians, chosen, archive)?),
        },
    })
}

fn pack_means(gaussians: &Gaussians, chosen: &[usize], archive: &mut Archive) -> Result<Bounds> {
    let logs: Vec<Vec3> = chosen
        .iter()
        .map(|i| Vec3::from_array(gaussians.means[*i].to_array().map(log_of)))
        .collect();
    let least = logs.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let most = logs.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    let steps = |log: &Vec3| {
        let along = |axis: usize| {
            let span = f64::from(most[axis]) - f64::from(least[axis]);
            let share = (f64::from(log[axis]) - f64::from(least[axis])) / span;
            // The share is NaN if all are at one place, and becomes 0.
            (65535.0 * share).round() as u16
        };
        [along(0), along(1), along(2)]
    };
    let steps: Vec<[u16; 3]> = logs.iter().map(steps).collect();
    for (name, half) in [("means_l.webp", 0), ("means_u.webp", 1)] {
        let pixels = steps.iter().map(|step| {
            let [x, y, z] = step.map(|s| s.to_le_bytes()[half]);
            [x, y, z, 255]
        });
        archive.add(name, pixels)?;
    }
    Ok(Bounds {
        mins: least.to_array(),
        maxs: most.to_array(),
        files: ["means_l.webp", "means_u.webp"].map(str::to_owned),
    })
}

fn pack_rest(gaussians: &Gaussians, chosen: &[usize], archive: &mut Archive) -> Result<Rest> {
    let n_sh = 3 * gaussians.n_sh();
    let rest = chosen
        .iter()
        .flat_map(|i| &gaussians.sh[i * n_sh..][3..n_sh]);
    let rest: Vec<f32> = rest.copied().collect();
    let n_entries = (chosen.len() / GAUSSIANS_AN_ENTRY).clamp(1, MOST_ENTRIES);
    let palette = Palette::of(&rest, n_sh - 3, n_entries);
    let codebook = Codebook::of(&palette.entries);
    let (coefficients, _) = palette.entries.as_chunks::<3>();
    let pixels = coefficients.iter().map(|rgb| {
        let [r, g, b] = rgb.map(|c| codebook.nearest(c));
        [r, g, b, 255]
    });
    let count = palette.entries.len() / (n_sh - 3);
    let size = (
        ENTRIES_A_ROW * (n_sh / 3 - 1),
        count.div_ceil(ENTRIES_A_ROW),
    );
    archive.add_sized("shN_centroids.webp", pixels, size)?;
    let labels = palette.labels.iter().map(|label| {
        let [low, high] = (*label as u16).to_le_bytes();
        [low, high, 0, 255]
    });
    archive.add("shN_labels.webp", labels)?;
    Ok(Rest {
        count,
        bands: gaussians.sh_degree,
        codebook: codebook.values,
        files: ["shN_centroids.webp", "shN_labels.webp"].map(str::to_owned),
    })
}

/// Returns the three smaller components, from -1 to 1 over the square root of 2, and which is not
/// there; the larger one is positive.
fn rotation(gaussians: &Gaussians, i: usize) -> [u8; 4] {
    let q = gaussians.rotation(i).unwrap_or([1.0, 0.0, 0.0, 0.0]);
    let largest = (0..4)
        .max_by(|a, b| q[*a].abs().total_cmp(&q[*b].abs()))
        .unwrap_or(0);
    let sign = q[largest].signum();
    let mut pixel = [0, 0, 0, LARGEST_IS_W + largest as u8];
    let others = (0..4).filter(|k| *k != largest);
    for (byte_of, k) in pixel.iter_mut().zip(others) {
        *byte_of = byte(0.5 + sign * q[k] * std::f32::consts::FRAC_1_SQRT_2);
    }
    pixel
}

fn byte(share: f32) -> u8 {
    (255.0 * share).round().clamp(0.0, 255.0) as u8
}

/// Returns what means are stored as: near the origin as they are, far away their logarithm.
fn log_of(x: f32) -> f32 {
    x.signum() * x.abs().ln_1p()
}

/// Undoes [`log_of`].
fn without_log(x: f32) -> f32 {
    x.signum() * x.abs().exp_m1()
}

/// A box around means.
struct Extent {
    least: Vec3,
    sides: Vec3,
}

impl Extent {
    fn of(gaussians: &Gaussians, chosen: &[usize]) -> Extent {
        let means = || chosen.iter().map(|i| gaussians.means[*i]);
        let least = means().fold(Vec3::INFINITY, Vec3::min);
        let most = means().fold(Vec3::NEG_INFINITY, Vec3::max);
        Extent {
            least,
            sides: most - least,
        }
    }

    /// Returns the place on Morton's curve, of 2^10 steps an axis.
    fn place_along_curve(&self, p: Vec3) -> u32 {
        let share = (p - self.least) / self.sides;
        let steps = share.to_array().map(|s| (1023.0 * s) as u32);
        let bits = (0..10).flat_map(|bit| (0..3).map(move |axis| (bit, axis)));
        bits.fold(0, |code, (bit, axis)| {
            code | (((steps[axis] >> bit) & 1) << (3 * bit + axis))
        })
    }
}

/// The files under way.
struct Archive {
    zip: Zip,
    /// Width and height of the images that have a pixel a Gaussian.
    size: (usize, usize),
}

impl Archive {
    /// Begins an archive for `n` Gaussians, with images about as high as wide in whole blocks of 4.
    fn new(n: usize) -> Archive {
        let width = ((n as f64).sqrt().ceil() as usize).next_multiple_of(4);
        Archive {
            zip: Zip::default(),
            size: (width, n.div_ceil(width).next_multiple_of(4)),
        }
    }

    fn add(&mut self, name: &str, pixels: impl Iterator<Item = [u8; 4]>) -> Result<()> {
        self.add_sized(name, pixels, self.size)
    }

    fn add_sized(
        &mut self,
        name: &str,
        pixels: impl Iterator<Item = [u8; 4]>,
        (width, height): (usize, usize),
    ) -> Result<()> {
        let mut rgba: Vec<u8> = pixels.flatten().collect();
        rgba.resize(4 * width * height, 0);
        let mut bytes = Vec::new();
        WebPEncoder::new_lossless(&mut bytes)
            .write_image(&rgba, width as u32, height as u32, ExtendedColorType::Rgba8)
            .map_err(|e| Error::new(format!("cannot encode as WebP: {e}")).at(name))?;
        self.zip.add(name, &bytes)
    }

    fn finish(mut self, meta: &Meta) -> Result<Vec<u8>> {
        let text = serde_json::to_vec(meta)
            .map_err(|e| Error::new(format!("cannot be written as JSON: {e}")).at("meta.json"))?;
        self.zip.add("meta.json", &text)?;
        self.zip.finish()
    }
}
