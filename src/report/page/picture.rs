//! Pictures within the page are small JPEGs as data URIs.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use super::super::plot::viridis;
use super::super::sheet::shrunk;
use crate::error::{Error, Result};
use crate::scene::Image;

const JPEG_QUALITY: u8 = 80;

/// Longer side of a test view's pictures, pixels, where there are few.
const MAX_SIDE: u32 = 480;

/// Longer side of a test view's pictures if there are many, pixels.
const MIN_SIDE: u32 = 64;

/// Most pixels of all pictures of one kind together: some 0.6 MB of photographs, 1.1 MB of error
/// maps.
pub(crate) const MAX_PIXELS: u32 = 2_000_000;

/// Mean error of the channels that takes the last colour of the map, of 1.
pub(crate) const MAX_ERROR: f64 = 0.25;

pub(crate) fn base64(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

/// A picture of the page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Picture {
    pub width: u32,
    pub height: u32,
    /// `data:image/jpeg;base64,...`
    pub uri: String,
}

/// Returns the longer side of each of `n` pictures shaped like `image` so that they keep the page
/// small, pixels.
pub(crate) fn side_of(n: usize, image: &Image) -> u32 {
    let (width, height) = (f64::from(image.width), f64::from(image.height));
    let each = f64::from(MAX_PIXELS) / n.max(1) as f64;
    let side = (each * width.max(height) / width.min(height)).sqrt();
    MAX_SIDE.min(side as u32).max(MIN_SIDE)
}

/// Encodes `image` as a JPEG whose longer side is at most `side` pixels.
pub(crate) fn picture(image: &Image, side: u32) -> Result<Picture> {
    encode(&small(image, side)?)
}

/// Encodes `image` as the bytes of a JPEG whose longer side is at most `side` pixels.
pub(crate) fn jpeg(image: &Image, side: u32) -> Result<Vec<u8>> {
    encoded(&small(image, side)?)
}

/// Draws the mean absolute error of the channels in every pixel, as colours up to [`MAX_ERROR`].
///
/// # Errors
/// Pictures of two sizes.
pub(crate) fn error_map(render: &Image, truth: &Image, side: u32) -> Result<Picture> {
    if (render.width, render.height) != (truth.width, truth.height) {
        return Err(Error::new(format!(
            "a render of {}x{} and a photograph of {}x{} do not compare",
            render.width, render.height, truth.width, truth.height
        )));
    }
    let pixels = render.rgb.chunks_exact(3).zip(truth.rgb.chunks_exact(3));
    let errors = pixels.flat_map(|(a, b)| {
        let sum: u32 = a
            .iter()
            .zip(b)
            .map(|(a, b)| u32::from(a.abs_diff(*b)))
            .sum();
        let share = f64::from(sum) / (3.0 * 255.0 * MAX_ERROR);
        [(255.0 * share.min(1.0)).round() as u8; 3]
    });
    let grey = Image {
        rgb: errors.collect(),
        ..*render
    };
    // Errors are averaged, not their colours.
    let mut map = small(&grey, side)?;
    for pixel in map.rgb.chunks_exact_mut(3) {
        pixel.copy_from_slice(&viridis(f64::from(pixel[0]) / 255.0));
    }
    encode(&map)
}

fn small(image: &Image, side: u32) -> Result<Image> {
    let pixels = shrunk(image, side, side)?;
    Ok(Image {
        width: pixels.width(),
        height: pixels.height(),
        rgb: pixels.into_raw(),
    })
}

fn encode(image: &Image) -> Result<Picture> {
    Ok(Picture {
        width: image.width,
        height: image.height,
        uri: format!("data:image/jpeg;base64,{}", base64(&encoded(image)?)),
    })
}

fn encoded(image: &Image) -> Result<Vec<u8>> {
    let &Image { width, height, .. } = image;
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .encode(&image.rgb, width, height, ExtendedColorType::Rgb8)
        .map_err(|e| Error::new(format!("cannot encode as JPEG: {e}")))?;
    Ok(bytes)
}
