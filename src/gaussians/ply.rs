//! This module reads and writes Gaussians in the PLY layout of 3DGS, which viewers open.
//!
//! Binary little-endian float32, one row a Gaussian, in the scene's own frame:
//! `x y z nx ny nz f_dc_0..2 f_rest_0..(3 (K - 1) - 1) opacity scale_0..2 rot_0..3` with
//! `K = (sh_degree + 1)^2`; `f_rest_{c (K - 1) + k - 1}` is coefficient `k` of channel `c`,
//! opacity a logit, scales logarithms, the rotation wxyz and as stored, the normals 0.
//!
//! Far from the scene's origin f32 would round positions to a visible grid. There they are stored
//! without [`Frame::offset`], which the header has as `comment offsetx X`, `offsety` and `offsetz`:
//! what is to be added. That is how the PLYs of XGRIDS' scanners say where on the map their
//! Gaussians are, and programs that put Gaussians on a map read it.

use std::fmt::Write as _;
use std::path::Path;

use glam::{DVec3, Vec3};
use ply_rs::ply::{ElementDef, Encoding, PropertyType, ScalarType};
use rayon::prelude::*;

use super::{Gaussians, MAX_SH_DEGREE, n_sh};
use crate::camera::Frame;
use crate::error::{Error, Result};
use crate::files::ply::{read_header, scalar_bytes};
use crate::files::{read_file, write_file};

/// Which properties a row has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Row {
    /// All of the layout.
    Whole,
    /// All but the normals, which say nothing.
    Lean,
}

