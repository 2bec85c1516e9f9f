//! Real spherical harmonics to degree 3 in the order and with the signs that 3DGS files use.
//!
//! Normalisation constants are written as the roots they are, so that a mistyped decimal on
//! either side shows.

use std::f64::consts::PI;

use super::linalg::Vec3;

/// Returns the 16 basis functions at `d` as homogeneous polynomials (harmonics where `|d| = 1`).
pub fn basis([x, y, z]: Vec3) -> [f64; 16] {
    let root = |a: f64, b: f64| (a / (b * PI)).sqrt();
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        root(1.0, 4.0),
        -root(3.0, 4.0) * y,
        root(3.0, 4.0) * z,
        -root(3.0, 4.0) * x,
        root(15.0, 4.0) * x * y,
        -root(15.0, 4.0) * y * z,
        root(5.0, 16.0) * (2.0 * zz - xx - yy),
        -root(15.0, 4.0) * x * z,
        root(15.0, 16.0) * (xx - yy),
        -root(35.0, 32.0) * y * (3.0 * xx - yy),
        root(105.0, 4.0) * x * y * z,
        -root(21.0, 32.0) * y * (4.0 * zz - xx - yy),
        root(7.0, 16.0) * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -root(21.0, 32.0) * x * (4.0 * zz - xx - yy),
        root(105.0, 16.0) * z * (xx - yy),
        -root(35.0, 32.0) * x * (xx - 3.0 * yy),
    ]
}

/// Returns the gradient of each basis polynomial to `d`.
pub fn basis_gradient([x, y, z]: Vec3) -> [Vec3; 16] {
    let root = |a: f64, b: f64| (a / (b * PI)).sqrt();
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let scaled = |s: f64, v: Vec3| v.map(|c| s * c);
    [
        [0.0; 3],
        [0.0, -root(3.0, 4.0), 0.0],
        [0.0, 0.0, root(3.0, 4.0)],
        [-root(3.0, 4.0), 0.0, 0.0],
        scaled(root(15.0, 4.0), [y, x, 0.0]),
        scaled(-root(15.0, 4.0), [0.0, z, y]),
        scaled(root(5.0, 16.0), [-2.0 * x, -2.0 * y, 4.0 * z]),
        scaled(-root(15.0, 4.0), [z, 0.0, x]),
        scaled(root(15.0, 16.0), [2.0 * x, -2.0 * y, 0.0]),
        scaled(-root(35.0, 32.0), [6.0 * x * y, 3.0 * (xx - yy), 0.0]),
        scaled(root(105.0, 4.0), [y * z, x * z, x * y]),
        scaled(
            -root(21.0, 32.0),
            [-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z],
        ),
        scaled(
            root(7.0, 16.0),
            [-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * xx - 3.0 * yy],
        ),
        scaled(
            -root(21.0, 32.0),
            [4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z],
        ),
        scaled(root(105.0, 16.0), [2.0 * x * z, -2.0 * y * z, xx - yy]),
        scaled(-root(35.0, 32.0), [3.0 * (xx - yy), -6.0 * x * y, 0.0]),
    ]
}

/// Returns `0.5 + sum_k Y_k(d) sh_k` for `k < (degree + 1)^2`: the colour before its clamp at zero.
pub fn color(direction: Vec3, sh: &[Vec3; 16], degree: usize) -> Vec3 {
    let y = basis(direction);
    std::array::from_fn(|c| {
        0.5 + (0..(degree + 1).pow(2))
            .map(|k| y[k] * sh[k][c])
            .sum::<f64>()
    })
}
