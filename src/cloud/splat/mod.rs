//! Point splatting draws the cloud into a camera, with a mask of what it covers, and fills the
//! holes between from around.
//!
//! A point's footprint ([`Footprint`]) is one of two:
//!
//! - `pixel`: the pixel that it falls into. The nearest point wins. If points are sparser than
//!   pixels, those behind a surface show through it.
//! - `disc`: surface splatting in two passes (Botsch and Kobbelt 2003, "High-Quality Point-Based
//!   Rendering on Modern GPUs"). A disc's radius is that of the point's source pixel, projected:
//!   `sqrt(n_pixels / n_points) min_i |x - o_i| / f_i` over the training cameras `i`, times `f /
//!   z`, and between 0.708 pixels (so that no point falls between pixels) and `max_radius_px`. The
//!   first pass, the visibility pass, keeps the depth `z*` of the nearest disc that holds a pixel's
//!   centre. In the second, all discs there with `z <= (1 + depth_tolerance) z*` blend with the
//!   weights `(1 - d^2 / (2 r^2))^2`, `d` from the disc's centre to the pixel's, and their sum is
//!   divided by that of the weights. As every weight within a disc is a quarter or more, a pixel is
//!   covered wherever a disc is. Discs are parallel to the image: the cloud has no normals.
//!
//! The connectivity filter follows both.

mod disc;
mod fill;
mod filter;
mod points;
mod z_buffer;

pub(crate) use disc::{Blend, Disc};
pub use fill::fill_holes;
pub(crate) use filter::Filter;
pub(crate) use points::{BYTES_A_POINT, Points};
pub(crate) use z_buffer::{Winner, ZBuffer};

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::{Camera, Frame};
use crate::config::{Footprint, MIN_DISC_RADIUS_PX, SplatConfig};
use crate::error::{Error, Result};
use crate::scene::PointCloud;

/// A splatted image with its mask.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatImage {
    /// Columns of pixels.
    pub width: u32,
    /// Rows of pixels.
    pub height: u32,
    /// `height * width * 4` bytes, row 0 on top: sRGB as in the cloud and alpha 255 where a
    /// point was drawn; all 0 elsewhere.
    pub rgba: Vec<u8>,
    /// `height * width` depths, canonical, of the nearest point in every covered pixel; 0 elsewhere.
    pub depths: Vec<f32>,
}

impl SplatImage {
    /// Returns whether each pixel is covered, row by row.
    pub fn mask(&self) -> impl Iterator<Item = bool> + '_ {
        self.rgba.chunks_exact(4).map(|p| p[3] != 0)
    }

    /// Returns the share of covered pixels.
    pub fn coverage(&self) -> f64 {
        let n_pixels = self.rgba.len() / 4;
        self.mask().filter(|m| *m).count() as f64 / n_pixels.max(1) as f64
    }
}

/// Splats the cloud into every camera, in parallel over cameras, as the [module](self) says.
///
/// `cameras` and the training cameras `sources`, which the discs' radii come from, are of the world
/// frame. Depths are compared rounded to f32, and of equal ones the lower index is the nearer. Then
/// the connectivity filter empties covered pixels with fewer than `config.filter_min_neighbors`
/// other covered pixels in their window, all decided on the unfiltered mask. Points nearer than
/// `near`, canonical, are not drawn.
///
/// Memory: 8 bytes a pixel for every camera, and for every thread at work 9 a pixel, or 25 for
/// discs. The result does not depend on the number of threads.
///
/// # Errors
/// A largest radius below [`MIN_DISC_RADIUS_PX`], an even filter window, an empty image, or more
/// than 2^32 - 2 points.
pub fn splat_views(
    cloud: &PointCloud,
    frame: &Frame,
    (cameras, sources): (&[Camera], &[Camera]),
    config: &SplatConfig,
    near: f64,
) -> Result<Vec<SplatImage>> {
    splat_where(cloud, frame, (cameras, sources), config, near, |_, _| true)
}