/// Returns the property names in the order of the layout.
fn property_names(sh_degree: u32, row: Row) -> Vec<String> {
    let fixed = |names: &[&str]| names.iter().map(|n| n.to_string()).collect::<Vec<_>>();
    let mut names = fixed(&["x", "y", "z"]);
    if row == Row::Whole {
        names.extend(fixed(&["nx", "ny", "nz"]));
    }
    names.extend(fixed(&["f_dc_0", "f_dc_1", "f_dc_2"]));
    names.extend((0..3 * (n_sh(sh_degree) - 1)).map(|i| format!("f_rest_{i}")));
    names.extend(fixed(&[
        "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ]));
    names
}

/// Bytes that a header may take: 62 properties of the longest name, and the offset's comments.
const MOST_HEADER_BYTES: usize = 2048;

/// Returns the most Gaussians of a degree whose file has at most so many bytes.
pub fn most_in(bytes: usize, sh_degree: u32) -> usize {
    let row = size_of::<f32>() * property_names(sh_degree, Row::Whole).len();
    bytes.saturating_sub(MOST_HEADER_BYTES) / row
}

/// Writes Gaussians of the canonical `frame` in the scene's own frame.
///
/// # Errors
/// What keeps the file from being written.
pub fn write_ply(path: &Path, gaussians: &Gaussians, frame: &Frame) -> Result<()> {
    let offset = frame.offset();
    let stored = Frame {
        center: frame.center - offset,
        ..*frame
    };
    write_rows(path, gaussians, &stored, offset, Row::Whole)
}

/// Writes what [`read_ply`] has read. A `lean` file has neither normals nor SH degrees in which no
/// Gaussian has a coefficient.
///
/// # Errors
/// What keeps the file from being written.
pub fn write_stored(path: &Path, stored: &Stored, lean: bool) -> Result<()> {
    let Stored { gaussians, offset } = stored;
    if !lean {
        return write_rows(path, gaussians, &Frame::IDENTITY, *offset, Row::Whole);
    }
    let gaussians = gaussians.clone().without_empty_degrees();
    write_rows(path, &gaussians, &Frame::IDENTITY, *offset, Row::Lean)
}

/// Writes Gaussians in the frame that `stored` takes them to, in which `offset` has been taken out.
fn write_rows(
    path: &Path,
    gaussians: &Gaussians,
    stored: &Frame,
    offset: DVec3,
    row: Row,
) -> Result<()> {
    let names = property_names(gaussians.sh_degree, row);
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        gaussians.len()
    );
    if offset != DVec3::ZERO {
        let line = format!(
            "comment offsetx {}\ncomment offsety {}\ncomment offsetz {}\nelement",
            offset.x, offset.y, offset.z
        );
        header = header.replacen("element", &line, 1);
    }
    for name in &names {
        // Writing to a String cannot fail.
        let _ = writeln!(header, "property float {name}");
    }
    header.push_str("end_header\n");
    let row_bytes = names.len() * 4;
    let mut bytes = header.into_bytes();
    let start = bytes.len();
    bytes.resize(start + gaussians.len() * row_bytes, 0);
    bytes[start..]
        .par_chunks_exact_mut(row_bytes)
        .enumerate()
        .for_each_init(
            || Vec::with_capacity(names.len()),
            |values, (i, out)| {
                values.clear();
                push_row(gaussians, i, stored, row, values);
                for (out, value) in out.chunks_exact_mut(4).zip(values) {
                    out.copy_from_slice(&value.to_le_bytes());
                }
            },
        );
    write_file(path, &bytes)
}

/// Appends one Gaussian's properties in the order of the layout.
fn push_row(gaussians: &Gaussians, i: usize, frame: &Frame, row: Row, values: &mut Vec<f32>) {
    let n_sh = gaussians.n_sh();
    let sh = &gaussians.sh[i * n_sh * 3..][..n_sh * 3];
    let mean = frame.to_world(gaussians.means[i].as_dvec3()).as_vec3();
    let scale_log = gaussians.scales_log[i].as_dvec3() + DVec3::splat(frame.radius.ln());
    values.extend(mean.to_array());
    if row == Row::Whole {
        values.extend([0.0; 3]);
    }
    values.extend(&sh[..3]);
    values.extend((0..3).flat_map(|c| (1..n_sh).map(move |k| sh[k * 3 + c])));
    values.push(gaussians.opacity_logits[i]);
    values.extend(scale_log.as_vec3().to_array());
    values.extend(gaussians.rotations_wxyz[i]);
}

/// Gaussians as a file has them.
#[derive(Clone, Debug, PartialEq)]
pub struct Stored {
    /// In the scene's own frame, less `offset`.
    pub gaussians: Gaussians,
    /// Vector to add to their means for the scene's own frame.
    pub offset: DVec3,
}

impl Stored {
    /// Returns the Gaussians in the canonical frame of `frame`, which is in the scene's own.
    pub fn to_canonical(self, frame: &Frame) -> Gaussians {
        self.gaussians.to_canonical(&Frame {
            center: frame.center - self.offset,
            ..*frame
        })
    }
}

/// Reads Gaussians in the file's own frame; [`Stored::to_canonical`] takes them to another.
///
/// Properties may come in any order and beside others; values are taken as they are, finite or not,
/// but for Mip-Splatting's `filter_3D`, which is made part of scales and opacity. Memory is bounded
/// by the file's size.
///
/// # Errors
/// A file that is no such PLY, naming the header's line, the missing property, or the byte at
/// which the data ends.
pub fn read_ply(path: &Path) -> Result<Stored> {
    let bytes = read_file(path)?;
    let (gaussians, header) = parse(&bytes).map_err(|e| e.at_path(path))?;
    Ok(Stored {
        gaussians,
        offset: offset_of(&bytes[..header]),
    })
}

/// Returns the offset that a header's comments state; zero where they tell none along some axis.
fn offset_of(header: &[u8]) -> DVec3 {
    let text = String::from_utf8_lossy(header);
    let along = |axis: &str| {
        text.lines().find_map(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words[..] {
                ["comment", name, value] if name == axis => value.parse().ok(),
                _ => None,
            }
        })
    };
    let axes = ["offsetx", "offsety", "offsetz"].map(along);
    let offset = DVec3::from_array(axes.map(|value| value.unwrap_or(f64::NAN)));
    match offset.is_finite() {
        true => offset,
        false => DVec3::ZERO,
    }
}

/// Reads the Gaussians; returns with them the byte at which the header ends.
fn parse(bytes: &[u8]) -> Result<(Gaussians, usize)> {
    let (element, start) = read_vertex_element(bytes)?;
    let layout = Layout::new(&element)?;
    let available = bytes.len() - start;
    let needed = element.count.checked_mul(layout.row_bytes);
    if needed.is_none_or(|needed| needed > available) {
        return Err(Error::new(format!(
            "the file ends at byte {}, within vertex {} of the {} that its header announces ({} bytes each)",
            bytes.len(),
            available / layout.row_bytes,
            element.count,
            layout.row_bytes
        ))
        .way_out("the file is truncated; write or copy it again"));
    }
    let n = element.count;
    let n_sh = n_sh(layout.sh_degree);
    let mut gaussians = Gaussians {
        means: Vec::with_capacity(n),
        scales_log: Vec::with_capacity(n),
        rotations_wxyz: Vec::with_capacity(n),
        opacity_logits: Vec::with_capacity(n),
        sh: Vec::with_capacity(n * n_sh * 3),
        sh_degree: layout.sh_degree,
    };
    for row in bytes[start..].chunks_exact(layout.row_bytes).take(n) {
        let float = |offset: usize| {
            let at = |i| row[offset + i];
            f32::from_le_bytes([at(0), at(1), at(2), at(3)])
        };
        gaussians
            .means
            .push(Vec3::from_array(layout.mean.map(float)));
        let stored = (
            Vec3::from_array(layout.scale.map(float)),
            float(layout.opacity),
        );
        let (scale_log, opacity_logit) = match layout.filter {
            Some(filter) => smoothed(stored, float(filter)),
            None => stored,
        };
        gaussians.scales_log.push(scale_log);
        gaussians.rotations_wxyz.push(layout.rotation.map(float));
        gaussians.opacity_logits.push(opacity_logit);
        gaussians.sh.extend(layout.sh.iter().map(|o| float(*o)));
    }
    Ok((gaussians, start))
}

/// Returns a Gaussian convolved with Mip-Splatting's smoothing filter (Yu et al. 2024, equation 7),
/// a Gaussian of standard deviation `filter`, which files of that method hold beside and other
/// viewers know nothing of: variances add up, and opacity goes down by the square root of the
/// determinants' ratio.
fn smoothed((scale_log, opacity_logit): (Vec3, f32), filter: f32) -> (Vec3, f32) {
    let variance = f64::from(filter).powi(2);
    if !(variance > 0.0 && variance.is_finite()) {
        return (scale_log, opacity_logit);
    }
    let own = (2.0 * scale_log.as_dvec3()).exp();
    let wider = own + variance;
    let share = (own / wider).to_array().iter().product::<f64>().sqrt();
    let opacity = share / (1.0 + (-f64::from(opacity_logit)).exp());
    let logit = (opacity / (1.0 - opacity)).ln();
    let wider_log = DVec3::from(wider.to_array().map(|v| 0.5 * v.ln()));
    (wider_log.as_vec3(), logit as f32)
}

/// Returns the vertex element, and the byte at which its rows start.
fn read_vertex_element(bytes: &[u8]) -> Result<(ElementDef, usize)> {
    let way_out = "expected a 3DGS point_cloud.ply: binary little-endian, vertices first";
    let header = read_header(bytes)?;
    if header.encoding != Encoding::BinaryLittleEndian {
        return Err(
            Error::new(format!("the PLY encoding is {}", header.encoding)).way_out(way_out),
        );
    }
    match header.elements.into_iter().next() {
        Some((name, element)) if name == "vertex" => Ok((element, header.end)),
        _ => Err(Error::new("the PLY file's first element is not `vertex`").way_out(way_out)),
    }
}

/// Byte offsets of the properties within a row.
struct Layout {
    row_bytes: usize,
    mean: [usize; 3],
    scale: [usize; 3],
    rotation: [usize; 4],
    opacity: usize,
    /// Mip-Splatting's `filter_3D`.
    filter: Option<usize>,
    /// In the order `[k][c]`.
    sh: Vec<usize>,
    sh_degree: u32,
}

impl Layout {
    fn new(element: &ElementDef) -> Result<Layout> {
        let mut row_bytes = 0;
        let mut properties = Vec::with_capacity(element.properties.len());
        for (name, property) in &element.properties {
            let PropertyType::Scalar(scalar) = &property.data_type else {
                return Err(Error::new(format!(
                    "vertex property `{name}` is a list, which no Gaussian has"
                )));
            };
            properties.push((name.as_str(), scalar, row_bytes));
            row_bytes += scalar_bytes(scalar);
        }
        let offset = |name: &str| match properties.iter().find(|p| p.0 == name) {
            Some((_, ScalarType::Float, offset)) => Ok(*offset),
            Some((_, scalar, _)) => Err(Error::new(format!(
                "vertex property `{name}` is {scalar:?}, but must be float"
            ))),
            None => Err(
                Error::new(format!("the vertices have no property `{name}`")).way_out(
                    "this is a point cloud, not Gaussians: give the point_cloud.ply of a run",
                ),
            ),
        };
        let n_rest = properties
            .iter()
            .filter(|p| p.0.starts_with("f_rest_"))
            .count();
        let sh_degree = (0..=MAX_SH_DEGREE)
            .find(|degree| 3 * (n_sh(*degree) - 1) == n_rest)
            .ok_or_else(|| {
                Error::new(format!(
                    "{n_rest} f_rest properties fit no SH degree; 0, 9, 24 or 45 do"
                ))
            })?;
        let n_higher = n_sh(sh_degree) - 1;
        let mut sh = Vec::with_capacity(3 * (n_higher + 1));
        for c in 0..3 {
            sh.push(offset(&format!("f_dc_{c}"))?);
        }
        for k in 0..n_higher {
            for c in 0..3 {
                sh.push(offset(&format!("f_rest_{}", c * n_higher + k))?);
            }
        }
        Ok(Layout {
            row_bytes,
            mean: [offset("x")?, offset("y")?, offset("z")?],
            scale: [offset("scale_0")?, offset("scale_1")?, offset("scale_2")?],
            rotation: [
                offset("rot_0")?,
                offset("rot_1")?,
                offset("rot_2")?,
                offset("rot_3")?,
            ],
            opacity: offset("opacity")?,
            filter: match properties.iter().any(|p| p.0 == "filter_3D") {
                true => Some(offset("filter_3D")?),
                false => None,
            },
            sh,
            sh_degree,
        })
    }
}
