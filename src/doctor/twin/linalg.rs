//! 3x3 and 2x3 products on plain arrays, row-major, column vectors.

pub type Vec3 = [f64; 3];
pub type Mat3 = [[f64; 3]; 3];

/// The product of an `N x 3` matrix and a 3x3 one.
pub fn mul<const N: usize>(a: &[Vec3; N], b: &Mat3) -> [Vec3; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

pub fn transpose(a: &Mat3) -> Mat3 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

pub fn apply(a: &Mat3, v: &Vec3) -> Vec3 {
    std::array::from_fn(|i| dot(&a[i], v))
}

pub fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub fn sub(a: &Vec3, b: &Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}

pub fn cross(a: &Vec3, b: &Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// `v / |v|` and `|v|`.
pub fn normalize<const N: usize>(v: &[f64; N]) -> ([f64; N], f64) {
    let norm = dot(v, v).sqrt();
    (v.map(|x| x / norm), norm)
}

/// Gradient to `v` of a function of `v / |v|`, from that to the unit vector `n`.
pub fn normalize_backward<const N: usize>(n: &[f64; N], norm: f64, d: &[f64; N]) -> [f64; N] {
    let along = dot(n, d);
    std::array::from_fn(|i| (d[i] - n[i] * along) / norm)
}
