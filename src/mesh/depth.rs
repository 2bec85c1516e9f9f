//! This module finds how deep the surface lies behind every pixel.

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::gaussians::Gaussians;
use crate::render::NO_MEDIAN;

/// A Gaussian flatter than this share of its largest scale counts as this flat.
const LEAST_FLAT: f64 = 1e-4;
/// The surface within a Gaussian is looked for up to so many of its largest standard deviations
/// from its mean.
const REACH: f64 = 3.0;

/// Returns the median depth of every pixel along the camera's axis; 0 where there is none. Row 0
/// on top.
///
/// `medians` has the Gaussian that takes each pixel's transmittance to a half. Its depth is that
/// of the point of the pixel's ray at which it is densest, which for a flat Gaussian lies on its
/// plane, however the plane is tilted.
pub fn depth(camera: &Camera, gaussians: &Gaussians, medians: &[u32]) -> Vec<f32> {
    let width = camera.width as usize;
    let eye = camera.center();
    let to_world = camera.rotation.transpose();
    let pixels = medians.par_iter().enumerate().map(|(pixel, gaussian)| {
        if *gaussian == NO_MEDIAN {
            return 0.0;
        }
        let (x, y) = (pixel % width, pixel / width);
        let ray = DVec3::new(
            (x as f64 + 0.5 - camera.cx) / camera.fx,
            (y as f64 + 0.5 - camera.cy) / camera.fy,
            1.0,
        );
        densest(gaussians, *gaussian as usize, eye, to_world * ray) as f32
    });
    pixels.collect()
}

/// Returns the `t` at which `eye + t ray` is densest in Gaussian `i`.
fn densest(gaussians: &Gaussians, i: usize, eye: DVec3, ray: DVec3) -> f64 {
    let from_mean = eye - gaussians.means[i].as_dvec3();
    let scales = gaussians.scales_log[i].as_dvec3().exp();
    let largest = scales.max_element();
    let along = -from_mean.dot(ray) / ray.length_squared();
    let Some(rotation) = gaussians.rotation(i) else {
        return along;
    };
    let [w, x, y, z] = rotation.map(f64::from);
    let to_axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()).transpose();
    let unit = scales.max(DVec3::splat(LEAST_FLAT * largest));
    let (a, b) = ((to_axes * from_mean) / unit, (to_axes * ray) / unit);
    let t = -a.dot(b) / b.length_squared();
    let reach = REACH * largest / ray.length();
    match t.is_finite() {
        true => t.clamp(along - reach, along + reach),
        false => along,
    }
}
