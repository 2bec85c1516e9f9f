//! This module reads PLY headers, for clouds and Gaussians alike.
//!
//! The format is parsed by `ply-rs`. Before it sees a header, [`read_header`] refuses what it
//! would panic on (counts beyond 64 bits), merge silently (names that appear twice) or loop over
//! (elements of nothing).

use std::io;

use ply_rs::parser::Parser;
use ply_rs::ply::{DefaultElement, ElementDef, Encoding, KeyMap, ScalarType};

use crate::error::{Error, Result};

/// Headers longer than this are no headers, bytes.
pub(crate) const MAX_HEADER_BYTES: usize = 1 << 20;

pub(crate) struct Header {
    pub encoding: Encoding,
    /// In the file's order; each has fewer than 2^32 rows and at least one property.
    pub elements: KeyMap<ElementDef>,
    /// Byte at which the rows start.
    pub end: usize,
    /// Line at which they start, from 1.
    pub end_line: usize,
}

/// Parses the header of a PLY file's `bytes`. Nothing is known yet of the rows, which may be
/// fewer than it announces.
///
/// # Errors
///
/// Not a PLY, or a header that is malformed, unterminated or ambiguous, with its line.
pub(crate) fn read_header(bytes: &[u8]) -> Result<Header> {
    let (end, n_lines) = check(bytes)?;
    let header = Parser::<DefaultElement>::new()
        .read_header(&mut &bytes[..end])
        .map_err(|e| Error::new(format!("bad PLY header: {}", one_line(&e))))?;
    Ok(Header {
        encoding: header.encoding,
        elements: header.elements,
        end,
        end_line: n_lines + 1,
    })
}

/// Refuses what `ply-rs` must not see; returns the header's length in bytes and lines.
fn check(bytes: &[u8]) -> Result<(usize, usize)> {
    if !bytes.starts_with(b"ply") {
        return Err(Error::new("not a PLY file: it does not begin with `ply`").at("byte 0"));
    }
    let head = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let mut end = 0;
    let mut elements: Vec<&str> = Vec::new();
    let mut properties: Vec<&str> = Vec::new();
    let mut element_is_empty = false;
    for (line, number) in head.split_inclusive(|&b| b == b'\n').zip(1..) {
        if !line.ends_with(b"\n") {
            break;
        }
        end += line.len();
        let here = |e: Error| e.at(format_args!("line {number}"));
        let line = std::str::from_utf8(line)
            .map_err(|_| here(Error::new("the PLY header is not UTF-8 text")))?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let starts_section = matches!(words.first(), Some(&("element" | "end_header")));
        if starts_section && element_is_empty {
            return Err(here(Error::new("the element before has no properties")));
        }
        match *words.as_slice() {
            ["end_header", ..] => return Ok((end, number)),
            ["format", _, version, ..] if version != "1.0" => {
                let what = format!("PLY version `{}` is not 1.0", version.escape_debug());
                return Err(here(Error::new(what)));
            }
            ["element", name, count, ..] => {
                if count.parse::<u32>().is_err() {
                    return Err(here(Error::new(format!(
                        "element `{}` has no valid count below 2^32: `{}`",
                        name.escape_debug(),
                        count.escape_debug()
                    ))));
                }
                if elements.contains(&name) {
                    return Err(here(duplicate("element", name)));
                }
                elements.push(name);
                properties.clear();
                element_is_empty = true;
            }
            ["property", .., name] => {
                if properties.contains(&name) {
                    return Err(here(duplicate("property", name)));
                }
                properties.push(name);
                element_is_empty = false;
            }
            _ => {}
        }
    }
    Err(Error::new("the PLY header has no `end_header`")
        .at(format_args!("byte {}", head.len()))
        .way_out("the file is truncated or no PLY: export or copy it again"))
}

fn duplicate(kind: &str, name: &str) -> Error {
    Error::new(format!("{kind} `{}` appears twice", name.escape_debug()))
}

/// Returns the bytes that a value takes in a binary row.
pub(crate) fn scalar_bytes(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Returns a message of `ply-rs`, which may quote whole lines of the file, as one line that is not
/// too long.
pub(crate) fn one_line(error: &io::Error) -> String {
    let words: Vec<String> = error
        .to_string()
        .split_whitespace()
        .map(|word| word.escape_debug().to_string())
        .collect();
    words.join(" ").chars().take(200).collect()
}
