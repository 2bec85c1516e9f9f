//! Photographs from disk, undistorted and scaled to the asked size.

use image::imageops::{FilterType, resize};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, RgbImage};

use super::image_file::{decoded, open_image, same_aspect};
use super::images::PosedImage;
use super::layout::PosedCamera;
use super::masks::{Levels, Masks, Unbelieved};
use super::undistort::Undistortion;
use super::{Image, LoadOptions, View};
use crate::camera::{Camera, bounded_size};
use crate::error::{Error, Result};
use crate::files::read_file;

/// A view, and the size that its camera had been given if the photograph has another one.
pub(super) struct Decoded {
    pub view: View,
    pub rescaled_from: Option<(u32, u32)>,
    /// Why its alpha channel is no mask, where it has one that is none.
    pub unbelieved: Option<Unbelieved>,
    /// Whether its EXIF data ask for it to be turned for display.
    pub is_turned: bool,
}

/// Decodes the photograph and its mask, which is that of `masks` or else the photograph's alpha
/// channel; puts the background behind it where the mask asks for that; undistorts both if the
/// camera is no pinhole one; and scales both as `options` ask, the camera along with them.
///
/// An EXIF orientation is not applied: poses are those of the pixels as stored.
///
/// # Errors
///
/// Files that are unreadable, no PNG or JPEG, damaged or too large; photographs whose size is
/// not that of their camera in another resolution, or whose distortion cannot be undone; masks
/// that are none.
pub(super) fn decode(
    photograph: &PosedImage,
    masks: &Masks,
    options: &LoadOptions,
) -> Result<Decoded> {
    let PosedImage { posed, path } = photograph;
    let here = |e: Error| e.at_path(path);
    let (image, is_turned) = decode_bytes(&read_file(path)?, &posed.camera).map_err(here)?;
    let size = (image.width(), image.height());
    let stated = (posed.camera.width, posed.camera.height);
    let file = masks.file(&posed.camera.name);
    let (mut mask, unbelieved) = Levels::of(file, &image, options.outside_mask)?;
    let mut image = image.into_rgb8();
    if let Some(mask) = &mask {
        mask.cut_out(&mut image, options.background);
    }
    let mut camera = posed.camera.clone();
    if let Some(undistortion) = undistortion(posed, size).map_err(here)? {
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
        view: View {
            camera: camera.resized(target.0, target.1),
            image: from_rgb(image),
            mask: mask.map(|mask| mask.mask(target)),
        },
        rescaled_from: (stated != size).then_some(stated),
        unbelieved,
        is_turned,
    })
}

/// What a photograph of `size` pixels needs to become a pinhole camera's, if anything.
fn undistortion(posed: &PosedCamera, size: (u32, u32)) -> Result<Option<Undistortion>> {
    let camera = posed.camera.resized(size.0, size.1);
    let distortion = posed.distortion;
    distortion.map(|d| Undistortion::new(camera, d)).transpose()
}

/// The photograph, which has its camera's shape, at full size, and whether its EXIF data would have it
/// turned.
fn decode_bytes(bytes: &[u8], camera: &Camera) -> Result<(DynamicImage, bool)> {
    let (mut decoder, (width, height)) = open_image(bytes)?;
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
    // Broken EXIF data ask for nothing.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    Ok((decoded(decoder)?, orientation != Orientation::NoTransforms))
}

fn from_rgb(image: RgbImage) -> Image {
    Image {
        width: image.width(),
        height: image.height(),
        rgb: image.into_raw(),
    }
}

/// The size at which an image is used. Intrinsics then scale with the two exact ratios, so that
/// rounding moves no ray.
pub(super) fn target_size(width: u32, height: u32, options: &LoadOptions) -> (u32, u32) {
    let (side, bound) = match options.max_size {
        Some(max_size) => (width.max(height), max_size),
        None => (width, options.max_width),
    };
    bounded_size((width, height), side, bound)
}
