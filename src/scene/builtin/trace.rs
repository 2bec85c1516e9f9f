//! This module traces rays: images and the exact truth behind each pixel.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::still_life::{STILL_LIFE, StillLife, Surface};
use crate::camera::Camera;
use crate::scene::Image;

/// Rays a pixel: offsets from its corner, one in each quarter, no two in a row or column.
const SAMPLES: [DVec2; 4] = [
    DVec2::new(0.375, 0.125),
    DVec2::new(0.875, 0.375),
    DVec2::new(0.125, 0.625),
    DVec2::new(0.625, 0.875),
];

/// Pixels of a row whose rays are tried against the same bodies.
const SPAN: usize = 16;

/// The surface that a ray met first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hit {
    /// The dome around everything.
    Backdrop,
    /// The plane `z = 0`.
    Floor,
    /// The n-th object.
    Object(u8),
}

/// A ray-traced view. Everything but the image is exact and belongs to the ray through the
/// pixel's centre; `height * width` entries each, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Traced {
    /// The image that [`render`] makes of the same camera.
    pub image: Image,
    /// Camera z of the first hit, world units. Always finite: the scene is closed.
    pub depth: Vec<f64>,
    /// Unit normal towards the camera's side, world.
    pub normal: Vec<DVec3>,
    /// The surface that the ray met first.
    pub hit: Vec<Hit>,
}

/// Returns the point at camera depth `z` behind the image point `(u, v)`, in the world.
pub fn unproject(camera: &Camera, u: f64, v: f64, z: f64) -> DVec3 {
    camera.center() + ray(camera, u, v) * z
}

/// Returns the world direction through an image point, with camera z = 1.
fn ray(camera: &Camera, u: f64, v: f64) -> DVec3 {
    let in_camera = DVec3::new(
        (u - camera.cx) / camera.fx,
        (v - camera.cy) / camera.fy,
        1.0,
    );
    camera.rotation.transpose() * in_camera
}

/// Returns the signed distance from a world point to the nearest surface: positive in free space,
/// negative inside objects, below the floor and beyond the dome.
pub fn surface_distance(p: DVec3) -> f64 {
    STILL_LIFE.distance(p)
}

/// Renders the image of a camera, which must lie in free space ([`surface_distance`] > 0).
pub fn render(camera: &Camera) -> Image {
    render_of(&STILL_LIFE, camera)
}

/// Does so for any arrangement.
fn render_of(scene: &StillLife, camera: &Camera) -> Image {
    let row_bytes = camera.width as usize * 3;
    let mut rgb = vec![0u8; row_bytes * camera.height as usize];
    rgb.par_chunks_mut(row_bytes.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (span, pixels) in row.chunks_mut(3 * SPAN).enumerate() {
                let x0 = span * SPAN;
                let bodies = bodies_behind(scene, camera, x0, x0 + pixels.len() / 3, y);
                for (i, pixel) in pixels.chunks_exact_mut(3).enumerate() {
                    pixel.copy_from_slice(&shade(scene, camera, x0 + i, y, &bodies));
                }
            }
        });
    Image {
        width: camera.width,
        height: camera.height,
        rgb,
    }
}

/// Returns the bodies that may show in the pixels `x0..x1` of row `y`.
fn bodies_behind(scene: &StillLife, camera: &Camera, x0: usize, x1: usize, y: usize) -> Vec<usize> {
    let (left, right) = (x0 as f64, x1 as f64);
    let (above, below) = (y as f64, y as f64 + 1.0);
    let middle = ray(camera, 0.5 * (left + right), 0.5 * (above + below)).normalize();
    let cos = [(left, above), (right, above), (left, below), (right, below)]
        .map(|(u, v)| ray(camera, u, v).normalize().dot(middle))
        .into_iter()
        .fold(1.0, f64::min);
    scene.bodies_in_cone(camera.center(), middle, cos)
}

