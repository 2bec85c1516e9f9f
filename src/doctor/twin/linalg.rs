//! 3x3 and 2x3 products on plain arrays, row-major, column vectors.

/// A column vector, or a row of a matrix.
pub type Vec3 = [f64; 3];
/// A 3x3 matrix, `[row][column]`.
pub type Mat3 = [[f64; 3]; 3];

/// Returns the product of an `N x 3` matrix and a 3x3 one.
pub fn mul<const N: usize>(a: &[Vec3; N], b: &Mat3) -> [Vec3; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Returns the transpose, which is a rotation's inverse.
pub fn transpose(a: &Mat3) -> Mat3 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// Returns the product of a matrix and a column vector.
pub fn apply(a: &Mat3, v: &Vec3) -> Vec3 {
    std::array::from_fn(|i| dot(&a[i], v))
}

/// Returns the inner product.
pub fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns `a - b`.
pub fn sub(a: &Vec3, b: &Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Returns the cross product `a x b`.
pub fn cross(a: &Vec3, b: &Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Returns `v / |v|` and `|v|`; the first is not finite if `v` is 0.
pub fn normalize<const N: usize>(v: &[f64; N]) -> ([f64; N], f64) {
    let norm = dot(v, v).sqrt();
    (v.map(|x| x / norm), norm)
}

/// Returns the gradient to `v` of a function of `v / |v|`, from that to the unit vector `n`.
pub fn normalize_backward<const N: usize>(n: &[f64; N], norm: f64, d: &[f64; N]) -> [f64; N] {
    let along = dot(n, d);
    std::array::from_fn(|i| (d[i] - n[i] * along) / norm)
}
