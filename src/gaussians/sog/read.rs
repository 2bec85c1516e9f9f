//! This module reads `.sog` files.

use std::path::Path;

use glam::Vec3;
use image::ImageFormat;

use super::{ENTRIES_A_ROW, LARGEST_IS_W, Meta, VERSION, without_log};
use crate::error::{Error, Result};
use crate::files::read_file;
use crate::files::zip::unpacked;
use crate::gaussians::{Gaussians, MAX_SH_DEGREE, n_sh};

/// Reads Gaussians, in the file's own frame.
///
/// # Errors
/// No such file, or one that does not hold what its `meta.json` says.
pub fn read_sog(path: &Path) -> Result<Gaussians> {
    let bytes = read_file(path)?;
    read(&bytes).map_err(|e| e.at_path(path))
}

fn read(bytes: &[u8]) -> Result<Gaussians> {
    let meta: Meta = serde_json::from_slice(unpacked(bytes, "meta.json")?)
        .map_err(|e| Error::new(format!("not as version 2 has it: {e}")).at("meta.json"))?;
    if meta.version != VERSION {
        return Err(Error::new(format!("version {} is not 2", meta.version)).at("meta.json"));
    }
    let degree = meta.rest.as_ref().map_or(0, |rest| rest.bands);
    if degree > MAX_SH_DEGREE {
        return Err(Error::new(format!("SH degree {degree} is not 0 to 3")).at("meta.json"));
    }
    let image = |name: &str| pixels(bytes, name, meta.count);
    let [low, high] = [&meta.means.files[0], &meta.means.files[1]];
    let (low, high) = (image(low)?, image(high)?);
    let scales = image(&meta.scales.files[0])?;
    let rotations = image(&meta.quats.files[0])?;
    let colors = image(&meta.sh0.files[0])?;
    let rest = match &meta.rest {
        None => None,
        Some(rest) => {
            let labels = image(&rest.files[1])?;
            Some((rest, labels, pixels(bytes, &rest.files[0], 0)?))
        }
    };
    let mut gaussians = Gaussians {
        sh_degree: degree,
        ..Gaussians::default()
    };
    let code = |codebook: &[f32], byte: u8| codebook.get(usize::from(byte)).copied().unwrap_or(0.0);
    let n_rest = n_sh(degree) - 1;
    for i in 0..meta.count {
        let along = |axis: usize| {
            let step = u16::from_le_bytes([low[i][axis], high[i][axis]]);
            let (least, most) = (meta.means.mins[axis], meta.means.maxs[axis]);
            without_log(least + (most - least) * f32::from(step) / 65535.0)
        };
        gaussians
            .means
            .push(Vec3::new(along(0), along(1), along(2)));
        let scale = |axis: usize| code(&meta.scales.codebook, scales[i][axis]);
        gaussians
            .scales_log
            .push(Vec3::new(scale(0), scale(1), scale(2)));
        gaussians.rotations_wxyz.push(rotation(rotations[i]));
        let opacity = f32::from(colors[i][3]) / 255.0;
        gaussians
            .opacity_logits
            .push((opacity / (1.0 - opacity)).ln());
        gaussians
            .sh
            .extend([0, 1, 2].map(|c| code(&meta.sh0.codebook, colors[i][c])));
        if let Some((rest, labels, entries)) = &rest {
            let label = usize::from(u16::from_le_bytes([labels[i][0], labels[i][1]]));
            let row = ENTRIES_A_ROW * n_rest;
            let first = (label / ENTRIES_A_ROW) * row + (label % ENTRIES_A_ROW) * n_rest;
            for k in 0..n_rest {
                let entry = entries.get(first + k).copied().unwrap_or_default();
                gaussians
                    .sh
                    .extend([0, 1, 2].map(|c| code(&rest.codebook, entry[c])));
            }
        }
    }
    Ok(gaussians)
}

fn rotation([a, b, c, largest]: [u8; 4]) -> [f32; 4] {
    let Some(largest) = largest.checked_sub(LARGEST_IS_W) else {
        return [1.0, 0.0, 0.0, 0.0];
    };
    let mut q = [0.0; 4];
    let others = (0..4).filter(|k| *k != usize::from(largest));
    for (k, byte) in others.zip([a, b, c]) {
        q[k] = (f32::from(byte) / 127.5 - 1.0) * std::f32::consts::FRAC_1_SQRT_2;
    }
    let squares: f32 = q.iter().map(|v| v * v).sum();
    q[usize::from(largest)] = (1.0 - squares).max(0.0).sqrt();
    q
}

/// Decodes an image; refuses one of fewer than `least` pixels.
fn pixels(archive: &[u8], name: &str, least: usize) -> Result<Vec<[u8; 4]>> {
    let image = image::load_from_memory_with_format(unpacked(archive, name)?, ImageFormat::WebP)
        .map_err(|e| Error::new(format!("cannot be read as WebP: {e}")).at(name))?;
    let rgba = image.into_rgba8().into_raw();
    let (pixels, _) = rgba.as_chunks::<4>();
    if pixels.len() < least {
        let n = pixels.len();
        return Err(Error::new(format!("has {n} pixels for {least} Gaussians")).at(name));
    }
    Ok(pixels.to_vec())
}
