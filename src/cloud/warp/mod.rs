//! Warping carries the photographs into a view by the depth of the cloud there: a sharper target
//! than the cloud's points, where a photograph sees the surface.
//!
//! - The cloud's surface in a view has a depth at the centre of every pixel, fitted between its
//!   points. With it each pixel has a place, which is looked up in every training photograph, between pixels.
//! - A photograph sees the place if it lies at the depth of the surface there, and not beside an edge of
//!   depth. The colours of those that see it are averaged by weight; where none does, the splat stays.
//! - `photographs` weighs by `cos^8` of the angle between the rays to photograph and view (as in
//!   unstructured lumigraphs, Buehler et al. 2001, the nearest in angle count most). A warp is sharp
//!   where the splat is noisy, but not always right: photographs differ, and depth is a little off.
//! - `blend` weighs photographs and splat by the inverse of their variances and pixels by what error
//!   is to be expected there, all of it measured at the photographs.

mod errors;
mod photograph;
mod photographs;
mod surface;

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::{Camera, Frame};
use crate::cloud::splat::{BYTES_A_POINT, SplatImage};
use crate::config::{ColorSource, Config};
use crate::error::{Error, Result};
use crate::scene::{PointCloud, View};
use errors::{Errors, color, differences};
use photographs::{Photographs, Weighing};
use surface::Scratch;

/// The training photographs, ready to be warped into any view.
pub struct Warp<'a> {
    photographs: Photographs<'a>,
    errors: Option<Errors>,
    /// Line for the log.
    pub warning: Option<String>,
}

impl<'a> Warp<'a> {
    /// Prepares the training `views` to be warped by the depth of `cloud`, as `config` says;
    /// `None` where it wants the points' own colours. Nothing nearer than `near`, canonical, is seen.
    ///
    /// # Errors
    /// More than 2^32 - 2 points, an image without pixels, or settings that splatting refuses.
    pub fn new(
        cloud: &PointCloud,
        frame: &Frame,
        views: &'a [View],
        config: &Config,
        near: f64,
    ) -> Result<Option<Warp<'a>>> {
        let weighing = match config.splat.colors {
            ColorSource::Points => return Ok(None),
            ColorSource::Photographs => Weighing::Cosine,
            ColorSource::Blend => Weighing::Chord,
        };
        let views: Vec<&View> = views.iter().collect();
        let photographs = Photographs::new(cloud, frame, &views, (config, weighing), near)?;
        let mut warp = Warp {
            photographs,
            errors: None,
            warning: None,
        };
        if weighing == Weighing::Chord {
            let origins = warp.photographs.origins(&cloud.colors);
            warp.errors = Errors::measure((cloud, &origins), frame, &views, config, near)?;
            if warp.errors.is_none() {
                warp.warning = Some(
                    "too little of the cloud is seen by two photographs to measure the errors of \
                     warping (splat.colors): photographs are not joined with the splat, and all \
                     pixels have one weight"
                        .to_owned(),
                );
            }
        }
        Ok(Some(warp))
    }

    /// Paints the covered pixels of `splats`, one of each of the `cameras`, world frame, with the
    /// photographs that see the surface there; the others stay. With `blend` alpha becomes 255 times a
    /// pixel's weight, at least 1. Returns which pixels were painted, row by row. The result does not
    /// depend on the number of threads.
    ///
    /// # Errors
    /// A splat that is not of its camera's size, or an image without pixels.
    pub fn paint(&self, cameras: &[Camera], splats: &mut [SplatImage]) -> Result<Vec<Vec<bool>>> {
        splats
            .par_iter_mut()
            .zip(cameras)
            .map_init(Scratch::default, |scratch, (splat, camera)| {
                if (splat.width, splat.height) != (camera.width, camera.height) {
                    return Err(Error::new(format!(
                        "the splat has {}x{} pixels and the camera {}x{}",
                        splat.width, splat.height, camera.width, camera.height
                    ))
                    .at(&camera.name));
                }
                self.paint_one(camera, splat, scratch)
            })
            .collect()
    }

    fn paint_one(
        &self,
        camera: &Camera,
        splat: &mut SplatImage,
        scratch: &mut Scratch,
    ) -> Result<Vec<bool>> {
        let seen = self.photographs.look(camera, scratch)?;
        let differences = self.errors.map(|_| differences(splat, &seen));
        let mut painted = vec![false; seen.len()];
        for (i, pixel) in splat.rgba.chunks_exact_mut(4).enumerate() {
            if pixel[3] == 0 {
                continue;
            }
            painted[i] = seen[i].weight > 0.0;
            if painted[i] {
                let joined = match &self.errors {
                    Some(errors) => errors.joined(color(pixel), seen[i]),
                    None => seen[i].color,
                };
                pixel[..3].copy_from_slice(&joined.map(|c| c.round() as u8));
            }
            if let (Some(errors), Some(differences)) = (&self.errors, &differences) {
                let weight = errors.weight(seen[i], differences[i]);
                pixel[3] = (255.0 * weight).round().max(1.0) as u8;
            }
        }
        Ok(painted)
    }
}

/// Returns the bytes a point that a [`Warp`] takes at most, beside those of splatting it: the points
/// drawn and, for a blend, what is known of each with a second cloud of those not left out.
pub fn bytes_a_point(colors: ColorSource) -> usize {
    let cloud = size_of::<DVec3>() + size_of::<[u8; 3]>() + size_of::<f32>();
    match colors {
        ColorSource::Points => 0,
        ColorSource::Photographs => BYTES_A_POINT,
        ColorSource::Blend => 2 * BYTES_A_POINT + size_of::<Option<usize>>() + cloud,
    }
}
