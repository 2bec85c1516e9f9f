//! Photographs from disk: decoding within limits, and scaling to the asked size.

use std::io::Cursor;

use image::imageops::{FilterType, resize};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, RgbImage};

use super::images::PosedImage;
use super::layout::PosedCamera;
use super::lens::pinhole;
use super::undistort::undistort;
use super::{Image, LoadOptions, View};
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

/// Decodes the photograph, undistorts it if its camera is not a pinhole one, and scales it as
/// `options` ask, its camera along with it.
///
/// An EXIF orientation is not applied: poses are those of the pixels as stored.
///
/// # Errors
///
/// Files that are unreadable, no PNG or JPEG, damaged or too large; photographs whose size is
/// not that of their camera in another resolution.
pub(super) fn decode(image: &PosedImage, options: &LoadOptions) -> Result<Decoded> {
    let bytes = read_file(&image.path)?;
    decode_bytes(&bytes, &image.posed, options).map_err(|e| e.at_path(&image.path))
}

fn decode_bytes(bytes: &[u8], posed: &PosedCamera, options: &LoadOptions) -> Result<Decoded> {
    let camera = &posed.camera;
    let undecodable = |e: image::ImageError| {
        Error::new(format!("cannot decode the image: {e}")).way_out(format!(
            "give PNG or JPEG files of at most {MAX_SIDE} pixels a side"
        ))
    };
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
    // Everything that the header tells is checked before any pixel is decoded.
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
    let mut image = DynamicImage::from_decoder(decoder)
        .map_err(undecodable)?
        .into_rgb8();
    let mut camera = camera.clone();
    if let Some(distortion) = &posed.distortion {
        camera = camera.resized(width, height);
        let undistorted = pinhole(&camera, distortion)?;
        image = undistort(&image, &camera, distortion, &undistorted);
        camera = undistorted;
    }

    let (new_width, new_height) = target_size(image.width(), image.height(), options);
    if (new_width, new_height) != image.dimensions() {
        image = resize(&image, new_width, new_height, FilterType::Lanczos3);
    }
    Ok(Decoded {
        view: View {
            camera: camera.resized(new_width, new_height),
            image: from_rgb(image),
        },
        rescaled_from: (stated != (width, height)).then_some(stated),
    })
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
fn same_aspect(a: (u32, u32), b: (u32, u32)) -> bool {
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
