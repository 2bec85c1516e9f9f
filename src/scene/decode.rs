//! Photographs from disk: decoding within limits, and scaling to the asked size.

use std::io::Cursor;

use image::imageops::{FilterType, resize};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, RgbImage};

use super::images::PosedImage;
use super::masks::{Masks, alpha_mask, read_mask};
use super::{Image, LoadOptions, View};
use crate::camera::Camera;
use crate::error::{Error, Result, read_file};

/// Longest side of a photograph, pixels.
const MAX_SIDE: u32 = 16_384;
/// Most memory that decoding a photograph may take.
const MAX_BYTES: u64 = 1 << 30;

/// A view, and the size that its camera had been given if the photograph has another one.
pub(super) struct Decoded {
    pub view: View,
    pub rescaled_from: Option<(u32, u32)>,
}

/// Decodes the photograph and scales it as `options` ask, its camera along with it and its mask,
/// which is that of `masks` or else the photograph's alpha channel.
///
/// An EXIF orientation is not applied: poses are those of the pixels as stored.
///
/// # Errors
///
/// Files that are unreadable, no PNG or JPEG, damaged or too large; photographs whose size is
/// not that of their camera in another resolution; masks that are none.
pub(super) fn decode(posed: &PosedImage, masks: &Masks, options: &LoadOptions) -> Result<Decoded> {
    let bytes = read_file(&posed.path)?;
    let (image, camera) = decode_bytes(&bytes, posed).map_err(|e| e.at_path(&posed.path))?;
    let size = (image.width(), image.height());
    let target = target_size(size.0, size.1, options);
    let mask = match masks.file(&camera.name) {
        Some(path) => Some(read_mask(&path, size, target)?),
        None => alpha_mask(&image, target),
    };
    let image = image.into_rgb8();
    let image = if size == target {
        image
    } else {
        resize(&image, target.0, target.1, FilterType::Lanczos3)
    };
    let stated = (camera.width, camera.height);
    Ok(Decoded {
        view: View {
            camera: camera.resized(target.0, target.1),
            image: from_rgb(image),
            mask,
        },
        rescaled_from: (stated != size).then_some(stated),
    })
}

/// The photograph, which has its camera's shape, at full size.
fn decode_bytes<'a>(bytes: &[u8], posed: &'a PosedImage) -> Result<(DynamicImage, &'a Camera)> {
    let camera = &posed.camera;
    let (decoder, (width, height)) = open_image(bytes)?;
    let stated = (camera.width, camera.height);
    if !same_aspect(stated, (width, height)) {
        let turned = same_aspect((camera.height, camera.width), (width, height));
        return Err(Error::new(format!(
            "the image is {width}x{height} pixels but its camera is {}x{}",
            camera.width, camera.height
        ))
        .way_out(if turned {
            "the image is stored sideways: turn its pixels (EXIF orientation is not applied)"
        } else {
            "use the images that the model was made from, or the same at another resolution"
        }));
    }
    Ok((decoded(decoder)?, camera))
}

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

fn from_rgb(image: RgbImage) -> Image {
    Image {
        width: image.width(),
        height: image.height(),
        rgb: image.into_raw(),
    }
}

/// Whether the larger of two sizes, scaled to the width of the smaller, has its height within
/// a pixel: sizes are rounded when images are scaled.
pub(super) fn same_aspect(a: (u32, u32), b: (u32, u32)) -> bool {
    let (small, large) = if a.0 <= b.0 { (a, b) } else { (b, a) };
    let scale = f64::from(small.0) / f64::from(large.0);
    (f64::from(large.1) * scale - f64::from(small.1)).abs() <= 1.0
}

/// The size at which an image is used: the bounded side becomes exactly its bound, the other
/// is rounded to the nearest pixel and at least 1; images within the bound keep their size.
/// Intrinsics then scale with the two exact ratios, so that rounding moves no ray.
pub(super) fn target_size(width: u32, height: u32, options: &LoadOptions) -> (u32, u32) {
    let (side, bound) = match options.max_size {
        Some(max_size) => (width.max(height), max_size),
        None => (width, options.max_width),
    };
    if side <= bound {
        return (width, height);
    }
    let scaled = |length: u32| {
        let exact = u64::from(length) * u64::from(bound);
        let rounded = (2 * exact + u64::from(side)) / (2 * u64::from(side));
        (rounded as u32).max(1)
    };
    (scaled(width), scaled(height))
}
