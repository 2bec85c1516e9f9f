//! What the perceptrons see of places: waves of them, and features of three planes.

use nalgebra::DMatrix;

use super::parameters::{Real, real};

/// Channels of a plane.
pub(super) const CHANNELS: usize = 16;

/// The axes of the cube that each plane lies along: its columns, its rows.
const AXES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Rows of all features of a place.
pub(super) const FEATURES: usize = AXES.len() * CHANNELS;

/// The pixels of each plane that a place sees, bilinearly, with their weights.
pub(super) struct Lookup<T> {
    corners: [Vec<[(usize, T); 4]>; 3],
}

impl<T: Real> Lookup<T> {
    /// Looks up `places`, a column each, in planes of `side` x `side` that span -1 to 1; those beyond see the border.
    pub(crate) fn new(places: &DMatrix<f64>, side: usize) -> Lookup<T> {
        let last = side - 1;
        let at = |x: f64| ((0.5 * (x + 1.0)) * side as f64 - 0.5).clamp(0.0, last as f64);
        let corners = |[column, row]: [usize; 2]| {
            let of = |i: usize| {
                let [x, y] = [at(places[(column, i)]), at(places[(row, i)])];
                [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, down)| {
                    let weight = |x: f64, far: usize| (1.0 - far as f64 - x.fract()).abs();
                    let pixel = |x: f64, far: usize| (x as usize + far).min(last);
                    let at = pixel(y, down) * side + pixel(x, right);
                    (at, real(weight(x, right) * weight(y, down)))
                })
            };
            (0..places.ncols()).map(of).collect()
        };
        Lookup {
            corners: AXES.map(corners),
        }
    }

    /// Returns the features of all places, plane below plane.
    pub(crate) fn features<'a>(&self, planes: impl Iterator<Item = &'a DMatrix<T>>) -> DMatrix<T> {
        let mut features = DMatrix::zeros(FEATURES, self.corners[0].len());
        for (k, (plane, corners)) in planes.zip(&self.corners).enumerate() {
            for (i, corners) in corners.iter().enumerate() {
                let mut own = features.column_mut(i);
                let mut own = own.rows_mut(k * CHANNELS, CHANNELS);
                for (pixel, weight) in corners {
                    own.axpy(*weight, &plane.column(*pixel), T::one());
                }
            }
        }
        features
    }

    /// Returns the gradient of plane `k`, of so many pixels, from that of the features.
    pub(crate) fn backward(
        &self,
        k: usize,
        n_pixels: usize,
        d_features: &DMatrix<T>,
    ) -> DMatrix<T> {
        let mut d_plane = DMatrix::zeros(CHANNELS, n_pixels);
        for (i, corners) in self.corners[k].iter().enumerate() {
            let own = d_features.column(i);
            let own = own.rows(k * CHANNELS, CHANNELS);
            for (pixel, weight) in corners {
                d_plane.column_mut(*pixel).axpy(*weight, &own, T::one());
            }
        }
        d_plane
    }
}

/// Puts below places the sines and cosines of them and of their doublings, `n` of each (Mildenhall et al. 2020).
pub(super) fn encoded<T: Real>(places: &DMatrix<T>, n: usize) -> DMatrix<T> {
    DMatrix::from_fn(3 + 6 * n, places.ncols(), |row, i| {
        let x = places[(row % 3, i)];
        let Some(wave) = (row / 3).checked_sub(1) else {
            return x;
        };
        let phase = x * real(f64::from(1_u32 << (wave / 2)));
        if wave % 2 == 0 {
            phase.sin()
        } else {
            phase.cos()
        }
    })
}

/// Returns the gradient of places from that of what [`encoded`] has made of them.
pub(super) fn encoded_backward<T: Real>(
    encoded: &DMatrix<T>,
    d: &DMatrix<T>,
    n: usize,
) -> DMatrix<T> {
    DMatrix::from_fn(3, encoded.ncols(), |row, i| {
        let waves = (0..n).map(|k| {
            let [sine, cosine] = [3, 6].map(|first| (first + 6 * k + row, i));
            let turned = encoded[cosine] * d[sine] - encoded[sine] * d[cosine];
            turned * real(f64::from(1_u32 << k))
        });
        waves.fold(d[(row, i)], |a, b| a + b)
    })
}
