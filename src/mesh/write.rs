//! This module writes meshes: PLY, OBJ and glTF, with a colour a vertex.

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;
use serde_json::json;

use super::Mesh;
use crate::error::{Error, Result};
use crate::files::gltf::{Gltf, Mode};
use crate::files::write_file;

/// A format of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stanford's, binary.
    Ply,
    /// Wavefront's, with the colours behind the positions, as most programs read them.
    Obj,
    /// glTF, unlit.
    Gltf,
}

/// Every ending with its format.
const ENDINGS: [(&str, MeshFormat); 4] = [
    ("ply", MeshFormat::Ply),
    ("obj", MeshFormat::Obj),
    ("glb", MeshFormat::Gltf),
    ("gltf", MeshFormat::Gltf),
];

impl MeshFormat {
    /// Returns the format that a file's ending names.
    ///
    /// # Errors
    /// It names none: lists those there are.
    pub fn of(path: &Path) -> Result<MeshFormat> {
        let ending = path.extension().and_then(|ext| ext.to_str());
        let found = ENDINGS.iter().find(|(name, _)| Some(*name) == ending);
        found.map(|(_, format)| *format).ok_or_else(|| {
            let known: Vec<String> = ENDINGS.iter().map(|(name, _)| format!(".{name}")).collect();
            Error::usage(format!(
                "the formats to export a mesh in are {}",
                known.join(", ")
            ))
            .at_path(path)
            .way_out("name a file that ends in one of them, or leave --mesh out for Gaussians")
        })
    }

    /// Returns whether a file's axes say which way is up.
    pub fn has_up(self) -> bool {
        self == MeshFormat::Gltf
    }

    /// Writes a mesh in its own frame less `offset`, which a PLY notes as those of Gaussians do.
    ///
    /// # Errors
    /// What keeps the file from being written.
    pub fn write(self, path: &Path, mesh: &Mesh, offset: DVec3) -> Result<()> {
        let positions = mesh.positions.iter().map(|p| (*p - offset).as_vec3());
        let positions: Vec<[f32; 3]> = positions.map(|p| p.to_array()).collect();
        match self {
            MeshFormat::Ply => write_file(path, &ply(mesh, &positions, offset)),
            MeshFormat::Obj => write_file(path, obj(mesh, &positions).as_bytes()),
            MeshFormat::Gltf => write_gltf(path, mesh, &positions),
        }
    }
}

fn ply(mesh: &Mesh, positions: &[[f32; 3]], offset: DVec3) -> Vec<u8> {
    let mut header = "ply\nformat binary_little_endian 1.0\n".to_owned();
    if offset != DVec3::ZERO {
        for (name, value) in ["offsetx", "offsety", "offsetz"]
            .iter()
            .zip(offset.to_array())
        {
            // Writing to a String cannot fail.
            let _ = writeln!(header, "comment {name} {value}");
        }
    }
    let _ = write!(
        header,
        "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        positions.len(),
        mesh.triangles.len()
    );
    let mut bytes = header.into_bytes();
    for (position, color) in positions.iter().zip(&mesh.colors) {
        bytes.extend(position.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(color.map(|v| (255.0 * v).round() as u8));
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

fn obj(mesh: &Mesh, positions: &[[f32; 3]]) -> String {
    let mut text = String::new();
    for ([x, y, z], [r, g, b]) in positions.iter().zip(&mesh.colors) {
        let _ = writeln!(text, "v {x} {y} {z} {r:.4} {g:.4} {b:.4}");
    }
    for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|v| u64::from(v) + 1)) {
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text
}

/// Writes a material that no light changes: the colours have the scene's light in them. Holes show
/// the surface's back, so both sides are drawn.
fn write_gltf(path: &Path, mesh: &Mesh, positions: &[[f32; 3]]) -> Result<()> {
    const UNLIT: &str = "KHR_materials_unlit";
    let mut file = Gltf::default();
    file.positions(positions);
    let colors = mesh.colors.iter().map(|[r, g, b]| [*r, *g, *b, 1.0]);
    file.colors(&colors.collect::<Vec<_>>());
    file.triangles(&mesh.triangles);
    let material = json!({"doubleSided": true, "extensions": {UNLIT: {}}});
    let top = json!({"extensionsUsed": [UNLIT], "materials": [material]});
    file.write(path, Mode::Triangles, json!({"material": 0}), top)
}
