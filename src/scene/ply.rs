//! This module reads point clouds as PLY: ASCII and both binary orders.
//!
//! The format is parsed by `ply-rs`, row by row, behind [`read_header`]'s guard; counts that the
//! file has no room for are refused before they are looped over.

use std::io;

use glam::DVec3;
use ply_rs::parser::Parser;
use ply_rs::ply::{
    ElementDef, Encoding, Property, PropertyAccess, PropertyDef, PropertyType, ScalarType,
};

use super::PointCloud;
use crate::error::{Error, Result};
use crate::files::ply::{one_line, read_header, scalar_bytes};

/// Float colours may leave `[0, 1]` by this much, for rounding.
const COLOR_SLACK: f64 = 1e-3;

/// One row of the `vertex` element. Colours in `[0, 255]` whatever the file's type.
#[derive(Clone, Copy)]
struct Vertex {
    position: [f64; 3],
    color: [f64; 3],
    confidence: f64,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Vertex {
            position: [0.0; 3],
            color: [0.0; 3],
            confidence: 0.0,
        }
    }

    fn set_property(&mut self, name: String, property: Property) {
        let (value, color_scale) = match property {
            Property::Float(v) => (f64::from(v), 255.0),
            Property::Double(v) => (v, 255.0),
            Property::UChar(v) => (f64::from(v), 1.0),
            // Refused by `check_vertex` where the name is one of ours.
            _ => return,
        };
        match name.as_str() {
            "x" => self.position[0] = value,
            "y" => self.position[1] = value,
            "z" => self.position[2] = value,
            "red" => self.color[0] = value * color_scale,
            "green" => self.color[1] = value * color_scale,
            "blue" => self.color[2] = value * color_scale,
            "confidence" => self.confidence = value,
            _ => {}
        }
    }
}

/// The property `view` of a row of the `vertex` element.
struct ViewOfVertex(i64);

impl PropertyAccess for ViewOfVertex {
    fn new() -> Self {
        ViewOfVertex(0)
    }

    fn set_property(&mut self, name: String, property: Property) {
        if name == "view" {
            self.0 = match property {
                Property::Char(v) => v.into(),
                Property::UChar(v) => v.into(),
                Property::Short(v) => v.into(),
                Property::UShort(v) => v.into(),
                Property::Int(v) => v.into(),
                Property::UInt(v) => v.into(),
                // Refused by `read_views`.
                _ => return,
            };
        }
    }
}

/// A row of an element that is not ours.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Skipped
    }
}

/// Reads the cloud in a PLY file's `bytes`: `x y z` (float or double), `red green blue` (uchar, or
/// float in `[0, 1]`) and, where present, `confidence` (float) of element `vertex`. Other elements
/// and properties are skipped. Values that are not finite are passed on.
///
/// # Errors
///
/// Not a PLY, a header that does not fit the file's size, missing or mistyped properties, rows
/// that cannot be read (with their byte, or their line in ASCII files), colours out of range.
pub(super) fn read_ply(bytes: &[u8]) -> Result<PointCloud> {
    read_vertex_element(bytes, |rows, element| {
        check_vertex(element)?;
        read_vertices(rows, element)
    })
}

/// Reads the property `view` of element `vertex`, a whole number from 0, which tells the view that
/// a point came from; `None` if there is no such property.
///
/// # Errors
///
/// As those of [`read_ply`], another type, and numbers below 0.
pub(super) fn read_views(bytes: &[u8]) -> Result<Option<Vec<u32>>> {
    read_vertex_element(bytes, |rows, element| {
        if !element.properties.contains_key("view") {
            return Ok(None);
        }
        let whole = [
            ScalarType::Char,
            ScalarType::UChar,
            ScalarType::Short,
            ScalarType::UShort,
            ScalarType::Int,
            ScalarType::UInt,
        ];
        check_property(element, "view", &whole)?;
        let view = |row: usize| {
            let ViewOfVertex(view) = rows.next(element)?;
            u32::try_from(view).map_err(|_| {
                Error::new(format!("view {view} is below 0")).at(format_args!("vertex {row}"))
            })
        };
        (0..element.count)
            .map(view)
            .collect::<Result<_>>()
            .map(Some)
    })
}

/// Returns what `read` makes of the rows of element `vertex`; elements before it are skipped.
fn read_vertex_element<T>(
    bytes: &[u8],
    read: impl FnOnce(&mut Rows, &ElementDef) -> Result<T>,
) -> Result<T> {
    let header = read_header(bytes)?;
    let mut rows = Rows {
        bytes,
        position: header.end,
        line: header.end_line,
        encoding: header.encoding,
    };
    for (name, element) in &header.elements {
        rows.check_room(element)?;
        if name == "vertex" {
            return read(&mut rows, element);
        }
        for _ in 0..element.count {
            rows.next::<Skipped>(element)?;
        }
    }
    Err(Error::new("the PLY has no element `vertex`"))
}

