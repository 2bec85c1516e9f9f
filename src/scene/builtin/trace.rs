//! This module traces rays: images and the exact truth behind each pixel.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::still_life::{STILL_LIFE, Surface};
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
    let row_bytes = camera.width as usize * 3;
    let mut rgb = vec![0u8; row_bytes * camera.height as usize];
    rgb.par_chunks_mut(row_bytes.max(1))
        .enumerate()
        .for_each(|(y, row)| {
            for (span, pixels) in row.chunks_mut(3 * SPAN).enumerate() {
                let x0 = span * SPAN;
                let bodies = bodies_behind(camera, x0, x0 + pixels.len() / 3, y);
                for (i, pixel) in pixels.chunks_exact_mut(3).enumerate() {
                    pixel.copy_from_slice(&shade(camera, x0 + i, y, &bodies));
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
fn bodies_behind(camera: &Camera, x0: usize, x1: usize, y: usize) -> Vec<usize> {
    let (left, right) = (x0 as f64, x1 as f64);
    let (above, below) = (y as f64, y as f64 + 1.0);
    let middle = ray(camera, 0.5 * (left + right), 0.5 * (above + below)).normalize();
    let cos = [(left, above), (right, above), (left, below), (right, below)]
        .map(|(u, v)| ray(camera, u, v).normalize().dot(middle))
        .into_iter()
        .fold(1.0, f64::min);
    STILL_LIFE.bodies_in_cone(camera.center(), middle, cos)
}

/// Returns the colour of one pixel. Light changes slowly, so samples on one surface share it.
fn shade(camera: &Camera, x: usize, y: usize, bodies: &[usize]) -> [u8; 3] {
    let eye = camera.center();
    let mut sum = DVec3::ZERO;
    let mut lit = None;
    for offset in SAMPLES {
        let direction = ray(camera, x as f64 + offset.x, y as f64 + offset.y).normalize();
        let (t, surface) = STILL_LIFE.first_hit(eye, direction, bodies);
        let p = eye + direction * t;
        let light = match lit {
            Some((of, light)) if of == surface => light,
            _ => STILL_LIFE.light(surface, p),
        };
        lit = Some((surface, light));
        sum += STILL_LIFE
            .radiance(surface, p, direction, light)
            .min(DVec3::ONE);
    }
    let mean = sum / SAMPLES.len() as f64;
    // Gamma 2, as the textures' colours.
    mean.to_array()
        .map(|linear| (linear.sqrt() * 255.0).round() as u8)
}

/// Does what [`render`] does, together with depth, normal and surface at the pixel centres.
pub fn trace(camera: &Camera) -> Traced {
    let eye = camera.center();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let truth: Vec<(f64, DVec3, Hit)> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let bodies = bodies_behind(camera, 0, width, y);
            (0..width).map(move |x| {
                let direction = ray(camera, x as f64 + 0.5, y as f64 + 0.5);
                let length = direction.length();
                let (t, surface) = STILL_LIFE.first_hit(eye, direction / length, &bodies);
                let normal = STILL_LIFE.normal(surface, eye + direction / length * t);
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
        image: render(camera),
        depth: truth.iter().map(|t| t.0).collect(),
        normal: truth.iter().map(|t| t.1).collect(),
        hit: truth.iter().map(|t| t.2).collect(),
    }
}
