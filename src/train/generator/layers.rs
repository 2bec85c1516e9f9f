//! Layers of images and of points, forward and back. An image is a matrix of a column a pixel, row by row, and a row a channel; a
//! point is a column, too.
//!
//! How a matrix is cut into products depends on its size alone, and their sums are taken in order: bits do not depend
//! on the number of threads.

use std::ops::Range;

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, DVector};
use rayon::prelude::*;

use super::parameters::{Draws, Place, Real, real};

/// Columns of one product.
const COLUMNS: usize = 512;
/// Slope of a leaky ReLU below 0.
const SLOPE: f64 = 0.01;
/// Added to variances.
const EPSILON: f64 = 1e-6;

/// What makes a matrix of another.
pub(super) enum Layer {
    /// Weights of as many pixels, 1 or 9 about each, and biases.
    Linear(Place, Place, usize),
    /// Every channel to a mean and deviation that are learned, then SiLU.
    Normalize(Place, Place),
    LeakyRelu,
    /// Each pixel becomes four.
    Double,
    /// The matrix is kept, ...
    Keep,
    /// ... and added to the one that has become of it, ...
    Add,
    /// ... or put above it, so many rows.
    Stack(usize),
}

/// Draws a convolution of 3 x 3 (He et al. 2015).
pub(super) fn convolution(draws: &mut Draws, n_in: usize, n_out: usize) -> Layer {
    let weights = draws.normal(n_out, 9 * n_in, (2.0 / (9 * n_out) as f64).sqrt());
    Layer::Linear(weights, draws.constant(n_out, 1, 0.0), 9)
}

/// Draws a normalisation of `n` channels.
pub(super) fn normalization(draws: &mut Draws, n: usize) -> Layer {
    Layer::Normalize(draws.constant(n, 1, 1.0), draws.constant(n, 1, 0.0))
}

/// Draws a step that adds to an image what two convolutions, the last of them 0 at first, make of it.
pub(super) fn residual(draws: &mut Draws, n: usize) -> [Layer; 6] {
    let zeros = draws.constant(n, 9 * n, 0.0);
    let last = Layer::Linear(zeros, draws.constant(n, 1, 0.0), 9);
    let [a, b] = [(); 2].map(|()| normalization(draws, n));
    [
        Layer::Keep,
        a,
        convolution(draws, n, n),
        b,
        last,
        Layer::Add,
    ]
}

/// Draws a perceptron of these widths. Its input is put above what hidden layer `skip` makes; its last layer is 0 if
/// `starts_at_zero`.
pub(super) fn perceptron(
    draws: &mut Draws,
    widths: &[usize],
    skip: Option<usize>,
    starts_at_zero: bool,
) -> Vec<Layer> {
    let mut layers = Vec::new();
    let mut n_in = widths[0];
    layers.extend(skip.map(|_| Layer::Keep));
    for (i, &n_out) in widths[1..].iter().enumerate() {
        let is_last = i + 2 == widths.len();
        let share = f64::from(u8::from(!(is_last && starts_at_zero)));
        let bound = (share / n_in as f64).sqrt();
        let weights = draws.uniform(n_out, n_in, bound);
        layers.push(Layer::Linear(weights, draws.uniform(n_out, 1, bound), 1));
        layers.extend((!is_last).then_some(Layer::LeakyRelu));
        n_in = n_out;
        if skip == Some(i) {
            layers.push(Layer::Stack(widths[0]));
            n_in += widths[0];
        }
    }
    layers
}

/// Returns what layers make of a matrix, and what each started from, where the way back needs that.
pub(super) fn forward<T: Real>(
    layers: &[Layer],
    parameters: &[T],
    input: DMatrix<T>,
) -> (DMatrix<T>, Vec<DMatrix<T>>) {
    let (mut starts, mut kept) = (Vec::with_capacity(layers.len()), Vec::new());
    let mut values = input;
    for layer in layers {
        let mut start = DMatrix::zeros(0, 0);
        match layer {
            Layer::Linear(weights, biases, taps) => {
                start = values;
                let biases = biases.slice(parameters);
                values = linear(&start, &weights.of(parameters), biases, *taps);
            }
            Layer::Normalize(gains, biases) => {
                start = values;
                values = normalize(&start, gains.slice(parameters), biases.slice(parameters));
            }
            Layer::LeakyRelu => {
                start = values;
                values = start.map(|x| x.max(x * real(SLOPE)));
            }
            Layer::Double => values = double(&values),
            Layer::Keep => kept.push(values.clone()),
            Layer::Add => kept.pop().into_iter().for_each(|k| values += k),
            Layer::Stack(_) => kept.pop().iter().for_each(|k| values = stacked(k, &values)),
        }
        starts.push(start);
    }
    (values, starts)
}