fn read_vertices(rows: &mut Rows, element: &ElementDef) -> Result<PointCloud> {
    let has_confidence = element.properties.contains_key("confidence");
    let mut cloud = PointCloud {
        // `check_room` held the count against the file's size.
        positions: Vec::with_capacity(element.count),
        colors: Vec::with_capacity(element.count),
        confidence: has_confidence.then(|| Vec::with_capacity(element.count)),
    };
    for row in 0..element.count {
        let vertex: Vertex = rows.next(element)?;
        let mut position = DVec3::from(vertex.position);
        let mut color = [0; 3];
        for (stored, value) in color.iter_mut().zip(vertex.color) {
            let slack = 255.0 * COLOR_SLACK;
            if !value.is_finite() {
                // A broken row: the caller drops and counts it.
                position = DVec3::NAN;
            } else if value < -slack || value > 255.0 + slack {
                return Err(
                    Error::new(format!("colour {} is outside [0, 1]", value / 255.0))
                        .at(format_args!("vertex {row}"))
                        .way_out("write colours as uchar, or as float in [0, 1]"),
                );
            }
            *stored = value.round().clamp(0.0, 255.0) as u8;
        }
        cloud.positions.push(position);
        cloud.colors.push(color);
        if let Some(confidence) = &mut cloud.confidence {
            confidence.push(vertex.confidence as f32);
        }
    }
    Ok(cloud)
}

fn check_vertex(element: &ElementDef) -> Result<()> {
    let float = [ScalarType::Float, ScalarType::Double];
    let color = [ScalarType::UChar, ScalarType::Float, ScalarType::Double];
    for name in ["x", "y", "z"] {
        check_property(element, name, &float)?;
    }
    for name in ["red", "green", "blue"] {
        check_property(element, name, &color)?;
    }
    if element.properties.contains_key("confidence") {
        check_property(element, "confidence", &float)?;
    }
    Ok(())
}

fn check_property(element: &ElementDef, name: &str, allowed: &[ScalarType]) -> Result<()> {
    match element.properties.get(name) {
        None => Err(Error::new(format!("the PLY's vertices have no `{name}`"))
            .way_out("positions `x y z` and colours `red green blue` are needed")),
        Some(PropertyDef {
            data_type: PropertyType::Scalar(scalar),
            ..
        }) if allowed.contains(scalar) => Ok(()),
        Some(property) => Err(Error::new(format!(
            "property `{name}` has type {:?}",
            property.data_type
        ))
        .way_out(format!("write it as one of {allowed:?}"))),
    }
}

/// Reads the rows of the payload in order.
struct Rows<'a> {
    bytes: &'a [u8],
    position: usize,
    /// Line of the next row, from 1; of ASCII files only.
    line: usize,
    encoding: Encoding,
}

impl Rows<'_> {
    /// Refuses an element whose rows cannot fit into what is left of the file.
    fn check_room(&self, element: &ElementDef) -> Result<()> {
        let properties = element.properties.values().map(|p| &p.data_type);
        let row_bytes: usize = match self.encoding {
            // A digit and a separator each; the last separator may be missing.
            Encoding::Ascii => 2 * properties.count(),
            _ => properties.map(min_bytes).sum(),
        };
        let room = self.bytes.len() - self.position;
        let needed = element.count as u128 * row_bytes as u128;
        let slack = u128::from(self.encoding == Encoding::Ascii);
        if needed > room as u128 + slack {
            return Err(Error::new(format!(
                "truncated or damaged: {} rows of element `{}` take at least {needed} bytes \
                 from byte {}, but the file ends at byte {}",
                element.count,
                element.name,
                self.position,
                self.bytes.len()
            ))
            .way_out("export or copy the file again"));
        }
        Ok(())
    }

    fn next<E: PropertyAccess>(&mut self, element: &ElementDef) -> Result<E> {
        let parser = Parser::<E>::new();
        let mut rest = &self.bytes[self.position..];
        let row = match self.encoding {
            Encoding::Ascii => return self.next_ascii(&parser, element),
            Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut rest, element),
            Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut rest, element),
        };
        let row = row.map_err(|_| {
            Error::new(format!(
                "truncated: a row of element `{}` runs past the file's end at byte {}",
                element.name,
                self.bytes.len()
            ))
            .at(format_args!("byte {}", self.position))
            .way_out("export or copy the file again")
        })?;
        self.position = self.bytes.len() - rest.len();
        Ok(row)
    }

    fn next_ascii<E: PropertyAccess>(
        &mut self,
        parser: &Parser<E>,
        element: &ElementDef,
    ) -> Result<E> {
        let rest = &self.bytes[self.position..];
        let place = format!("line {} (byte {})", self.line, self.position);
        let n = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        let line = std::str::from_utf8(&rest[..n])
            .map_err(|_| Error::new("not ASCII text").at(&place))?
            .trim();
        self.position += (n + 1).min(rest.len());
        self.line += 1;
        if line.is_empty() && rest.len() == n {
            return Err(Error::new(format!(
                "truncated: the file ends before all {} rows of element `{}`",
                element.count, element.name
            ))
            .at(&place)
            .way_out("export or copy the file again"));
        }
        parser
            .read_ascii_element(line, element)
            .or_else(|_| parser.read_ascii_element(&plain_numbers(line)?, element))
            .map_err(|e| {
                Error::new(format!(
                    "bad row of element `{}`: {}",
                    element.name,
                    one_line(&e)
                ))
                .at(&place)
            })
    }
}

/// Returns the fewest bytes that a property takes in a binary row.
fn min_bytes(data_type: &PropertyType) -> usize {
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = data_type;
    scalar_bytes(scalar)
}

/// Returns the row in the spelling that `ply-rs` reads, which has no `1E5`, `.5`, `nan` or `inf`:
/// values that are not finite become one that overflows to infinity.
fn plain_numbers(line: &str) -> io::Result<String> {
    let mut plain = String::new();
    for word in line.split_whitespace() {
        let value: f64 = word
            .parse()
            .map_err(|_| io::Error::other(format!("`{word}` is not a number")))?;
        if value.is_finite() {
            plain.push_str(&value.to_string());
        } else {
            plain.push_str("1e999");
        }
        plain.push(' ');
    }
    Ok(plain)
}