/// Returns the surface and the linear colour of each sample of a pixel. Light changes slowly, so samples on one surface
/// share it.
fn samples(
    scene: &StillLife,
    camera: &Camera,
    (x, y): (usize, usize),
    bodies: &[usize],
) -> [(Surface, DVec3); SAMPLES.len()] {
    let eye = camera.center();
    let mut lit = None;
    SAMPLES.map(|offset| {
        let direction = ray(camera, x as f64 + offset.x, y as f64 + offset.y).normalize();
        let (t, surface) = scene.first_hit(eye, direction, bodies);
        let p = eye + direction * t;
        let light = match lit {
            Some((of, light)) if of == surface => light,
            _ => scene.light(surface, p),
        };
        lit = Some((surface, light));
        let radiance = scene.radiance(surface, p, direction, light);
        (surface, radiance.min(DVec3::ONE))
    })
}

/// Returns the level, 0 to 255, of a linear colour. Gamma 2, as the textures' colours.
fn levels(linear: DVec3) -> [f64; 3] {
    linear.to_array().map(|linear| linear.sqrt() * 255.0)
}

/// Returns the colour of one pixel.
fn shade(scene: &StillLife, camera: &Camera, x: usize, y: usize, bodies: &[usize]) -> [u8; 3] {
    let samples = samples(scene, camera, (x, y), bodies);
    let sum: DVec3 = samples.into_iter().map(|(_, radiance)| radiance).sum();
    levels(sum / SAMPLES.len() as f64).map(|level| level.round() as u8)
}

/// Renders the bodies of an arrangement alone, on a ground of this colour, RGB in [0, 1], and says of which pixels they
/// cover at least half.
pub(super) fn cut_out(scene: &StillLife, camera: &Camera, ground: [f64; 3]) -> (Image, Vec<bool>) {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let pixels: Vec<([u8; 3], bool)> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let bodies = bodies_behind(scene, camera, 0, width, y);
            (0..width).map(move |x| {
                let samples = samples(scene, camera, (x, y), &bodies);
                let own = samples
                    .iter()
                    .filter(|(s, _)| matches!(s, Surface::Body(_)));
                let n = own.clone().count() as f64;
                let sum: DVec3 = own.map(|(_, radiance)| *radiance).sum();
                let (share, own) = (n / SAMPLES.len() as f64, levels(sum / n.max(1.0)));
                let blend = |c: usize| share * own[c] + (1.0 - share) * 255.0 * ground[c];
                let rgb = [0, 1, 2].map(|c| blend(c).round() as u8);
                (rgb, share >= 0.5)
            })
        })
        .collect();
    let image = Image {
        width: camera.width,
        height: camera.height,
        rgb: pixels.iter().flat_map(|(rgb, _)| *rgb).collect(),
    };
    (image, pixels.into_iter().map(|(_, set)| set).collect())
}

/// Does what [`render`] does, together with depth, normal and surface at the pixel centres.
pub fn trace(camera: &Camera) -> Traced {
    trace_of(&STILL_LIFE, camera)
}

/// Does so for any arrangement.
pub(super) fn trace_of(scene: &StillLife, camera: &Camera) -> Traced {
    let eye = camera.center();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let truth: Vec<(f64, DVec3, Hit)> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let bodies = bodies_behind(scene, camera, 0, width, y);
            (0..width).map(move |x| {
                let direction = ray(camera, x as f64 + 0.5, y as f64 + 0.5);
                let length = direction.length();
                let (t, surface) = scene.first_hit(eye, direction / length, &bodies);
                let normal = scene.normal(surface, eye + direction / length * t);
                let hit = match surface {
                    Surface::Dome => Hit::Backdrop,
                    Surface::Floor => Hit::Floor,
                    Surface::Body(i) => Hit::Object(i as u8),
                };
                (t / length, normal, hit)
            })
        })
        .collect();
    Traced {
        image: render_of(scene, camera),
        depth: truth.iter().map(|t| t.0).collect(),
        normal: truth.iter().map(|t| t.1).collect(),
        hit: truth.iter().map(|t| t.2).collect(),
    }
}
