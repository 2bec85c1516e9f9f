//! Similarities between frames.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};

use super::{Camera, Frame};
use crate::error::{Error, Result};

/// Points that spread across their line by less than this share of their spread along it (root
/// mean squares) leave the turn about it open.
const MIN_SPREAD: f64 = 0.01;

/// A similarity from an old frame to a new one, `x' = scale rotation x + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Length in the new frame of one unit of the old one.
    pub scale: f64,
    /// Rotation from the old frame's axes to the new one's.
    pub rotation: DMat3,
    /// Position of the old frame's origin, in the new one.
    pub translation: DVec3,
}

impl Similarity {
    /// The similarity that leaves everything as it is.
    pub const IDENTITY: Similarity = Similarity {
        scale: 1.0,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// Returns the similarity that takes the points `from` nearest to those in `to`, pair by pair,
    /// in the sum of squares (Umeyama 1991, eqs. 40-42).
    ///
    /// # Errors
    /// There are fewer than three pairs, or the points lie on a line or are not finite.
    pub fn between(from: &[DVec3], to: &[DVec3]) -> Result<Similarity> {
        let n = from.len().min(to.len());
        if n < 3 {
            return Err(Error::new(format!(
                "a similarity needs 3 pairs of points, there are {n}"
            )));
        }
        let mean = |points: &[DVec3]| points[..n].iter().sum::<DVec3>() / n as f64;
        let (mean_from, mean_to) = (mean(from), mean(to));
        let centred = |points: &[DVec3], mean: DVec3| -> Vec<DVec3> {
            points[..n].iter().map(|p| *p - mean).collect()
        };
        let (from, to) = (centred(from, mean_from), centred(to, mean_to));
        if !(span_a_plane(&from) && span_a_plane(&to)) {
            return Err(Error::new("the points lie on a line"));
        }
        let svd = covariance(&to, &from).svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
            return Err(Error::new("the points are not finite"));
        };
        // Without a reflection.
        let sign = (u.determinant() * v_t.determinant()).signum();
        let signs = Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, sign));
        let rotation = u * signs * v_t;
        let [a, b, c] = [0, 1, 2].map(|i| svd.singular_values[i]);
        let variance = from.iter().map(|p| p.length_squared()).sum::<f64>() / n as f64;
        let scale = (a + b + sign * c) / variance;
        let rotation = DMat3::from_cols_array(&std::array::from_fn(|i| rotation[(i % 3, i / 3)]));
        Ok(Similarity {
            scale,
            rotation,
            translation: mean_to - scale * (rotation * mean_from),
        })
    }

    /// Takes a position from the old frame to the new one.
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.scale * (self.rotation * p) + self.translation
    }

    /// Returns the camera that sees in the new frame what `camera` sees in the old one.
    pub fn camera(&self, camera: &Camera) -> Camera {
        let rotation = camera.rotation * self.rotation.transpose();
        Camera {
            rotation,
            translation: -(rotation * self.point(camera.center())),
            ..camera.clone()
        }
    }

    /// Returns the canonical frame around the same sphere.
    pub fn frame(&self, frame: &Frame) -> Frame {
        Frame {
            center: self.point(frame.center),
            radius: self.scale * frame.radius,
            extent: self.scale * frame.extent,
        }
    }
}

/// Returns `1/n sum a b^T`; its singular values come in descending order.
fn covariance(a: &[DVec3], b: &[DVec3]) -> Matrix3<f64> {
    let n = a.len() as f64;
    let sum = |r: usize, c: usize| a.iter().zip(b).map(|(a, b)| a[r] * b[c]).sum::<f64>();
    Matrix3::from_fn(|r, c| sum(r, c) / n)
}

/// Returns whether centred points leave every line by enough; false if they are not finite.
fn span_a_plane(points: &[DVec3]) -> bool {
    let eigen = SymmetricEigen::new(covariance(points, points));
    let mut variances = [0, 1, 2].map(|i| eigen.eigenvalues[i]);
    variances.sort_by(f64::total_cmp);
    let [_, across, along] = variances;
    across > MIN_SPREAD * MIN_SPREAD * along
}