/// Adds to the parameters' gradient what follows from that of the output; returns that of the input.
pub(super) fn backward<T: Real>(
    layers: &[Layer],
    parameters: &[T],
    starts: &[DMatrix<T>],
    d_output: DMatrix<T>,
    gradient: &mut [T],
) -> DMatrix<T> {
    let (mut d, mut kept) = (d_output, Vec::new());
    for (layer, start) in layers.iter().zip(starts).rev() {
        match layer {
            Layer::Linear(weights, biases, taps) => {
                add_weights(start, &d, (weights, biases, *taps), gradient);
                let turned = turned(&weights.of(parameters), *taps);
                let zeros = vec![T::zero(); turned.nrows()];
                d = linear(&d, &turned.as_view(), &zeros, *taps);
            }
            Layer::Normalize(gains, biases) => {
                let of = [gains, biases].map(|place| place.slice(parameters));
                let [d_gains, d_biases] = normalize_backward(start, &mut d, of);
                gains.add(gradient, d_gains.as_slice());
                biases.add(gradient, d_biases.as_slice());
            }
            Layer::LeakyRelu => d.zip_apply(start, |d, x| {
                if x < T::zero() {
                    *d *= real(SLOPE);
                }
            }),
            Layer::Double => d = halve(&d),
            Layer::Add => kept.push(d.clone()),
            Layer::Stack(n) => {
                kept.push(d.rows(0, *n).into_owned());
                d = d.rows(*n, d.nrows() - n).into_owned();
            }
            Layer::Keep => kept.pop().into_iter().for_each(|k| d += k),
        }
    }
    d
}

/// Returns how many numbers the way back through layers starts from, for an input of `n_columns`.
pub(super) fn n_held(layers: &[Layer], mut n_columns: usize) -> usize {
    let mut sum = 0;
    for layer in layers {
        match layer {
            // Its input, and what comes before an activation.
            Layer::Linear(weights, _, taps) => {
                sum += (weights.columns / taps + weights.rows) * n_columns
            }
            Layer::Double => n_columns *= 4,
            _ => {}
        }
    }
    sum
}

/// Returns a matrix of zeros; nalgebra's own writes them one by one.
fn zeros<T: Real>(n_rows: usize, n_columns: usize) -> DMatrix<T> {
    DMatrix::from_vec(n_rows, n_columns, vec![T::zero(); n_rows * n_columns])
}

/// Puts the rows of `a` above those of `b`.
pub(super) fn stacked<T: Real>(a: &DMatrix<T>, b: &DMatrix<T>) -> DMatrix<T> {
    let mut both = zeros(a.nrows() + b.nrows(), a.ncols());
    both.rows_mut(0, a.nrows()).copy_from(a);
    both.rows_mut(a.nrows(), b.nrows()).copy_from(b);
    both
}

/// Returns some pixels with the eight about each, one below the other, 0 beyond the border; with one tap as they are.
fn surroundings<T: Real>(image: &DMatrix<T>, pixels: Range<usize>, taps: usize) -> DMatrix<T> {
    let (n, side) = (image.nrows(), image.ncols().isqrt());
    if taps == 1 {
        return image.columns_range(pixels).into_owned();
    }
    let mut columns = zeros(taps * n, pixels.len());
    let (from, to) = (image.as_slice(), columns.as_mut_slice());
    for (at, pixel) in pixels.enumerate() {
        for tap in 0..taps {
            // One more than the neighbour's row and column.
            let (row, column) = (pixel / side + tap / 3, pixel % side + tap % 3);
            if (1..=side).contains(&row) && (1..=side).contains(&column) {
                let own = &from[((row - 1) * side + column - 1) * n..][..n];
                to[(taps * at + tap) * n..][..n].copy_from_slice(own);
            }
        }
    }
    columns
}

/// Multiplies surroundings by weights: a row an output channel, by tap and then by input channel.
fn linear<T: Real>(
    image: &DMatrix<T>,
    weights: &DMatrixView<'_, T>,
    biases: &[T],
    taps: usize,
) -> DMatrix<T> {
    let n_out = weights.nrows();
    let mut out = zeros(n_out, image.ncols());
    let chunks = out.as_mut_slice().par_chunks_mut(n_out * COLUMNS);
    chunks.enumerate().for_each(|(k, chunk)| {
        let n = chunk.len() / n_out;
        let inputs = surroundings(image, k * COLUMNS..k * COLUMNS + n, taps);
        for column in chunk.chunks_exact_mut(n_out) {
            column.copy_from_slice(biases);
        }
        DMatrixViewMut::from_slice(chunk, n_out, n).gemm(T::one(), weights, &inputs, T::one());
    });
    out
}

