//! This module reads arrays from NumPy's `.npy`, version 1 to 3 (NEP 1).
//!
//! The crates that read the format bring a parser of Python literals along; a header takes one
//! line of three known keys.

use crate::error::{Error, Result};

/// Reads the numbers of a float array of one dimension, or of several of which all but one are 1.
///
/// # Errors
///
/// Not such an array, or data that do not fill its shape exactly.
pub(crate) fn read_vector(bytes: &[u8]) -> Result<Vec<f32>> {
    let (header, data) = split(bytes)?;
    let header = Header::parse(header)?;
    let mut lengths = header.shape.iter().copied().filter(|n| *n != 1);
    let length = lengths.next().unwrap_or(1);
    if lengths.next().is_some() {
        return Err(Error::new(format!(
            "an array of shape {:?} is not a vector",
            header.shape
        ))
        .way_out("save one value a point"));
    }
    numbers(&header, data, Some(length))
}

/// Reads the shape and the numbers of a float array, the last axis running fastest.
///
/// # Errors
///
/// Not such an array, or data that do not fill its shape exactly.
pub(crate) fn read_array(bytes: &[u8]) -> Result<(Vec<usize>, Vec<f32>)> {
    let (header, data) = split(bytes)?;
    let header = Header::parse(header)?;
    if header.is_fortran && header.shape.len() > 1 {
        return Err(Error::new("the array is stored by columns (fortran_order)")
            .way_out("save numpy.ascontiguousarray of it"));
    }
    let length = header
        .shape
        .iter()
        .try_fold(1, |n: usize, side| n.checked_mul(*side));
    let values = numbers(&header, data, length)?;
    Ok((header.shape, values))
}

/// Reads `length` numbers, `None` for more than there can be.
fn numbers(header: &Header<'_>, data: &[u8], length: Option<usize>) -> Result<Vec<f32>> {
    let (values, size): (Vec<f32>, usize) = match header.descr {
        "<f4" => (elements(data, f32::from_le_bytes), 4),
        "<f8" => (elements(data, |b| f64::from_le_bytes(b) as f32), 8),
        other => {
            return Err(Error::new(format!(
                "the array's type is `{}`, not little-endian float",
                other.escape_debug()
            ))
            .way_out("save it as float32"));
        }
    };
    let stored = length.and_then(|length| length.checked_mul(size));
    if stored != Some(data.len()) {
        return Err(Error::new(format!(
            "truncated or damaged: {} values of {size} bytes are announced, but {} bytes \
             follow the header",
            length.unwrap_or(usize::MAX),
            data.len()
        )));
    }
    Ok(values)
}

fn elements<const N: usize>(data: &[u8], read: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    let (whole, _) = data.as_chunks();
    whole.iter().copied().map(read).collect()
}

/// Splits a file into the header's text and what follows it.
fn split(bytes: &[u8]) -> Result<(&str, &[u8])> {
    let Some(rest) = bytes.strip_prefix(b"\x93NUMPY") else {
        return Err(Error::new("not an .npy file").at("byte 0"));
    };
    let (length, rest) = match *rest {
        [1, _, a, b, ref rest @ ..] => (usize::from(u16::from_le_bytes([a, b])), rest),
        [2 | 3, _, a, b, c, d, ref rest @ ..] => (u32::from_le_bytes([a, b, c, d]) as usize, rest),
        _ => return Err(Error::new("not an .npy file of version 1 to 3").at("byte 6")),
    };
    let (header, data) = rest
        .split_at_checked(length)
        .ok_or_else(|| Error::new("truncated: the file ends within its header"))?;
    let header = std::str::from_utf8(header).map_err(|_| malformed("is not UTF-8"))?;
    Ok((header.trim(), data))
}

fn malformed(what: &str) -> Error {
    Error::new(format!("the .npy header {what}")).way_out("write the file with numpy.save")
}

struct Header<'a> {
    descr: &'a str,
    is_fortran: bool,
    shape: Vec<usize>,
}

impl<'a> Header<'a> {
    /// Parses a Python dict of `descr`, `fortran_order` and `shape`, in any order.
    fn parse(text: &'a str) -> Result<Header<'a>> {
        let mut rest = text
            .strip_prefix('{')
            .and_then(|text| text.strip_suffix('}'))
            .ok_or_else(|| malformed("is not a dict"))?
            .trim();
        let (mut descr, mut shape, mut is_fortran) = (None, None, false);
        while let Some((key, value)) = rest.strip_prefix('\'').and_then(|r| r.split_once("':")) {
            let value = value.trim_start();
            let end = if value.starts_with('(') { ")" } else { "," };
            // The comma after the last value is optional.
            let (value, tail) = value.split_once(end).unwrap_or((value, ""));
            match key {
                "descr" => descr = Some(value.trim().trim_matches('\'')),
                "shape" => shape = Some(tuple(value)?),
                "fortran_order" => is_fortran = value.trim() == "True",
                _ => return Err(malformed("has unknown keys")),
            }
            rest = tail.trim_start_matches([',', ' ']);
        }
        match (rest.trim(), descr, shape) {
            ("", Some(descr), Some(shape)) => Ok(Header {
                descr,
                is_fortran,
                shape,
            }),
            ("", ..) => Err(malformed("lacks `descr` or `shape`")),
            _ => Err(malformed("is malformed")),
        }
    }
}

/// Parses `(3, 1` to `[3, 1]`.
fn tuple(text: &str) -> Result<Vec<usize>> {
    let list = text
        .strip_prefix('(')
        .ok_or_else(|| malformed("has a shape that is not a tuple"))?;
    let mut shape = Vec::new();
    for item in list.split(',').map(str::trim).filter(|i| !i.is_empty()) {
        let n: u32 = item
            .parse()
            .map_err(|_| malformed("has a shape that is not made of counts below 2^32"))?;
        shape.push(n as usize);
    }
    Ok(shape)
}
