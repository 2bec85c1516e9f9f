//! A reader of `.npy` arrays: little-endian f4, f8, u1, u2 in C order.

use std::path::Path;

/// An array, its values widened to f64 (which holds all four types exactly).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
}

/// Reads a file; its absence or a header that is not understood is a failed test.
pub(crate) fn read(path: &Path) -> Array {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    parse(&bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// [`read`], and the shape must be the one given.
pub(crate) fn read_shaped(path: &Path, shape: &[usize]) -> Vec<f64> {
    let array = read(path);
    assert_eq!(array.shape, shape, "{}", path.display());
    array.values
}

/// Parses a whole file.
pub(crate) fn parse(bytes: &[u8]) -> Result<Array, String> {
    if !bytes.starts_with(b"\x93NUMPY") {
        return Err("no npy magic".into());
    }
    let (start, length) = match bytes.get(6..12) {
        Some(&[1, _, a, b, ..]) => (10, usize::from(u16::from_le_bytes([a, b]))),
        Some(&[2 | 3, _, a, b, c, d]) => (12, u32::from_le_bytes([a, b, c, d]) as usize),
        _ => return Err("unknown npy version".into()),
    };
    let header = bytes.get(start..start + length).ok_or("truncated header")?;
    let header = std::str::from_utf8(header).map_err(|e| e.to_string())?;
    let field = |key: &str, end: char| -> Result<&str, String> {
        let after = header.split(&format!("'{key}':")).nth(1);
        after
            .and_then(|rest| rest.split_once(end))
            .map(|(value, _)| value.trim())
            .ok_or(format!("no {key} in the header"))
    };
    if field("fortran_order", ',')? != "False" {
        return Err("Fortran order".into());
    }
    let shape = field("shape", ')')?
        .trim_start_matches('(')
        .split(',')
        .map(str::trim)
        .filter(|s| !s.is_empty())
        .map(|s| s.parse().map_err(|_| format!("bad shape entry `{s}`")))
        .collect::<Result<Vec<usize>, String>>()?;
    let data = &bytes[start + length..];
    let values: Vec<f64> = match field("descr", ',')?.trim_matches('\'') {
        "<f4" => elements(data, |b| f64::from(f32::from_le_bytes(b)))?,
        "<f8" => elements(data, f64::from_le_bytes)?,
        "|u1" => elements(data, |[b]| f64::from(b))?,
        "<u2" => elements(data, |b| f64::from(u16::from_le_bytes(b)))?,
        other => return Err(format!("type `{other}` is not read")),
    };
    if values.len() != shape.iter().product::<usize>() {
        return Err(format!("{} values for shape {shape:?}", values.len()));
    }
    Ok(Array { shape, values })
}

fn elements<const N: usize>(
    data: &[u8],
    read: impl Fn([u8; N]) -> f64,
) -> Result<Vec<f64>, String> {
    let (whole, rest) = data.as_chunks();
    if rest.is_empty() {
        Ok(whole.iter().copied().map(read).collect())
    } else {
        Err("truncated data".into())
    }
}
