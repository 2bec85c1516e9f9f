//! A layout is what a format's reader finds in a scene folder.

use std::path::PathBuf;

use glam::{DMat3, DVec3};

use super::lens::Distortion;
use crate::camera::{Camera, check_lens};
use crate::error::{Error, Result};

/// Sides of images, and of the cameras that took them, beyond this are refused.
const MAX_SIDE: f64 = (1 << 20) as f64;

/// A scene folder, read but for its images and points.
pub(super) struct Layout {
    /// The files that were taken, relative to the scene folder.
    pub source: String,
    /// Every pose, at the model's resolution and under the model's name for the image.
    pub cameras: Vec<PosedCamera>,
    /// Names of posed images that cannot be used, and why not. One whose photograph is not there
    /// is not judged.
    pub unusable: Vec<(String, Error)>,
    /// The folder that the images' names are relative to.
    pub image_dir: PathBuf,
    /// The scene's own cloud, or the error that it has none.
    pub cloud: Result<PathBuf>,
    /// The views that the format itself sets apart.
    pub split: Option<NamedSplit>,
    /// Lines that say what was assumed or left out.
    pub warnings: Vec<String>,
}

/// The camera of an image.
#[derive(Clone, Debug)]
pub(super) struct PosedCamera {
    pub camera: Camera,
    pub distortion: Option<Distortion>,
    /// Whether the pose was interpolated between others, not found from the image.
    pub interpolated: bool,
    /// The file of the image's mask, where the format names one.
    pub mask: Option<PathBuf>,
}

/// Names of training and test views, and the file or folder that lists them.
#[derive(Debug)]
pub(super) struct NamedSplit {
    pub train: Vec<String>,
    /// Names of the test views; `None`: drawn from the rest.
    pub test: Option<Vec<String>>,
    pub place: PathBuf,
}

/// A lens and the image behind it; lengths in pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Intrinsics {
    pub width: u32,
    pub height: u32,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    pub distortion: Option<Distortion>,
}

impl Intrinsics {
    /// Checks and takes `params`, `[fx, fy, cx, cy]`.
    ///
    /// # Errors
    ///
    /// Values that no camera has. Whether a distortion can be undone is seen when it is.
    pub(crate) fn new(
        size: [f64; 2],
        params: [f64; 4],
        distortion: Distortion,
    ) -> Result<Intrinsics> {
        let [width, height] = size;
        let fits = |side: f64| (1.0..=MAX_SIDE).contains(&side) && side.fract() == 0.0;
        if !fits(width) || !fits(height) {
            return Err(Error::new(format!(
                "image size {width}x{height} is not within 1 to {MAX_SIDE}"
            )));
        }
        let [fx, fy, cx, cy] = params;
        check_lens([fx, fy], [cx, cy])?;
        Ok(Intrinsics {
            width: width as u32,
            height: height as u32,
            fx,
            fy,
            cx,
            cy,
            distortion: distortion.checked()?,
        })
    }

    /// Returns the camera of the image `name`; `rotation` and `translation` are world-to-camera.
    pub(crate) fn posed(&self, name: String, rotation: DMat3, translation: DVec3) -> PosedCamera {
        PosedCamera {
            camera: Camera {
                name,
                width: self.width,
                height: self.height,
                fx: self.fx,
                fy: self.fy,
                cx: self.cx,
                cy: self.cy,
                rotation,
                translation,
            },
            distortion: self.distortion,
            interpolated: false,
            mask: None,
        }
    }
}
