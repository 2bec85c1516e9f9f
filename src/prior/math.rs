//! This module has matrix products and the functions of the network's layers, in f32.
//!
//! Products are nalgebra's, which hands them to `matrixmultiply`. Each is computed by one thread,
//! and how work is cut into products never depends on the number of threads: neither do the sums.

use std::sync::LazyLock;

use nalgebra::{DMatrixView, DMatrixViewMut, Dyn};

/// A matrix within a slice: element `(r, c)` at `offset + r * row + c * column`.
#[derive(Clone, Copy)]
pub(super) struct Strided<'a> {
    pub values: &'a [f32],
    pub rows: usize,
    pub columns: usize,
    pub row: usize,
    pub column: usize,
}

impl<'a> Strided<'a> {
    /// Views `values` as a matrix whose rows lie one after the other.
    pub(crate) fn rows(values: &'a [f32], rows: usize, columns: usize) -> Strided<'a> {
        Strided {
            values,
            rows,
            columns,
            row: columns,
            column: 1,
        }
    }

    pub(crate) fn transposed(self) -> Strided<'a> {
        Strided {
            rows: self.columns,
            columns: self.rows,
            row: self.column,
            column: self.row,
            ..self
        }
    }

    fn view(&self) -> DMatrixView<'a, f32, Dyn, Dyn> {
        DMatrixView::from_slice_with_strides_generic(
            self.values,
            Dyn(self.rows),
            Dyn(self.columns),
            Dyn(self.row),
            Dyn(self.column),
        )
    }
}

/// `matrixmultiply` is handed products all of whose sides are above this. Below it nalgebra 0.35
/// has loops of its own, which write beside rows that are not contiguous.
const SMALL: usize = 5;

/// Computes `out = scale a b`, for `out` of `a.rows` rows that begin `stride` apart.
pub(super) fn multiply(out: &mut [f32], stride: usize, scale: f32, a: Strided<'_>, b: Strided<'_>) {
    if a.rows.min(a.columns).min(b.columns) <= SMALL {
        return multiply_small(out, stride, scale, a, b);
    }
    let mut out = DMatrixViewMut::from_slice_with_strides_generic(
        out,
        Dyn(a.rows),
        Dyn(b.columns),
        Dyn(stride),
        Dyn(1),
    );
    out.gemm(scale, &a.view(), &b.view(), 0.0);
}

fn multiply_small(out: &mut [f32], stride: usize, scale: f32, a: Strided<'_>, b: Strided<'_>) {
    for r in 0..a.rows {
        for c in 0..b.columns {
            let product =
                |k: usize| a.values[r * a.row + k * a.column] * b.values[k * b.row + c * b.column];
            out[r * stride + c] = scale * (0..a.columns).map(product).sum::<f32>();
        }
    }
}

/// Returns `e^x` for `x <= 0`, within two units in the last place; 0 below -87.
///
/// Without branches and calls, so that a loop of it becomes vector code on any machine.
#[inline]
pub(super) fn exp_negative(x: f32) -> f32 {
    // The sum of a number and 1.5 * 2^23 is rounded to a whole number.
    const ROUND: f32 = 12_582_912.0;
    // ln 2 in two parts, of which the first has so few bits that its multiples are exact.
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let bounded = x.max(-87.0);
    let n = (bounded * std::f32::consts::LOG2_E + ROUND) - ROUND;
    let r = (bounded - n * LN_2_HIGH) - n * LN_2_LOW;
    // Taylor's series; |r| <= ln 2 / 2, where the next term is below 6e-9.
    let mut p = 1.0 / 5040.0;
    for coefficient in [
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        p = p * r + coefficient;
    }
    let power = f32::from_bits((((n as i32) + 127) << 23) as u32);
    if x < -87.0 { 0.0 } else { p * power }
}

/// Intervals of the table of the error function between 0 and [`ERF_END`].
const ERF_STEPS_PER_UNIT: usize = 64;
/// From here on the error function is 1 in f32.
const ERF_END: usize = 4;

/// The error function and its slope at `i / ERF_STEPS_PER_UNIT`.
static ERF: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    let points = 0..=ERF_END * ERF_STEPS_PER_UNIT;
    let entry = |i: usize| {
        let x = i as f64 / ERF_STEPS_PER_UNIT as f64;
        // erf x = 2 / sqrt(pi) e^(-x^2) (x + 2 x^3 / 3 + 4 x^5 / 15 + ...), all terms positive.
        let (mut term, mut sum) = (x, x);
        for n in 1..200 {
            term *= 2.0 * x * x / f64::from(2 * n + 1);
            sum += term;
        }
        let slope = std::f64::consts::FRAC_2_SQRT_PI * (-x * x).exp();
        [(slope * sum) as f32, slope as f32]
    };
    points.map(entry).collect()
});

/// Returns the error function, by cubic interpolation in a table: within 1e-7.
fn erf(x: f32, table: &[[f32; 2]]) -> f32 {
    let scaled = x.abs() * ERF_STEPS_PER_UNIT as f32;
    let i = scaled as usize;
    let Some(&[[f0, d0], [f1, d1]]) = table.get(i..i + 2).and_then(|pair| pair.first_chunk())
    else {
        // Also of NaN, whose index is 0, nothing else comes here.
        return if x.is_nan() { x } else { 1_f32.copysign(x) };
    };
    let h = 1.0 / ERF_STEPS_PER_UNIT as f32;
    let t = scaled - i as f32;
    let (d0, d1) = (d0 * h, d1 * h);
    let rise = f1 - f0;
    let value = f0 + t * (d0 + t * (3.0 * rise - 2.0 * d0 - d1 + t * (d0 + d1 - 2.0 * rise)));
    value.copysign(x)
}

/// Applies `x Phi(x)`, exact (Hendrycks and Gimpel 2016), in place.
pub(super) fn gelu(values: &mut [f32]) {
    let table = &*ERF;
    for x in values {
        *x *= 0.5 * (1.0 + erf(*x * std::f32::consts::FRAC_1_SQRT_2, table));
    }
}

/// Replaces a row by the exponentials of it less its maximum; returns one over their sum.
pub(super) fn exponentials(row: &mut [f32]) -> f32 {
    let mut maxima = [f32::NEG_INFINITY; LANES];
    let (chunks, rest) = row.as_chunks::<LANES>();
    for chunk in chunks {
        for (max, x) in maxima.iter_mut().zip(chunk) {
            *max = if *x > *max { *x } else { *max };
        }
    }
    let max = maxima
        .iter()
        .chain(rest)
        .copied()
        .fold(f32::NEG_INFINITY, f32::max);
    let mut sums = [0.0; LANES];
    let (chunks, rest) = row.as_chunks_mut::<LANES>();
    for chunk in chunks {
        for (sum, x) in sums.iter_mut().zip(chunk) {
            *x = exp_negative(*x - max);
            *sum += *x;
        }
    }
    let mut sum: f32 = sums.iter().sum();
    for x in rest {
        *x = exp_negative(*x - max);
        sum += *x;
    }
    1.0 / sum
}

/// Sums run in so many lanes, in one order on every machine.
const LANES: usize = 16;

/// Returns the sum of `value` over a slice.
pub(super) fn sum(values: &[f32], value: impl Fn(f32) -> f32) -> f32 {
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for chunk in chunks {
        for (sum, x) in sums.iter_mut().zip(chunk) {
            *sum += value(*x);
        }
    }
    sums.iter().sum::<f32>() + rest.iter().map(|x| value(*x)).sum::<f32>()
}
