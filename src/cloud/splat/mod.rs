//! Point splatting: the cloud drawn into a camera as squares, with a mask of what it covers, and
//! the holes between filled from around.

mod fill;
mod filter;
mod z_buffer;

pub use fill::fill_holes;
pub(crate) use filter::Filter;
pub(crate) use z_buffer::{Points, Winner, ZBuffer};

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::{Camera, Frame};
use crate::config::SplatConfig;
use crate::error::{Error, Result};
use crate::scene::PointCloud;

/// A splatted image with its mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplatImage {
    pub width: u32,
    pub height: u32,
    /// `height * width * 4` bytes, row 0 on top: sRGB as in the cloud and alpha 255 where a
    /// point was drawn; all 0 elsewhere.
    pub rgba: Vec<u8>,
}

impl SplatImage {
    /// Whether each pixel is covered, row by row.
    pub fn mask(&self) -> impl Iterator<Item = bool> + '_ {
        self.rgba.chunks_exact(4).map(|p| p[3] != 0)
    }

    /// The share of covered pixels.
    pub fn coverage(&self) -> f64 {
        let n_pixels = self.rgba.len() / 4;
        self.mask().filter(|m| *m).count() as f64 / n_pixels.max(1) as f64
    }
}

/// Splats the cloud into every camera, in parallel over cameras.
///
/// A point covers a square of `config.size_px` pixels, aligned to the pixels and centred as
/// well as that allows. The nearest point wins a pixel; depths are compared rounded to f32, and
/// of equal ones the lower index wins. Then the connectivity filter empties covered pixels with
/// fewer than `config.filter_min_neighbors` other covered pixels in their window, all decided
/// on the unfiltered mask. Points nearer than `near * frame.radius` are not drawn, nor are those
/// whose [`PointCloud::relative_confidence`] is below `config.min_confidence`.
///
/// Memory: 4 bytes a pixel for every camera, and 9 a pixel for every thread at work. The result
/// does not depend on the number of threads.
///
/// # Errors
/// A splat size of 0, an even filter window, an empty image, or more than 2^32 - 2 points.
pub fn splat_views(
    cloud: &PointCloud,
    frame: &Frame,
    cameras: &[Camera],
    config: &SplatConfig,
    near: f64,
) -> Result<Vec<SplatImage>> {
    splat_where(cloud, frame, cameras, config, near, |_, _| true)
}

/// [`splat_views`] in which a pixel is left empty whose point's index and camera's canonical
/// centre `shows` refuses.
///
/// # Errors
/// As [`splat_views`].
pub fn splat_where(
    cloud: &PointCloud,
    frame: &Frame,
    cameras: &[Camera],
    config: &SplatConfig,
    near: f64,
    shows: impl Fn(usize, DVec3) -> bool + Sync,
) -> Result<Vec<SplatImage>> {
    check(cameras, config)?;
    let mut points = Points::new(cloud, frame)?;
    if let Some(confidence) = cloud.relative_confidence() {
        points.hide(confidence.iter().map(|c| *c < config.min_confidence));
    }
    Ok(cameras
        .par_iter()
        .map_init(Scratch::default, |(z_buffer, filter), camera| {
            let camera = frame.camera_to_canonical(camera);
            points.draw(&camera, config.size_px, near, z_buffer);
            let mut rgba = vec![0; 4 * z_buffer.winners().len()];
            let eye = camera.center();
            filter.kept(z_buffer, config, |pixel, winner| {
                if shows(winner.point, eye) {
                    let [r, g, b] = cloud.colors[winner.point];
                    rgba[4 * pixel..][..4].copy_from_slice(&[r, g, b, 255]);
                }
            });
            SplatImage {
                width: camera.width,
                height: camera.height,
                rgba,
            }
        })
        .collect())
}

/// What a thread reuses from view to view.
type Scratch = (ZBuffer, Filter);

/// What splatting into `cameras` needs.
///
/// # Errors
/// A splat size of 0, an even filter window, or an empty image.
pub(crate) fn check(cameras: &[Camera], config: &SplatConfig) -> Result<()> {
    if config.size_px == 0 {
        return Err(Error::usage("splat.size_px must be at least 1"));
    }
    if config.filter_window_px.is_multiple_of(2) {
        return Err(Error::usage(format!(
            "splat.filter_window_px is {}, but must be odd",
            config.filter_window_px
        )));
    }
    check_size(cameras)
}

/// # Errors
/// An image without pixels.
pub(crate) fn check_size(cameras: &[Camera]) -> Result<()> {
    match cameras.iter().find(|c| c.width == 0 || c.height == 0) {
        Some(camera) => Err(Error::new("the image has no pixels").at(&camera.name)),
        None => Ok(()),
    }
}
