//! This module decodes photographs from disk, undistorted and scaled to the asked size.

use image::imageops::{FilterType, resize};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, RgbImage};

use super::fitted::{Fit, Fitted, fitted};
use super::image_file::{decoded, open_image};
use super::images::PosedImage;
use super::layout::PosedCamera;
use super::masks::{AlphaIs, Levels, Masks, Unbelieved};
use super::undistort::{Cut, Undistortion};
use super::window::Window;
use super::{Image, LoadOptions, View};
use crate::camera::bounded_size;
use crate::error::{Error, Result};
use crate::files::read_file;

/// A view, and what was done to it.
pub(super) struct Decoded {
    pub view: View,
    /// Why its alpha channel is no mask, where it has one that is none.
    pub unbelieved: Option<Unbelieved>,
    /// The window that an alpha channel, taken as its mask, may be; `None` if the options say what
    /// it is.
    pub window: Option<Option<Window>>,
    /// Whether its EXIF data ask for it to be turned for display.
    pub is_turned: bool,
    pub fit: Fit,
    /// The size that its camera had been given.
    pub stated: (u32, u32),
    /// The part of a fisheye photograph that is left.
    pub cut: Option<Cut>,
}

/// Decodes the photograph and its mask, which is that of `masks` or else the photograph's alpha
/// channel; puts the background behind it where the mask asks for that; undistorts both if the
/// camera is no pinhole one; and scales both as `options` ask, the camera along with them.
///
/// An EXIF orientation is not applied: poses are those of the pixels as stored.
///
/// # Errors
///
/// Files that are unreadable, of no format that is read, damaged or too large; photographs that do
/// not fit their camera as [`fitted`] has it, or whose distortion cannot be undone; masks that are
/// none.
pub(super) fn decode(
    photograph: &PosedImage,
    masks: &Masks,
    alpha: AlphaIs,
    options: &LoadOptions,
) -> Result<Decoded> {
    let PosedImage { posed, path } = photograph;
    let here = |e: Error| e.at_path(path);
    let Whole {
        image,
        fitted: Fitted { mut camera, how },
        is_turned,
    } = decode_bytes(&read_file(path)?, posed).map_err(here)?;
    let file = posed
        .mask
        .clone()
        .or_else(|| masks.file(&posed.camera.name));
    let (mut mask, unbelieved) = Levels::of(file, &image, options.outside_mask, alpha)?;
    let mut image = image.into_rgb8();
    if let Some(mask) = &mask {
        mask.cut_out(&mut image, options.background);
    }
    let mut cut = None;
    if let Some(distortion) = posed.distortion {
        let undistortion = Undistortion::new(camera, distortion).map_err(here)?;
        cut = distortion.fisheye.then(|| undistortion.cut());
        image = undistortion.apply(&image);
        mask = mask.map(|mask| Levels {
            levels: undistortion.apply(&mask.levels),
            ..mask
        });
        camera = undistortion.pinhole;
    }
    let target = target_size(image.width(), image.height(), options);
    if image.dimensions() != target {
        image = resize(&image, target.0, target.1, FilterType::Lanczos3);
    }
    Ok(Decoded {
        window: mask.as_ref().and_then(|mask| mask.window),
        view: View {
            camera: camera.resized(target.0, target.1),
            image: from_rgb(image),
            mask: mask.map(|mask| mask.mask(target)),
            prior: None,
        },
        fit: how,
        stated: (posed.camera.width, posed.camera.height),
        cut,
        unbelieved,
        is_turned,
    })
}

/// A photograph at full size.
struct Whole {
    image: DynamicImage,
    /// The camera of all of it.
    fitted: Fitted,
    /// Whether its EXIF data would have it turned.
    is_turned: bool,
}

/// Decodes the photograph at full size.
fn decode_bytes(bytes: &[u8], posed: &PosedCamera) -> Result<Whole> {
    let (mut decoder, (width, height)) = open_image(bytes)?;
    let camera = &posed.camera;
    let Some(fitted) = fitted(camera, (width, height)) else {
        let turned = fitted(camera, (height, width)).is_some();
        return Err(Error::new(format!(
            "the image is {width}x{height} pixels but its camera is {}x{}",
            camera.width, camera.height
        ))
        .way_out(if turned {
            "the image is stored sideways: turn its pixels (EXIF orientation is not applied)"
        } else {
            "use the images that the model was made from, or the same at another resolution"
        }));
    };
    // Broken EXIF data ask for nothing.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let is_turned = orientation != Orientation::NoTransforms;
    Ok(Whole {
        image: decoded(bytes, decoder)?,
        fitted,
        is_turned,
    })
}

fn from_rgb(image: RgbImage) -> Image {
    Image {
        width: image.width(),
        height: image.height(),
        rgb: image.into_raw(),
    }
}

/// Returns the size at which an image is used. Intrinsics then scale with the two exact ratios, so
/// that rounding moves no ray.
pub(super) fn target_size(width: u32, height: u32, options: &LoadOptions) -> (u32, u32) {
    let (side, bound) = match options.max_size {
        Some(max_size) => (width.max(height), max_size),
        None => (width, options.max_width),
    };
    bounded_size((width, height), side, bound)
}
