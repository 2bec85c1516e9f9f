//! Reference cases from `../shared/fixtures`: Gaussians, cameras, reference renders and gradients.

use std::path::{Path, PathBuf};

use gspotential::doctor::twin::linalg::Vec3;
use gspotential::doctor::twin::model::{TwinCamera, TwinGaussians, TwinGradients};
use serde::Deserialize;

use super::npy::read_shaped;
use crate::kit::data::shared;

/// One case: Gaussians seen by some cameras.
pub(crate) struct Fixture {
    pub name: String,
    dir: PathBuf,
    gaussians: TwinGaussians,
    views: Vec<CameraEntry>,
    /// Tolerance by which the case's fragile masks were made.
    pub tolerance: f64,
}

/// One camera of a case with its reference arrays.
pub(crate) struct FixtureView {
    /// With the view's SH degree.
    pub gaussians: TwinGaussians,
    pub camera: TwinCamera,
    pub rgb: Vec<f64>,
    pub alpha: Vec<f64>,
    pub fragile: Vec<bool>,
    pub count: Vec<u32>,
    /// Weights of the loss `sum(d_rgb * rgb) + sum(d_alpha * alpha)`, 0 at fragile pixels.
    pub d_rgb: Vec<f64>,
    pub d_alpha: Vec<f64>,
    pub gradients: TwinGradients,
    /// `u, v, depth, A, B, C, cov_xx, cov_xy, cov_yy, r, g, b, opacity, valid` a Gaussian.
    pub projected: Vec<[f64; 14]>,
}

#[derive(Deserialize)]
struct CameraEntry {
    img_name: String,
    w2c: [[f64; 4]; 4],
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    near: f64,
    sh_degree: usize,
}

#[derive(Deserialize)]
struct Stats {
    tol: f64,
}

/// All cases, by name.
pub(crate) fn fixtures() -> Vec<Fixture> {
    let root = shared("fixtures");
    let entries = std::fs::read_dir(&root).expect("folder is readable");
    let mut dirs: Vec<PathBuf> = entries
        .map(|entry| entry.expect("folder is readable").path())
        .filter(|path| path.join("gaussians.ply").is_file())
        .collect();
    dirs.sort();
    assert!(!dirs.is_empty(), "no case with a gaussians.ply in {root:?}");
    dirs.iter().map(|dir| Fixture::load(dir)).collect()
}

fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> T {
    let text = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_slice(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

impl Fixture {
    fn load(dir: &Path) -> Self {
        let bytes = std::fs::read(dir.join("gaussians.ply")).expect("gaussians.ply is readable");
        let stats: Stats = read_json(&dir.join("stats.json"));
        Self {
            name: dir.file_name().expect("a case").to_string_lossy().into(),
            dir: dir.to_path_buf(),
            gaussians: parse_ply(&bytes).unwrap_or_else(|e| panic!("{}: {e}", dir.display())),
            views: read_json(&dir.join("cameras.json")),
            tolerance: stats.tol,
        }
    }

    pub(crate) fn n_views(&self) -> usize {
        self.views.len()
    }

    /// Loads one camera's arrays; its background is black.
    pub(crate) fn view(&self, index: usize) -> FixtureView {
        let entry = &self.views[index];
        let (n, h, w) = (self.gaussians.n(), entry.height, entry.width);
        let array = |what: &str, shape: &[usize]| {
            let file = format!("{}_{what}.npy", entry.img_name);
            read_shaped(&self.dir.join(file), shape)
        };
        let weights = array("w", &[h, w, 4]);
        let (weights, _) = weights.as_chunks::<4>();
        let sh = rows::<3>(&array("grad_sh", &[n, 16, 3]));
        FixtureView {
            gaussians: TwinGaussians {
                sh_degree: entry.sh_degree,
                ..self.gaussians.clone()
            },
            camera: TwinCamera {
                w2c: entry.w2c,
                width: w,
                height: h,
                fx: entry.fx,
                fy: entry.fy,
                cx: entry.cx,
                cy: entry.cy,
                near: entry.near,
                background: [0.0; 3],
                dropout: None,
            },
            rgb: array("rgb", &[h, w, 3]),
            alpha: array("alpha", &[h, w]),
            fragile: array("fragile", &[h, w])
                .iter()
                .map(|&x| x != 0.0)
                .collect(),
            count: array("count", &[h, w]).iter().map(|&x| x as u32).collect(),
            d_rgb: weights.iter().flat_map(|p| [p[0], p[1], p[2]]).collect(),
            d_alpha: weights.iter().map(|p| p[3]).collect(),
            gradients: TwinGradients {
                means: rows(&array("grad_means", &[n, 3])),
                sh: sh.as_chunks().0.to_vec(),
                opacity_logit: array("grad_opacity", &[n]),
                scale_log: rows(&array("grad_scales", &[n, 3])),
                rotation_wxyz: rows(&array("grad_quats", &[n, 4])),
                splats: rows(&array("grad2d", &[n, 9])),
            },
            projected: rows(&array("proj", &[n, 14])),
        }
    }
}

/// A flat array as rows of `N`.
fn rows<const N: usize>(values: &[f64]) -> Vec<[f64; N]> {
    values.as_chunks().0.to_vec()
}

/// Reads the 62-float layout of 3DGS files: `x y z nx ny nz f_dc_0..2 f_rest_0..44 opacity
/// scale_0..2 rot_0..3`, binary little-endian, and refuses any other.
pub(crate) fn parse_ply(bytes: &[u8]) -> Result<TwinGaussians, String> {
    const END: &[u8] = b"end_header\n";
    let end = bytes
        .windows(END.len())
        .position(|w| w == END)
        .ok_or("no end_header")?;
    let header = std::str::from_utf8(&bytes[..end]).map_err(|e| e.to_string())?;
    let lines: Vec<&str> = header
        .lines()
        .filter(|l| !l.starts_with("comment"))
        .collect();
    let n: usize = lines
        .iter()
        .find_map(|l| l.strip_prefix("element vertex "))
        .and_then(|n| n.parse().ok())
        .ok_or("no vertex count")?;
    let names: Vec<&str> = lines
        .iter()
        .filter_map(|l| l.strip_prefix("property float "))
        .collect();
    let mut expected: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(Into::into).to_vec();
    for (prefix, count) in [("f_dc", 3), ("f_rest", 45)] {
        expected.extend((0..count).map(|i| format!("{prefix}_{i}")));
    }
    expected.push("opacity".into());
    for (prefix, count) in [("scale", 3), ("rot", 4)] {
        expected.extend((0..count).map(|i| format!("{prefix}_{i}")));
    }
    if !lines.contains(&"format binary_little_endian 1.0") || names != expected {
        return Err("not the 62-float binary layout".into());
    }
    let (floats, rest) = bytes[end + END.len()..].as_chunks::<4>();
    if floats.len() != n * 62 || !rest.is_empty() {
        return Err(format!("{} floats for {n} vertices", floats.len()));
    }
    let value = |i: usize, column: usize| f64::from(f32::from_le_bytes(floats[i * 62 + column]));
    let vec3 = |i: usize, column: usize| -> Vec3 { [0, 1, 2].map(|c| value(i, column + c)) };
    let coefficient = |i: usize, k: usize| match k {
        0 => vec3(i, 6),
        _ => [0, 1, 2].map(|channel| value(i, 9 + channel * 15 + k - 1)),
    };
    Ok(TwinGaussians {
        means: (0..n).map(|i| vec3(i, 0)).collect(),
        sh: (0..n)
            .map(|i| std::array::from_fn(|k| coefficient(i, k)))
            .collect(),
        opacity_logit: (0..n).map(|i| value(i, 54)).collect(),
        scale_log: (0..n).map(|i| vec3(i, 55)).collect(),
        rotation_wxyz: (0..n)
            .map(|i| [0, 1, 2, 3].map(|c| value(i, 58 + c)))
            .collect(),
        sh_degree: 3,
    })
}
