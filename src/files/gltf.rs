//! This module writes glTF 2.0 files of one mesh: `.glb`, or `.gltf` with its data within.
//!
//! `.glb` is a header, a chunk of JSON and a chunk of data, each padded to 4 bytes. Values of one
//! kind stand in a row, so that every kind has a view of the buffer and an accessor of its own.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use bytemuck::NoUninit;
use serde_json::{Map, Value, json};

use super::write_file;
use crate::error::{Error, Result};

const MAGIC: u32 = 0x4654_6C67;
const JSON_CHUNK: u32 = 0x4E4F_534A;
const DATA_CHUNK: u32 = 0x004E_4942;

const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// The buffer's use for the values of triangles' corners.
const ELEMENT_ARRAY: u32 = 34963;
/// The buffer's use for the values of vertices.
const ARRAY: u32 = 34962;

/// How the vertices make shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Each is a point.
    Points = 0,
    /// Three indices a triangle.
    Triangles = 4,
}

/// A glTF file under way.
#[derive(Default)]
pub(crate) struct Gltf {
    data: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    attributes: Map<String, Value>,
    indices: Option<usize>,
}

impl Gltf {
    /// Adds the vertices' positions, with the bounds that the format asks for.
    pub(crate) fn positions(&mut self, positions: &[[f32; 3]]) {
        let accessor = self.add(positions, "VEC3", FLOAT, ARRAY);
        let bound = |least: f32, of: fn(f32, f32) -> f32| -> [f32; 3] {
            let along = |axis: usize| positions.iter().map(|p| p[axis]).fold(least, of);
            [along(0), along(1), along(2)]
        };
        self.accessors[accessor]["min"] = json!(bound(f32::INFINITY, f32::min));
        self.accessors[accessor]["max"] = json!(bound(f32::NEG_INFINITY, f32::max));
        self.attributes
            .insert("POSITION".to_owned(), json!(accessor));
    }

    /// Adds an attribute of `N` floats a vertex.
    pub(crate) fn floats<const N: usize>(&mut self, name: &str, values: &[[f32; N]])
    where
        [f32; N]: NoUninit,
    {
        let accessor = self.add(values, shape(N), FLOAT, ARRAY);
        self.attributes.insert(name.to_owned(), json!(accessor));
    }

    /// Adds the vertices' colours: sRGB and opacity, from 0 to 1. The format has them linear.
    pub(crate) fn colors(&mut self, rgba: &[[f32; 4]]) {
        let level = |value: f32| (65535.0 * value.clamp(0.0, 1.0)).round() as u16;
        let stored = rgba.iter().map(|[r, g, b, a]| {
            let [r, g, b] = [r, g, b].map(|v| level(linear(*v)));
            [r, g, b, level(*a)]
        });
        let stored: Vec<[u16; 4]> = stored.collect();
        let accessor = self.add(&stored, "VEC4", UNSIGNED_SHORT, ARRAY);
        self.accessors[accessor]["normalized"] = json!(true);
        self.attributes
            .insert("COLOR_0".to_owned(), json!(accessor));
    }

    /// Adds the corners of triangles, anticlockwise seen from outside.
    pub(crate) fn triangles(&mut self, triangles: &[[u32; 3]]) {
        let corners: &[u32] = triangles.as_flattened();
        self.indices = Some(self.add(corners, "SCALAR", UNSIGNED_INT, ELEMENT_ARRAY));
    }

    /// Adds values in a row; returns the number of their accessor.
    fn add<T: NoUninit>(
        &mut self,
        values: &[T],
        shape: &str,
        component: u32,
        target: u32,
    ) -> usize {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": self.data.len(),
            "byteLength": bytes.len(),
            "target": target,
        }));
        self.data.extend(bytes);
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1,
            "componentType": component,
            "count": values.len(),
            "type": shape,
        }));
        self.accessors.len() - 1
    }

    /// Writes the file. `primitive` holds what the mesh has beside its attributes, `top` what the
    /// file has beside its one mesh.
    ///
    /// # Errors
    /// More data than the format holds, or what keeps the file from being written.
    pub(crate) fn write(self, path: &Path, mode: Mode, primitive: Value, top: Value) -> Result<()> {
        let is_binary = path.extension().is_some_and(|ext| ext == "glb");
        let mut primitive = primitive;
        primitive["attributes"] = Value::Object(self.attributes);
        primitive["mode"] = json!(mode as u32);
        if let Some(indices) = self.indices {
            primitive["indices"] = json!(indices);
        }
        let mut buffer = json!({"byteLength": self.data.len()});
        if !is_binary {
            let data = STANDARD.encode(&self.data);
            buffer["uri"] = json!(format!("data:application/octet-stream;base64,{data}"));
        }
        let mut file = top;
        file["asset"] = json!({
            "version": "2.0",
            "generator": concat!("gspotential ", env!("CARGO_PKG_VERSION")),
        });
        file["scene"] = json!(0);
        file["scenes"] = json!([{"nodes": [0]}]);
        file["nodes"] = json!([{"mesh": 0}]);
        file["meshes"] = json!([{"primitives": [primitive]}]);
        file["accessors"] = Value::Array(self.accessors);
        file["bufferViews"] = Value::Array(self.views);
        file["buffers"] = json!([buffer]);
        let text = serde_json::to_vec(&file)
            .map_err(|e| Error::new(format!("cannot be written as JSON: {e}")).at_path(path))?;
        if !is_binary {
            return write_file(path, &text);
        }
        let bytes = glb(text, self.data).ok_or_else(|| {
            Error::new("a .glb holds at most 4 GiB, and this would be more")
                .at_path(path)
                .way_out("write a file that ends in .gltf, or a smaller model")
        })?;
        write_file(path, &bytes)
    }
}

/// Packs both chunks; `None` if their lengths do not fit the format.
fn glb(mut text: Vec<u8>, data: Vec<u8>) -> Option<Vec<u8>> {
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = u32::try_from(12 + 8 + text.len() + 8 + data.len()).ok()?;
    let mut bytes = Vec::with_capacity(length as usize);
    for word in [MAGIC, 2, length, text.len() as u32, JSON_CHUNK] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(&text);
    for word in [data.len() as u32, DATA_CHUNK] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(&data);
    Some(bytes)
}

fn shape(n: usize) -> &'static str {
    ["SCALAR", "VEC2", "VEC3", "VEC4"][n - 1]
}

/// Returns the linear light of an sRGB value (IEC 61966-2-1).
fn linear(value: f32) -> f32 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.04045 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}