/// Does what [`splat_views`] does, but leaves a pixel empty whose nearest point's index and
/// camera's canonical centre `shows` refuses.
///
/// # Errors
/// As [`splat_views`].
pub fn splat_where(
    cloud: &PointCloud,
    frame: &Frame,
    (cameras, sources): (&[Camera], &[Camera]),
    config: &SplatConfig,
    near: f64,
    shows: impl Fn(usize, DVec3) -> bool + Sync,
) -> Result<Vec<SplatImage>> {
    check(cameras, config)?;
    let points = drawn_points(cloud, frame, sources, config)?;
    Ok(cameras
        .par_iter()
        .map_init(Scratch::default, |scratch, camera| {
            let Scratch {
                z_buffer,
                filter,
                blend,
            } = scratch;
            let camera = frame.camera_to_canonical(camera);
            points.draw(&camera, config, near, z_buffer);
            if config.footprint == Footprint::Disc {
                blend.sum((&points, &cloud.colors), &camera, config, near, z_buffer);
            }
            let n_pixels = z_buffer.winners().len();
            let (mut rgba, mut depths) = (vec![0; 4 * n_pixels], vec![0.0; n_pixels]);
            let eye = camera.center();
            filter.kept(z_buffer, config, |pixel, winner| {
                if shows(winner.point, eye) {
                    let [r, g, b] = match config.footprint {
                        Footprint::Pixel => cloud.colors[winner.point],
                        Footprint::Disc => blend.color(pixel),
                    };
                    rgba[4 * pixel..][..4].copy_from_slice(&[r, g, b, 255]);
                    depths[pixel] = winner.depth;
                }
            });
            SplatImage {
                width: camera.width,
                height: camera.height,
                rgba,
                depths,
            }
        })
        .collect())
}

/// Returns the depth, canonical, of the nearest point in every pixel of [`splat_views`]'s images,
/// row by row; infinite where there is none.
///
/// # Errors
/// As [`splat_views`].
pub fn splat_depths(
    cloud: &PointCloud,
    frame: &Frame,
    (cameras, sources): (&[Camera], &[Camera]),
    config: &SplatConfig,
    near: f64,
) -> Result<Vec<Vec<f32>>> {
    check(cameras, config)?;
    let points = drawn_points(cloud, frame, sources, config)?;
    Ok(cameras
        .par_iter()
        .map_init(Scratch::default, |scratch, camera| {
            let camera = frame.camera_to_canonical(camera);
            points.draw(&camera, config, near, &mut scratch.z_buffer);
            let mut depths = vec![f32::INFINITY; scratch.z_buffer.winners().len()];
            scratch
                .filter
                .kept(&scratch.z_buffer, config, |pixel, winner| {
                    depths[pixel] = winner.depth;
                });
            depths
        })
        .collect())
}

/// Returns the points of `cloud`, as `config` draws them.
fn drawn_points(
    cloud: &PointCloud,
    frame: &Frame,
    sources: &[Camera],
    config: &SplatConfig,
) -> Result<Points> {
    let mut points = Points::new(cloud, frame)?;
    if config.footprint == Footprint::Disc {
        points.measure_discs(frame, sources);
    }
    Ok(points)
}

/// Buffers that a thread reuses from view to view.
#[derive(Default)]
struct Scratch {
    z_buffer: ZBuffer,
    filter: Filter,
    blend: Blend,
}

/// Refuses cameras and settings that splatting cannot work with.
///
/// # Errors
/// A largest radius below [`MIN_DISC_RADIUS_PX`], an even filter window, or an empty image.
pub(crate) fn check(cameras: &[Camera], config: &SplatConfig) -> Result<()> {
    let radius = config.max_radius_px;
    if radius.is_nan() || radius < MIN_DISC_RADIUS_PX {
        return Err(Error::usage(format!(
            "splat.max_radius_px is {}, but must be at least {MIN_DISC_RADIUS_PX}",
            config.max_radius_px
        )));
    }
    if config.filter_window_px.is_multiple_of(2) {
        return Err(Error::usage(format!(
            "splat.filter_window_px is {}, but must be odd",
            config.filter_window_px
        )));
    }
    check_size(cameras)
}

/// Refuses cameras whose image has no pixels.
///
/// # Errors
/// An image without pixels.
pub(crate) fn check_size(cameras: &[Camera]) -> Result<()> {
    match cameras.iter().find(|c| c.width == 0 || c.height == 0) {
        Some(camera) => Err(Error::new("the image has no pixels").at(&camera.name)),
        None => Ok(()),
    }
}
