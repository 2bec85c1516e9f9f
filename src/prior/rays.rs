//! This module finds cameras from rays, which is slower than the camera decoder and by its authors
//! more accurate (Lin et al. 2025).
//!
//! A ray's direction on the plane at depth 1 is a homography of its place in the image, the
//! camera's rotation after the inverse of its lens. It is found by RANSAC (Fischler and Bolles
//! 1981) over direct linear transforms (Hartley and Zisserman 2004, section 4.1).

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{Matrix3, SMatrix, SymmetricEigen};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Rays;
use crate::camera::Camera;
use crate::error::{Error, Result};

/// Rays that run along the plane tell nothing.
const LEAST_DEPTH: f32 = 1e-4;
/// Samples, points in each, and the share of the most confident that they are drawn from.
const SAMPLES: usize = 100;
const SAMPLE_POINTS: usize = 8;
const SURE_SHARE: f64 = 0.3;
/// How far a ray may miss its place on the plane and still count.
const MISS: f64 = 0.2;

/// A ray: where it is in the image, between -1 and 1, where it meets the plane, and how much it
/// counts.
struct Ray {
    place: DVec2,
    target: DVec2,
    weight: f64,
}

/// Finds the camera that the rays of an image come from, of that size in pixels.
///
/// # Errors
/// Too few rays that tell something, or rays of no camera.
pub fn camera_of_rays(rays: &Rays, name: &str, width: u32, height: u32) -> Result<Camera> {
    let found = found(rays, name, width, height);
    found.ok_or_else(|| {
        Error::new(format!(
            "the network's rays of `{name}` are those of no camera"
        ))
        .way_out("leave out --ray-cameras, or the photograph")
    })
}

fn found(rays: &Rays, name: &str, width: u32, height: u32) -> Option<Camera> {
    let all = usable(rays);
    let matrix = homography(&all)?;
    let (rotation, lens) = split(matrix)?;
    let weight: f64 = all.iter().map(|(ray, _)| ray.weight).sum();
    let center = all
        .iter()
        .map(|(ray, origin)| *origin * ray.weight)
        .sum::<DVec3>()
        / weight;
    let half = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
    let focal = half / DVec2::new(lens.x_axis.x, lens.y_axis.y);
    let principal = half * (DVec2::new(lens.x_axis.z, lens.y_axis.z) + 1.0);
    let rotation = rotation.transpose();
    let camera = Camera {
        name: name.to_owned(),
        width,
        height,
        fx: focal.x,
        fy: focal.y,
        cx: principal.x,
        cy: principal.y,
        rotation,
        translation: -(rotation * center),
    };
    let is_finite = focal.is_finite() && principal.is_finite() && camera.translation.is_finite();
    is_finite.then_some(camera)
}

/// Chooses the rays that count, with their origins.
fn usable(rays: &Rays) -> Vec<(Ray, DVec3)> {
    let (w, h) = (rays.width as f64, rays.height as f64);
    let pixels = rays.rays.iter().zip(&rays.confidence).enumerate();
    let ray = |(i, (ray, confidence)): (usize, (&[f32; 6], &f32))| {
        let [dx, dy, dz, origin @ ..] = ray.map(f64::from);
        let (x, y) = ((i % rays.width) as f64, (i / rays.width) as f64);
        let whole = ray.iter().all(|v| v.is_finite()) && confidence.is_finite();
        (whole && ray[2].abs() > LEAST_DEPTH && *confidence > 0.0).then(|| {
            let ray = Ray {
                place: DVec2::new((x + 0.5) * 2.0 / w - 1.0, (y + 0.5) * 2.0 / h - 1.0),
                target: DVec2::new(dx / dz, dy / dz),
                weight: f64::from(*confidence),
            };
            (ray, DVec3::from(origin))
        })
    };
    pixels.filter_map(ray).collect()
}

/// Finds the homography from places to targets that most of the rays agree with.
fn homography(all: &[(Ray, DVec3)]) -> Option<DMat3> {
    let mut sure: Vec<usize> = (0..all.len()).collect();
    sure.sort_by(|a, b| all[*b].0.weight.total_cmp(&all[*a].0.weight));
    sure.truncate((SURE_SHARE * all.len() as f64) as usize);
    if sure.len() < SAMPLE_POINTS {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut best: Option<(f64, DMat3)> = None;
    for _ in 0..SAMPLES {
        let sample = (0..SAMPLE_POINTS).map(|_| &all[sure[rng.random_range(0..sure.len())]].0);
        let Some(matrix) = linear_transform(sample) else {
            continue;
        };
        let inliers = all.iter().filter(|(ray, _)| meets(&matrix, ray));
        let score = inliers.map(|(ray, _)| ray.weight).sum();
        if best.is_none_or(|(most, _)| score > most) {
            best = Some((score, matrix));
        }
    }
    let (_, matrix) = best?;
    let inliers = all.iter().map(|(ray, _)| ray);
    linear_transform(inliers.filter(|ray| meets(&matrix, ray)))
}

fn meets(matrix: &DMat3, ray: &Ray) -> bool {
    let p = *matrix * ray.place.extend(1.0);
    (p.truncate() / p.z).distance(ray.target) < MISS
}

/// Finds the homography of least algebraic error, from the normal equations' smallest eigenvector.
fn linear_transform<'a>(rays: impl Iterator<Item = &'a Ray>) -> Option<DMat3> {
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for Ray {
        place: p,
        target: t,
        weight,
    } in rays
    {
        for row in [
            [-p.x, -p.y, -1.0, 0.0, 0.0, 0.0, p.x * t.x, p.y * t.x, t.x],
            [0.0, 0.0, 0.0, -p.x, -p.y, -1.0, p.x * t.y, p.y * t.y, t.y],
        ] {
            for a in 0..9 {
                for b in 0..9 {
                    normal[(a, b)] += weight * row[a] * row[b];
                }
            }
        }
    }
    const MOST_STEPS: usize = 1000;
    let eigen = SymmetricEigen::try_new(normal, f64::EPSILON, MOST_STEPS)?;
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let matrix = DMat3::from_cols_array(&[h[0], h[3], h[6], h[1], h[4], h[7], h[2], h[5], h[8]]);
    let matrix = matrix * h[8].recip();
    matrix.is_finite().then_some(matrix)
}

/// Splits a matrix into a rotation and a lower triangular matrix of positive diagonal, whose last
/// entry is 1, that multiply to the matrix up to its size.
fn split(matrix: DMat3) -> Option<(DMat3, DMat3)> {
    let matrix = if matrix.determinant() < 0.0 {
        -matrix
    } else {
        matrix
    };
    // Columns in reverse make a lower triangle of QR's upper one.
    let reversed = DMat3::from_cols(matrix.z_axis, matrix.y_axis, matrix.x_axis);
    let qr = Matrix3::from_column_slice(&reversed.to_cols_array()).qr();
    let (q, r) = (qr.q(), qr.r());
    let signs = DVec3::new(r[(2, 2)], r[(1, 1)], r[(0, 0)]).signum();
    let column = |i: usize| DVec3::new(q[(0, i)], q[(1, i)], q[(2, i)]);
    let rotation = DMat3::from_cols(
        column(2) * signs.x,
        column(1) * signs.y,
        column(0) * signs.z,
    );
    let lower = rotation.transpose() * matrix;
    let size = lower.z_axis.z;
    let is_usable = size > 0.0 && rotation.is_finite() && rotation.determinant() > 0.0;
    is_usable.then(|| (rotation, lower * size.recip()))
}
