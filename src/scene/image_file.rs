//! Image files: what the header tells is checked before any pixel is decoded.

use std::io::Cursor;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::jpeg::check_whole;
use crate::error::{Error, Result};

/// Longest side of a photograph, pixels.
const MAX_SIDE: u32 = 16_384;
/// Most memory that decoding a photograph may take.
const MAX_BYTES: u64 = 1 << 30;
/// More bytes of pixels than this for each byte of a file cannot be in it: a PNG's deflate gains
/// 1032 at most, and a palette's bit becomes 24. A JPEG gains less: it has a bit for every block
/// of every component.
const MAX_GAIN: u64 = 24 * 1032;

/// A PNG or JPEG ready to be decoded, and its size: everything that the header tells is checked
/// before any pixel is decoded.
pub(super) fn open_image(bytes: &[u8]) -> Result<(impl ImageDecoder + '_, (u32, u32))> {
    if bytes.is_empty() {
        return Err(Error::new("the image file is empty").way_out("copy the image again"));
    }
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| undecodable(e.into()))?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg)) {
        return Err(Error::new("neither a PNG nor a JPEG image").way_out("convert it to PNG"));
    }
    check_whole(bytes)?;
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
    if decoder.total_bytes() / MAX_GAIN > bytes.len() as u64 {
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

/// All pixels of what [`open_image`] opened.
pub(super) fn decoded(decoder: impl ImageDecoder) -> Result<DynamicImage> {
    DynamicImage::from_decoder(decoder).map_err(undecodable)
}

fn undecodable(e: image::ImageError) -> Error {
    Error::new(format!("cannot decode the image: {e}")).way_out(format!(
        "give PNG or JPEG files of at most {MAX_SIDE} pixels a side"
    ))
}

/// Whether the larger of two sizes, scaled to the width of the smaller, has its height within
/// a pixel: sizes are rounded when images are scaled.
pub(super) fn same_aspect(a: (u32, u32), b: (u32, u32)) -> bool {
    let (small, large) = if a.0 <= b.0 { (a, b) } else { (b, a) };
    let scale = f64::from(small.0) / f64::from(large.0);
    (f64::from(large.1) * scale - f64::from(small.1)).abs() <= 1.0
}
