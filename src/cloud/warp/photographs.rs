//! All photographs together tell the colour of a view's surface.

use glam::DVec3;
use rayon::prelude::*;

use super::photograph::Photograph;
use super::surface::{Scratch, Surface};
use crate::camera::{Camera, Frame};
use crate::cloud::splat::{Points, check, check_size};
use crate::config::{Config, SplatConfig};
use crate::error::Result;
use crate::scene::{PointCloud, View};

/// Chord between two rays that photographs agree under as well as they can, about a degree: what a
/// photograph says is no better than this however near its ray.
const LEAST_CHORD: f64 = 0.02;

/// How the photographs that see a point are weighed by the angle between its rays to them and to
/// the view's eye.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weighing {
    /// By the eighth power of the cosine.
    Cosine,
    /// By the inverse of the square of the chord between the rays.
    Chord,
}

/// What the photographs show in a pixel of a view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Seen {
    /// RGB in [0, 255], the mean by weight.
    pub color: [f32; 3],
    /// Sum of the weights; 0 where no photograph sees the surface.
    pub weight: f32,
    /// Square of the least chord between the ray to the view's eye and one to a photograph.
    pub chord_squared: f32,
}

/// The photographs and the cloud whose surface they see.
pub(super) struct Photographs<'a> {
    frame: Frame,
    near: f64,
    splat: SplatConfig,
    depth_tolerance: f64,
    weighing: Weighing,
    points: Points,
    each: Vec<Photograph<'a>>,
}

impl<'a> Photographs<'a> {
    /// Finds the surface of `cloud` in every view.
    ///
    /// # Errors
    /// More than 2^32 - 2 points, an image without pixels, or settings that splatting refuses.
    pub(super) fn new(
        cloud: &PointCloud,
        frame: &Frame,
        views: &[&'a View],
        (config, weighing): (&Config, Weighing),
        near: f64,
    ) -> Result<Photographs<'a>> {
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera.clone()).collect();
        check(&cameras, &config.splat)?;
        let mut points = Points::new(cloud, frame)?;
        points.measure_discs(frame, &cameras);
        let depth_tolerance = config.views.visibility.depth_tolerance;
        let each = views
            .par_iter()
            .map_init(Scratch::default, |scratch, view| {
                let camera = frame.camera_to_canonical(&view.camera);
                let surface = Surface::of(&points, &camera, &config.splat, near, scratch);
                Photograph::new(view, camera, surface, depth_tolerance)
            })
            .collect();
        Ok(Photographs {
            frame: *frame,
            near,
            splat: config.splat.clone(),
            depth_tolerance,
            weighing,
            points,
            each,
        })
    }

    /// Returns what the photographs show in every pixel of a `camera` of the world frame.
    ///
    /// # Errors
    /// An image without pixels.
    pub(super) fn look(&self, camera: &Camera, scratch: &mut Scratch) -> Result<Vec<Seen>> {
        check_size(std::slice::from_ref(camera))?;
        let camera = self.frame.camera_to_canonical(camera);
        let surface = Surface::of(&self.points, &camera, &self.splat, self.near, scratch);
        let eye = camera.center();
        let to_world = camera.rotation.transpose();
        let pixels = surface.inverse.iter().enumerate();
        let seen = pixels.map(|(pixel, inverse)| {
            if *inverse <= 0.0 {
                return Seen::default();
            }
            let u = (pixel % surface.width) as f64 + 0.5;
            let v = (pixel / surface.width) as f64 + 0.5;
            let (x, y) = ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
            let ray = to_world * DVec3::new(x, y, 1.0);
            self.seen(eye + ray / f64::from(*inverse), eye)
        });
        Ok(seen.collect())
    }

    /// Returns what the photographs show of the canonical point `p` to an eye.
    fn seen(&self, p: DVec3, eye: DVec3) -> Seen {
        let to_eye = (eye - p).normalize();
        let mut seen = Seen {
            chord_squared: f32::INFINITY,
            ..Seen::default()
        };
        for photograph in &self.each {
            let to_photograph = (photograph.center - p).normalize();
            let cosine = to_eye.dot(to_photograph);
            // What is seen from behind is another side.
            if cosine <= 0.0 {
                continue;
            }
            let Some(color) = photograph.color(p, self.near, self.depth_tolerance) else {
                continue;
            };
            let chord_squared = to_eye.distance_squared(to_photograph);
            let weight = match self.weighing {
                Weighing::Cosine => cosine.powi(8),
                Weighing::Chord => inverse_variance(chord_squared, 0.0),
            } as f32;
            seen.color = std::array::from_fn(|i| seen.color[i] + weight * color[i]);
            seen.weight += weight;
            seen.chord_squared = seen.chord_squared.min(chord_squared as f32);
        }
        if seen.weight > 0.0 {
            seen.color = seen.color.map(|sum| sum / seen.weight);
        }
        seen
    }

    /// Returns for each point of the cloud the photograph that it was taken from, as far as its
    /// colour tells: of those that see it, the one with the most similar colour; `None` if none
    /// does. `colors` are the points'.
    pub(super) fn origins(&self, colors: &[[u8; 3]]) -> Vec<Option<usize>> {
        let origin = |point: usize| {
            let p = self.points.position(point);
            let mut best: Option<(f32, usize)> = None;
            for (i, photograph) in self.each.iter().enumerate() {
                let Some(color) = photograph.color(p, self.near, self.depth_tolerance) else {
                    continue;
                };
                let error = squared_difference(color, colors[point].map(f32::from));
                if best.is_none_or(|(least, _)| error < least) {
                    best = Some((error, i));
                }
            }
            best.map(|(_, i)| i)
        };
        (0..colors.len()).into_par_iter().map(origin).collect()
    }
}

/// Returns the inverse of a variance that grows with the square of the chord, up to a factor that
/// all have; `excess` is added to the square.
pub(super) fn inverse_variance(chord_squared: f64, excess: f64) -> f64 {
    1.0 / (chord_squared + LEAST_CHORD * LEAST_CHORD + excess)
}

/// Returns the mean over the channels of the squared difference.
pub(super) fn squared_difference(a: [f32; 3], b: [f32; 3]) -> f32 {
    let squares: [f32; 3] = std::array::from_fn(|i| (a[i] - b[i]) * (a[i] - b[i]));
    squares.iter().sum::<f32>() / 3.0
}
