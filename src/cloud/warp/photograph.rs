//! A photograph with the cloud's surface in it tells the colour of what it sees.

use glam::{DVec2, DVec3};

use super::surface::Surface;
use crate::camera::Camera;
use crate::scene::View;

/// A training photograph to look points up in.
pub(super) struct Photograph<'a> {
    view: &'a View,
    /// Canonical.
    camera: Camera,
    /// Its optical centre.
    pub center: DVec3,
    surface: Surface,
}

impl<'a> Photograph<'a> {
    /// Takes a view, its canonical `camera` and the `surface` there. What lies beside an edge of
    /// depth, or where a mask hides the photograph, is left out of the surface: there a small error
    /// of depth or pose takes the colour of something else.
    pub(super) fn new(
        view: &'a View,
        camera: Camera,
        surface: Surface,
        depth_tolerance: f64,
    ) -> Photograph<'a> {
        let inverse = (0..surface.inverse.len())
            .map(|pixel| inner(view, &surface, pixel, depth_tolerance))
            .collect();
        Photograph {
            view,
            center: camera.center(),
            surface: Surface { inverse, ..surface },
            camera,
        }
    }

    /// Returns the colour, RGB in [0, 255], at which the photograph shows the canonical point `p`;
    /// `None` where it does not see it: outside the centres of its outermost pixels, or not within
    /// `depth_tolerance` of its surface.
    pub(super) fn color(&self, p: DVec3, near: f64, depth_tolerance: f64) -> Option<[f32; 3]> {
        let (place, depth) = self.camera.project(p);
        let half = DVec2::splat(0.5);
        let last = DVec2::new(self.camera.width.into(), self.camera.height.into()) - half;
        // Written so that NaN fails; then the place fits an index.
        if !(depth > near && place.cmpge(half).all() && place.cmple(last).all()) {
            return None;
        }
        let pixel = place.y as usize * self.surface.width + place.x as usize;
        let ratio = depth * f64::from(self.surface.inverse[pixel]);
        let sees = (ratio - 1.0).abs() <= depth_tolerance;
        sees.then(|| self.bilinear(place - half))
    }

    /// Interpolates between the four pixels around a place, in pixels from the first's centre.
    fn bilinear(&self, place: DVec2) -> [f32; 3] {
        let image = &self.view.image;
        let axis = |at: f64, size: u32| {
            let low = at as usize;
            (
                low,
                (low + 1).min(size as usize - 1),
                (at - low as f64) as f32,
            )
        };
        let (x_0, x_1, s) = axis(place.x, image.width);
        let (y_0, y_1, t) = axis(place.y, image.height);
        let at = |x: usize, y: usize| -> [f32; 3] {
            let pixel = 3 * (y * image.width as usize + x);
            std::array::from_fn(|c| f32::from(image.rgb[pixel + c]))
        };
        let (a, b, c, d) = (at(x_0, y_0), at(x_1, y_0), at(x_0, y_1), at(x_1, y_1));
        std::array::from_fn(|i| {
            let (top, bottom) = (a[i] + s * (b[i] - a[i]), c[i] + s * (d[i] - c[i]));
            top + t * (bottom - top)
        })
    }
}

/// Returns a pixel's inverse depth; 0 where a neighbour's differs by more than the tolerance or is
/// hidden by the mask.
fn inner(view: &View, surface: &Surface, pixel: usize, tolerance: f64) -> f32 {
    let Surface { width, inverse } = surface;
    let (own, height) = (inverse[pixel], inverse.len() / width);
    let is_alike =
        |other: f32| other <= 0.0 || f64::from((other - own).abs()) <= tolerance * f64::from(own);
    let (x, y) = (pixel % width, pixel / width);
    for row in y.saturating_sub(1)..=(y + 1).min(height - 1) {
        for column in x.saturating_sub(1)..=(x + 1).min(width - 1) {
            let other = row * width + column;
            if !view.shows(other) || !is_alike(inverse[other]) {
                return 0.0;
            }
        }
    }
    own
}