/// Adds the gradients of weights and biases.
fn add_weights<T: Real>(
    start: &DMatrix<T>,
    d_out: &DMatrix<T>,
    (weights, biases, taps): (&Place, &Place, usize),
    gradient: &mut [T],
) {
    let n_chunks = start.ncols().div_ceil(COLUMNS);
    let parts = (0..n_chunks).into_par_iter().map(|k| {
        let columns = k * COLUMNS..((k + 1) * COLUMNS).min(start.ncols());
        let d = d_out.columns_range(columns.clone());
        // The smaller of the two matrices is the one to transpose.
        let turned = surroundings(start, columns, taps) * d.transpose();
        (turned, d.column_sum())
    });
    for (turned, d_biases) in parts.collect::<Vec<_>>() {
        weights.add(gradient, turned.transpose().as_slice());
        biases.add(gradient, d_biases.as_slice());
    }
}

/// Returns the weights that carry a gradient back: turned by half a turn, inputs and outputs exchanged.
fn turned<T: Real>(weights: &DMatrixView<'_, T>, taps: usize) -> DMatrix<T> {
    let (n_out, n_in) = (weights.nrows(), weights.ncols() / taps);
    DMatrix::from_fn(n_in, taps * n_out, |input, column| {
        weights[(column % n_out, (taps - 1 - column / n_out) * n_in + input)]
    })
}

/// Returns an image with channels of mean 0 and deviation 1, and 1 over the deviations before.
fn units<T: Real>(image: &DMatrix<T>) -> (DMatrix<T>, DVector<T>) {
    let mean = image.column_mean();
    let mut units = image.clone();
    units
        .column_iter_mut()
        .for_each(|mut column| column -= &mean);
    let variance = units.component_mul(&units).column_mean();
    let shares = variance.map(|v| T::one() / (v + real(EPSILON)).sqrt());
    let columns = units.column_iter_mut();
    columns.for_each(|mut column| column.component_mul_assign(&shares));
    (units, shares)
}

fn normalize<T: Real>(start: &DMatrix<T>, gains: &[T], biases: &[T]) -> DMatrix<T> {
    let (mut out, _) = units(start);
    let n = out.nrows();
    out.as_mut_slice()
        .par_chunks_mut(n * COLUMNS)
        .for_each(|chunk| {
            for (i, x) in chunk.iter_mut().enumerate() {
                let z = gains[i % n] * *x + biases[i % n];
                *x = z / (T::one() + (-z).exp());
            }
        });
    out
}

/// Carries the gradient `d` back; returns those of gains and biases.
fn normalize_backward<T: Real>(
    start: &DMatrix<T>,
    d: &mut DMatrix<T>,
    [gains, biases]: [&[T]; 2],
) -> [DVector<T>; 2] {
    let (units, shares) = units(start);
    let (n, one_share) = (start.nrows(), real::<T>(1.0 / start.ncols() as f64));
    let each = |d: &mut DMatrix<T>, of: &(dyn Fn(usize, &mut T, T) + Sync)| {
        let units = units.as_slice().par_chunks(n * COLUMNS);
        let chunks = d.as_mut_slice().par_chunks_mut(n * COLUMNS).zip(units);
        chunks.for_each(|(d, units)| {
            for (i, (d, x)) in d.iter_mut().zip(units).enumerate() {
                of(i % n, d, *x);
            }
        });
    };
    each(d, &|c, d, x| {
        let z = gains[c] * x + biases[c];
        let s = T::one() / (T::one() + (-z).exp());
        *d *= s * (T::one() + z * (T::one() - s));
    });
    let (d_gains, d_biases) = (d.component_mul(&units).column_sum(), d.column_sum());
    each(d, &|c, d, x| {
        *d = gains[c] * shares[c] * (*d - (d_biases[c] + x * d_gains[c]) * one_share);
    });
    [d_gains, d_biases]
}

fn double<T: Real>(image: &DMatrix<T>) -> DMatrix<T> {
    let (n, side) = (image.nrows(), image.ncols().isqrt());
    let mut out = zeros(n, 4 * image.ncols());
    for (i, mut column) in out.column_iter_mut().enumerate() {
        let (row, at) = (i / (2 * side), i % (2 * side));
        column.copy_from(&image.column(row / 2 * side + at / 2));
    }
    out
}

/// Sums the four pixels up that one has become.
fn halve<T: Real>(image: &DMatrix<T>) -> DMatrix<T> {
    let (n, side) = (image.nrows(), image.ncols().isqrt());
    let mut out = zeros(n, image.ncols() / 4);
    for (i, column) in image.column_iter().enumerate() {
        let (row, at) = (i / side, i % side);
        let mut sum = out.column_mut(row / 2 * (side / 2) + at / 2);
        sum += column;
    }
    out
}
