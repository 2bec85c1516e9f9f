//! This module writes glTF files of Gaussians, by the extension `KHR_gaussian_splatting`.
//!
//! A mesh of points, with attributes of each Gaussian: its mean, its rotation as a unit quaternion
//! x, y, z, w, its standard deviations, its opacity, and every SH coefficient, in sRGB's levels;
//! all f32. Programs that do not know the extension show the points in the colours of degree 0.
//! glTF has y up and z towards the viewer. <https://github.com/KhronosGroup/glTF>

use std::path::Path;

use serde_json::json;

use super::{Gaussians, n_sh};
use crate::error::Result;
use crate::files::gltf::{Gltf, Mode};

const EXTENSION: &str = "KHR_gaussian_splatting";

/// Writes all that is finite and visible, in the frame that it is in, as `.glb`, or as `.gltf` if
/// the path says so; returns their number.
///
/// # Errors
/// What keeps the file from being written.
pub fn write_gltf(path: &Path, gaussians: &Gaussians, _: &mut Vec<String>) -> Result<usize> {
    let chosen = gaussians.heaviest(gaussians.len());
    let mut file = Gltf::default();
    let name = |of: &str| format!("{EXTENSION}:{of}");
    let means: Vec<[f32; 3]> = chosen
        .iter()
        .map(|i| gaussians.means[*i].to_array())
        .collect();
    file.positions(&means);
    let colors = chosen.iter().map(|i| {
        let [r, g, b] = gaussians.base_color(*i).to_array();
        [r, g, b, gaussians.opacity(*i)]
    });
    file.colors(&colors.collect::<Vec<_>>());
    let rotations = chosen.iter().map(|i| {
        let [w, x, y, z] = gaussians.rotation(*i).unwrap_or([1.0, 0.0, 0.0, 0.0]);
        [x, y, z, w]
    });
    file.floats(&name("ROTATION"), &rotations.collect::<Vec<_>>());
    let scales = chosen
        .iter()
        .map(|i| gaussians.scales_log[*i].to_array().map(f32::exp));
    file.floats(&name("SCALE"), &scales.collect::<Vec<_>>());
    let opacities = chosen.iter().map(|i| [gaussians.opacity(*i)]);
    file.floats(&name("OPACITY"), &opacities.collect::<Vec<_>>());
    let n = gaussians.n_sh();
    for degree in 0..=gaussians.sh_degree {
        let first = degree.checked_sub(1).map_or(0, n_sh);
        for k in first..n_sh(degree) {
            let own = chosen.iter().map(|i| {
                let at = 3 * (i * n + k);
                [gaussians.sh[at], gaussians.sh[at + 1], gaussians.sh[at + 2]]
            });
            let name = name(&format!("SH_DEGREE_{degree}_COEF_{}", k - first));
            file.floats(&name, &own.collect::<Vec<_>>());
        }
    }
    let splats = json!({
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    });
    let primitive = json!({"extensions": {EXTENSION: splats}});
    let top = json!({"extensionsUsed": [EXTENSION]});
    file.write(path, Mode::Points, primitive, top)?;
    Ok(chosen.len())
}
