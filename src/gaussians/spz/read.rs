//! This module reads `.spz` files of the version that [`super::write_spz`] writes.

use std::io::Read;
use std::path::Path;

use flate2::read::GzDecoder;
use glam::Vec3;

use super::{COLOR_SCALE, MAGIC, SH_SIGN, VERSION};
use crate::error::{Error, Result};
use crate::files::read_file;
use crate::gaussians::{Gaussians, MAX_SH_DEGREE, n_sh};

const HEADER_BYTES: usize = 16;

/// Reads Gaussians, in the file's own frame but with 3DGS's axes.
///
/// # Errors
/// No such file, or one that ends too early.
pub fn read_spz(path: &Path) -> Result<Gaussians> {
    let mut bytes = Vec::new();
    GzDecoder::new(read_file(path)?.as_slice())
        .read_to_end(&mut bytes)
        .map_err(|e| Error::new(format!("cannot be unpacked: {e}")).at_path(path))?;
    read(&bytes).map_err(|e| e.at_path(path))
}

fn read(bytes: &[u8]) -> Result<Gaussians> {
    let refused = |what: String| Err(Error::new(what).way_out("export the file again"));
    let Some((header, rest)) = bytes.split_at_checked(HEADER_BYTES) else {
        return refused("truncated: no whole header".to_owned());
    };
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| header[at + i]));
    if word(0) != MAGIC || word(4) != VERSION {
        return refused(format!("not a .spz file of version {VERSION}"));
    }
    let (n, degree) = (word(8) as usize, u32::from(header[12]));
    if degree > MAX_SH_DEGREE {
        return refused(format!("SH degree {degree} is not 0 to 3"));
    }
    let n_rest = 3 * (n_sh(degree) - 1);
    if rest.len() / (19 + n_rest) < n {
        return refused(format!("truncated: {n} Gaussians are announced"));
    }
    let unit = f64::from(-i32::from(header[13])).exp2();
    let (means, rest) = rest.split_at(9 * n);
    let (opacities, rest) = rest.split_at(n);
    let (colors, rest) = rest.split_at(3 * n);
    let (scales, rest) = rest.split_at(3 * n);
    let (rotations, rest) = rest.split_at(3 * n);
    let mut gaussians = Gaussians {
        sh_degree: degree,
        ..Gaussians::default()
    };
    for i in 0..n {
        let fixed = |axis: usize| {
            let b = &means[9 * i + 3 * axis..];
            let whole = i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8;
            (f64::from(whole) * unit) as f32
        };
        gaussians
            .means
            .push(Vec3::new(fixed(0), -fixed(1), -fixed(2)));
        let opacity = f32::from(opacities[i]) / 255.0;
        gaussians
            .opacity_logits
            .push((opacity / (1.0 - opacity)).ln());
        let scale = |axis: usize| f32::from(scales[3 * i + axis]) / 16.0 - 10.0;
        gaussians
            .scales_log
            .push(Vec3::new(scale(0), scale(1), scale(2)));
        let [x, y, z] = [0, 1, 2].map(|k| f32::from(rotations[3 * i + k]) / 127.5 - 1.0);
        let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
        gaussians.rotations_wxyz.push([w, x, -y, -z]);
        let color = |c: usize| (f32::from(colors[3 * i + c]) / 255.0 - 0.5) / COLOR_SCALE;
        gaussians.sh.extend([0, 1, 2].map(color));
        for (rgb, sign) in rest[n_rest * i..][..n_rest].chunks_exact(3).zip(SH_SIGN) {
            let values = rgb.iter().map(|c| sign * (f32::from(*c) - 128.0) / 128.0);
            gaussians.sh.extend(values);
        }
    }
    Ok(gaussians)
}
