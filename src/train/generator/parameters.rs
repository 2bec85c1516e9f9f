//! All parameters lie in one vector, in which each layer knows its places.

use nalgebra::{DMatrix, DMatrixView, RealField};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// The numbers that the network computes with: `f32` in training, `f64` where gradients are checked.
pub trait Real: RealField + Copy {}

impl<T: RealField + Copy> Real for T {}

/// Returns a constant in the network's numbers.
pub(super) fn real<T: Real>(x: f64) -> T {
    nalgebra::convert(x)
}

/// A matrix of parameters within the vector, column by column.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    first: usize,
    pub rows: usize,
    pub columns: usize,
}

impl Place {
    /// Returns the parameters at this place.
    pub(crate) fn of<'a, T: Real>(&self, values: &'a [T]) -> DMatrixView<'a, T> {
        DMatrixView::from_slice(self.slice(values), self.rows, self.columns)
    }

    /// Returns the parameters at this place in a row.
    pub(crate) fn slice<'a, T: Real>(&self, values: &'a [T]) -> &'a [T] {
        &values[self.first..][..self.rows * self.columns]
    }

    /// Adds to the gradient of the parameters at this place.
    pub(crate) fn add<T: Real>(&self, gradient: &mut [T], more: &[T]) {
        let own = gradient[self.first..].iter_mut();
        own.zip(more).for_each(|(g, m)| *g += *m);
    }
}

/// Draws the first parameters, layer by layer.
pub(super) struct Draws {
    values: Vec<f64>,
    rng: ChaCha8Rng,
}

/// Random stream of the network, apart from those of other consumers of the seed.
const STREAM: u64 = 0x6765_6e65;

impl Draws {
    pub(crate) fn new(seed: u64) -> Draws {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(STREAM);
        let values = Vec::new();
        Draws { values, rng }
    }

    /// Draws from a normal distribution about 0.
    pub(crate) fn normal(&mut self, rows: usize, columns: usize, deviation: f64) -> Place {
        let draw = |rng: &mut ChaCha8Rng| deviation * rng.sample::<f64, _>(StandardNormal);
        self.place(rows, columns, draw)
    }

    /// Draws uniformly between `-bound` and `bound`.
    pub(crate) fn uniform(&mut self, rows: usize, columns: usize, bound: f64) -> Place {
        let draw = |rng: &mut ChaCha8Rng| bound * (2.0 * rng.random::<f64>() - 1.0);
        self.place(rows, columns, draw)
    }

    /// Takes one value for all.
    pub(crate) fn constant(&mut self, rows: usize, columns: usize, value: f64) -> Place {
        self.place(rows, columns, |_| value)
    }

    fn place(
        &mut self,
        rows: usize,
        columns: usize,
        draw: impl Fn(&mut ChaCha8Rng) -> f64,
    ) -> Place {
        let first = self.values.len();
        let drawn = (0..rows * columns).map(|_| draw(&mut self.rng));
        self.values.extend(drawn);
        Place {
            first,
            rows,
            columns,
        }
    }

    /// Takes what was drawn last out again: a constant, no parameter.
    pub(crate) fn withdraw<T: Real>(&mut self, place: Place) -> DMatrix<T> {
        let values = self.values.split_off(place.first).into_iter().map(real);
        DMatrix::from_iterator(place.rows, place.columns, values)
    }

    /// Returns the vector of all parameters.
    pub(crate) fn into_values<T: Real>(self) -> Vec<T> {
        self.values.into_iter().map(real).collect()
    }
}
