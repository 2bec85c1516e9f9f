//! This module opens image files: it checks what the header tells before any pixel is decoded.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::jpeg::{check_end, check_scans};
use crate::error::{Error, Result};
use crate::files::read_file;

/// Longest side of a photograph, pixels.
pub(super) const MAX_SIDE: u32 = 16_384;
/// Most memory that decoding a photograph may take.
const MAX_BYTES: u64 = 1 << 30;
/// More bytes of pixels than this for each byte of a file cannot be in it: a PNG's deflate gains
/// 1032 at most, and a palette's bit becomes 24. A JPEG gains less: it has a bit for every block
/// of every component.
const MAX_GAIN: u64 = 24 * 1032;

/// However little a file has, an image of this many bytes may be in it: WEBP writes one of a single
/// colour in some tens of bytes.
const SMALL: u64 = 8 << 20;

/// Opens a photograph for decoding and returns it with its size: everything that the header tells
/// is checked before any pixel is decoded.
pub(super) fn open_image(bytes: &[u8]) -> Result<(impl ImageDecoder + '_, (u32, u32))> {
    if bytes.is_empty() {
        return Err(Error::new("the image file is empty").way_out("copy the image again"));
    }
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| undecodable(e.into()))?;
    use ImageFormat::{Bmp, Jpeg, Png, WebP};
    if !matches!(reader.format(), Some(Png | Jpeg | WebP | Bmp)) {
        return Err(Error::new(format!(
            "neither a PNG nor a JPEG, WEBP or BMP image{}",
            other_kind(bytes).map_or(String::new(), |kind| format!(" but {kind}"))
        ))
        .way_out("convert it to PNG or JPEG"));
    }
    check_end(bytes)?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(undecodable)?;
    let (width, height) = decoder.dimensions();
    if decoder.total_bytes() > MAX_BYTES {
        return Err(Error::new(format!(
            "a {width}x{height} image takes {} bytes to decode, more than {MAX_BYTES}",
            decoder.total_bytes()
        ))
        .way_out("scale it down"));
    }
    // A header of some bytes may claim any size, and decoders believe it before they look further.
    let is_small = decoder.total_bytes() <= SMALL;
    if !is_small && decoder.total_bytes() / MAX_GAIN > bytes.len() as u64 {
        return Err(Error::new(format!(
            "the header tells of {width}x{height} pixels, which a file of {} bytes cannot hold",
            bytes.len()
        ))
        .way_out("copy the image again"));
    }
    if width == 0 || height == 0 {
        return Err(Error::new(format!("the image is {width}x{height} pixels")));
    }
    Ok((decoder, (width, height)))
}

/// Decodes all pixels of what [`open_image`] opened of `bytes`.
///
/// # Errors
/// Damage, and pixels that are missing.
pub(super) fn decoded(bytes: &[u8], decoder: impl ImageDecoder) -> Result<DynamicImage> {
    check_scans(bytes)?;
    DynamicImage::from_decoder(decoder).map_err(undecodable)
}

/// Says what a file is that is not read, by how it begins: suffixes say little of what was renamed.
fn other_kind(bytes: &[u8]) -> Option<&'static str> {
    let brand = bytes.get(4..12).unwrap_or_default();
    Some(match bytes {
        _ if brand == b"ftypavif" => "an AVIF",
        _ if brand == b"ftypcrx " => "a raw photograph (CR3)",
        _ if [b"ftypheic", b"ftypheix", b"ftypmif1", b"ftypmsf1"]
            .iter()
            .any(|b| *b == brand) =>
        {
            "a HEIC"
        }
        // Its decoder takes a thousand times a file's size where the file says so.
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => "a TIFF",
        [b'G', b'I', b'F', b'8', ..] => "a GIF",
        [0xff, 0x0a, ..] | [0, 0, 0, 0x0c, b'J', b'X', b'L', ..] => "a JPEG XL",
        [b'8', b'B', b'P', b'S', ..] => "a Photoshop file",
        [b'v', b'e', b'r', b's', b'i', b'o', b'n', ..] => "a link to a file in Git LFS",
        [b'<', ..] => "a web page",
        _ => return None,
    })
}

/// Reads the width and height of the photograph in `path`, by its content.
///
/// # Errors
/// As of [`open_image`].
pub(super) fn size_of(path: &Path) -> Result<(u32, u32)> {
    let bytes = read_file(path)?;
    open_image(&bytes)
        .map(|(_, size)| size)
        .map_err(|e| e.at_path(path))
}

fn undecodable(e: image::ImageError) -> Error {
    Error::new(format!("cannot decode the image: {e}")).way_out(format!(
        "give PNG, JPEG, WEBP or BMP files of at most {MAX_SIDE} pixels a side"
    ))
}

/// Returns whether the larger of two sizes, scaled to the width of the smaller, has its height
/// within a pixel: sizes are rounded when images are scaled.
pub(super) fn same_aspect(a: (u32, u32), b: (u32, u32)) -> bool {
    let (small, large) = if a.0 <= b.0 { (a, b) } else { (b, a) };
    let scale = f64::from(small.0) / f64::from(large.0);
    (f64::from(large.1) * scale - f64::from(small.1)).abs() <= 1.0
}
