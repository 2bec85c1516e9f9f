//! Real spherical harmonics, in 3DGS's order and with its signs, and what a rotation does to them.

use glam::{DMat3, DVec3};
use nalgebra::DMatrix;

use super::{MAX_SH_DEGREE, n_sh};

/// Directions that the rotation of a degree is fitted on; any more than its 7 coefficients would do.
const N_DIRECTIONS: usize = 32;

/// Returns the 16 functions up to degree 3 at a unit direction.
fn basis(direction: DVec3) -> [f64; 16] {
    let DVec3 { x, y, z } = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let root = |numerator: f64, denominator: f64| {
        (numerator / (denominator * std::f64::consts::PI)).sqrt()
    };
    let (c1, c2, c20) = (root(3.0, 4.0), root(15.0, 4.0), root(5.0, 16.0));
    let (c33, c32, c31, c30) = (
        root(35.0, 32.0),
        root(105.0, 4.0),
        root(21.0, 32.0),
        root(7.0, 16.0),
    );
    [
        root(1.0, 4.0),
        -c1 * y,
        c1 * z,
        -c1 * x,
        c2 * x * y,
        -c2 * y * z,
        c20 * (2.0 * zz - xx - yy),
        -c2 * x * z,
        0.5 * c2 * (xx - yy),
        -c33 * y * (3.0 * xx - yy),
        c32 * x * y * z,
        -c31 * y * (4.0 * zz - xx - yy),
        c30 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -c31 * x * (4.0 * zz - xx - yy),
        0.5 * c32 * z * (xx - yy),
        -c33 * x * (xx - 3.0 * yy),
    ]
}

/// What a rotation of the world does to coefficients: a matrix a degree.
pub(super) struct ShRotation {
    degrees: Vec<DMatrix<f64>>,
}

impl ShRotation {
    /// Finds it for degrees 1 to 3: the turned coefficients have in a direction the colour that the
    /// old ones had before it was turned. A rotation keeps each degree to itself, so that fitting
    /// that equation on a few directions solves it exactly.
    pub(super) fn new(rotation: DMat3) -> ShRotation {
        let directions: Vec<DVec3> = (0..N_DIRECTIONS).map(spread).collect();
        let here: Vec<[f64; 16]> = directions.iter().map(|d| basis(*d)).collect();
        let before = directions.iter().map(|d| basis(rotation.transpose() * *d));
        let before: Vec<[f64; 16]> = before.collect();
        let degree = |degree: u32| {
            let (first, n) = (n_sh(degree - 1), 2 * degree as usize + 1);
            let part = |of: &[[f64; 16]]| {
                DMatrix::from_fn(N_DIRECTIONS, n, |row, column| of[row][first + column])
            };
            let (a, b) = (part(&here), part(&before));
            // Normal equations; the functions of a degree are orthogonal, so they are well posed.
            let inverse = (a.transpose() * &a).try_inverse();
            inverse.unwrap_or_else(|| DMatrix::identity(n, n)) * a.transpose() * b
        };
        ShRotation {
            degrees: (1..=MAX_SH_DEGREE).map(degree).collect(),
        }
    }

    /// Turns the coefficients `[k][c]` of one Gaussian, up to any degree.
    pub(super) fn turn(&self, sh: &mut [f32]) {
        for (degree, matrix) in (1..).zip(&self.degrees) {
            let (first, n) = (n_sh(degree - 1), 2 * degree as usize + 1);
            let Some(own) = sh.get_mut(3 * first..3 * (first + n)) else {
                return;
            };
            let old: Vec<f64> = own.iter().map(|c| f64::from(*c)).collect();
            for (i, new) in own.iter_mut().enumerate() {
                let (row, channel) = (i / 3, i % 3);
                let sum = (0..n).map(|k| matrix[(row, k)] * old[3 * k + channel]);
                *new = sum.sum::<f64>() as f32;
            }
        }
    }
}

/// Returns direction `i` of those that lie evenly on the sphere, on a spiral of golden angles.
fn spread(i: usize) -> DVec3 {
    let z = 1.0 - (2.0 * i as f64 + 1.0) / N_DIRECTIONS as f64;
    let azimuth = i as f64 * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let (sin, cos) = azimuth.sin_cos();
    let level = (1.0 - z * z).sqrt();
    DVec3::new(level * cos, level * sin, z)
}
