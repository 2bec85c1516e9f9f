//! Projection of a Gaussian to a splat, and its exact derivative to the raw parameters.

use super::linalg::{
    Mat3, Vec3, apply, cross, dot, mul, normalize, normalize_backward, sub, transpose,
};
use super::model::{SplatGradient, TwinCamera, TwinGaussians, TwinSplat};
use super::sh;

/// Variance added to both diagonal entries of the 2D covariance, pixels squared.
pub const DILATION: f64 = 0.3;

/// Gradient to one Gaussian's raw parameters.
#[derive(Clone, Debug)]
pub struct RawGradient {
    /// To the world position.
    pub mean: Vec3,
    /// To the SH coefficients; 0 above the degree.
    pub sh: [Vec3; 16],
    /// To the opacity logit.
    pub opacity_logit: f64,
    /// To the natural logarithms of the scales.
    pub scale_log: Vec3,
    /// To the quaternion as stored, through its normalisation.
    pub rotation_wxyz: [f64; 4],
    /// To a small motion of the camera: its part of [`super::pose::pose_gradient`].
    pub pose: [f64; 6],
}

/// Returns the rotation matrix of a unit quaternion.
pub(super) fn rotation_matrix([w, x, y, z]: [f64; 4]) -> Mat3 {
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

/// Returns the gradient to the unit quaternion's components, each taken as free.
pub(super) fn rotation_matrix_backward([w, x, y, z]: [f64; 4], d: &Mat3) -> [f64; 4] {
    let skew = [d[2][1] - d[1][2], d[0][2] - d[2][0], d[1][0] - d[0][1]];
    let (xy, xz, yz) = (d[0][1] + d[1][0], d[0][2] + d[2][0], d[1][2] + d[2][1]);
    [
        2.0 * (x * skew[0] + y * skew[1] + z * skew[2]),
        2.0 * (w * skew[0] - 2.0 * x * (d[1][1] + d[2][2]) + y * xy + z * xz),
        2.0 * (w * skew[1] - 2.0 * y * (d[0][0] + d[2][2]) + x * xy + z * yz),
        2.0 * (w * skew[2] - 2.0 * z * (d[0][0] + d[1][1]) + x * xz + y * yz),
    ]
}

/// The Jacobian of the perspective projection at the clamped point, and what its derivative needs.
struct Jacobian {
    rows: [Vec3; 2],
    /// Clamped `x/z`, `y/z`.
    tangent: [f64; 2],
    clamped: [bool; 2],
}

fn jacobian(p: &Vec3, camera: &TwinCamera) -> Jacobian {
    let bounds = camera.tangent_bounds();
    let raw = [p[0] / p[2], p[1] / p[2]];
    let tangent = [0, 1].map(|i| raw[i].max(bounds[i][0]).min(bounds[i][1]));
    Jacobian {
        rows: [
            [camera.fx / p[2], 0.0, -camera.fx * tangent[0] / p[2]],
            [0.0, camera.fy / p[2], -camera.fy * tangent[1] / p[2]],
        ],
        tangent,
        clamped: [0, 1].map(|i| tangent[i] != raw[i]),
    }
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Projects Gaussian `i`: `cov2d = (J W R S)(J W R S)^T + 0.3 I`, colour
/// `max(0, 0.5 + sum_k Y_k sh_k)`, opacity `sigmoid(logit)` times the dropout's factor; valid iff
/// `p.z > near` and not dropped.
pub fn project(gaussians: &TwinGaussians, i: usize, camera: &TwinCamera) -> TwinSplat {
    let p = camera.to_camera(&gaussians.means[i]);
    let factor = camera.opacity_factor(i);
    if p[2].is_nan() || p[2] <= camera.near || factor == 0.0 {
        return TwinSplat {
            depth: p[2],
            ..TwinSplat::default()
        };
    }
    let (q, _) = normalize(&gaussians.rotation_wxyz[i]);
    let scale = gaussians.scale_log[i].map(f64::exp);
    let m = rotation_matrix(q).map(|row| std::array::from_fn(|j| row[j] * scale[j]));
    let t = mul(&jacobian(&p, camera).rows, &mul(&camera.rotation(), &m));
    let (xx, xy, yy) = (
        dot(&t[0], &t[0]) + DILATION,
        dot(&t[0], &t[1]),
        dot(&t[1], &t[1]) + DILATION,
    );
    let det = xx * yy - xy * xy;
    let (direction, _) = normalize(&sub(&gaussians.means[i], &camera.center()));
    TwinSplat {
        valid: true,
        mean2d: [
            camera.fx * p[0] / p[2] + camera.cx,
            camera.fy * p[1] / p[2] + camera.cy,
        ],
        depth: p[2],
        conic: [yy / det, -xy / det, xx / det],
        cov2d: [xx, xy, yy],
        rgb: sh::color(direction, &gaussians.sh[i], gaussians.sh_degree).map(|c| c.max(0.0)),
        opacity: factor * sigmoid(gaussians.opacity_logit[i]),
    }
}

/// Returns the gradient to Gaussian `i`'s raw parameters from that to its splat, through the clamp
/// of the Jacobian's point, the quaternion's normalisation and the view direction; 0 where not
/// valid.
pub fn project_backward(
    gaussians: &TwinGaussians,
    i: usize,
    camera: &TwinCamera,
    d: &SplatGradient,
) -> RawGradient {
    let mut out = RawGradient {
        mean: [0.0; 3],
        sh: [[0.0; 3]; 16],
        opacity_logit: 0.0,
        scale_log: [0.0; 3],
        rotation_wxyz: [0.0; 4],
        pose: [0.0; 6],
    };
    let splat = project(gaussians, i, camera);
    if !splat.valid {
        return out;
    }
    let [du, dv, d_a, d_b, d_c, dr, dg, db, d_opacity] = *d;
    let opacity = sigmoid(gaussians.opacity_logit[i]);
    out.opacity_logit = d_opacity * splat.opacity * (1.0 - opacity);

    // Colour, to the coefficients and through the direction to the mean.
    let (direction, distance) = normalize(&sub(&gaussians.means[i], &camera.center()));
    let color = sh::color(direction, &gaussians.sh[i], gaussians.sh_degree);
    let d_color: Vec3 = std::array::from_fn(|c| if color[c] > 0.0 { [dr, dg, db][c] } else { 0.0 });
    let (y, dy) = (sh::basis(direction), sh::basis_gradient(direction));
    let mut d_direction = [0.0; 3];
    for k in 0..(gaussians.sh_degree + 1).pow(2) {
        out.sh[k] = d_color.map(|dc| y[k] * dc);
        let weight = dot(&gaussians.sh[i][k], &d_color);
        for axis in 0..3 {
            d_direction[axis] += weight * dy[k][axis];
        }
    }
    let d_mean_color = normalize_backward(&direction, distance, &d_direction);

    // d cov = -K G K for K = cov^-1; G holds half of B's gradient in either off-diagonal.
    let [a, b, c] = splat.conic;
    let k = [[a, b], [b, c]];
    let g = [[d_a, d_b / 2.0], [d_b / 2.0, d_c]];
    let product = |m: [[f64; 2]; 2], n: [[f64; 2]; 2]| -> [[f64; 2]; 2] {
        [0, 1].map(|r| [0, 1].map(|s| m[r][0] * n[0][s] + m[r][1] * n[1][s]))
    };
    let d_cov = product(product(k, g), k).map(|row| row.map(|x| -x));

    // cov = T T^T with T = J (W R S).
    let p = camera.to_camera(&gaussians.means[i]);
    let (q, q_norm) = normalize(&gaussians.rotation_wxyz[i]);
    let scale = gaussians.scale_log[i].map(f64::exp);
    let r = rotation_matrix(q);
    let m: Mat3 = r.map(|row| std::array::from_fn(|j| row[j] * scale[j]));
    let w = camera.rotation();
    let wm = mul(&w, &m);
    let jac = jacobian(&p, camera);
    let t = mul(&jac.rows, &wm);
    let d_t: [Vec3; 2] = [0, 1].map(|row| {
        std::array::from_fn(|j| 2.0 * (d_cov[row][0] * t[0][j] + d_cov[row][1] * t[1][j]))
    });
    let d_j = mul(&d_t, &transpose(&wm));
    let d_wm: Mat3 = std::array::from_fn(|row| {
        std::array::from_fn(|j| jac.rows[0][row] * d_t[0][j] + jac.rows[1][row] * d_t[1][j])
    });
    let d_m = mul(&transpose(&w), &d_wm);
    out.scale_log =
        std::array::from_fn(|j| scale[j] * (0..3).map(|row| d_m[row][j] * r[row][j]).sum::<f64>());
    let d_r: Mat3 = d_m.map(|row| std::array::from_fn(|j| row[j] * scale[j]));
    out.rotation_wxyz = normalize_backward(&q, q_norm, &rotation_matrix_backward(q, &d_r));

    // J and mean2d, to the camera-space point.
    let mut d_p = [0.0; 3];
    for (axis, (f, d_mean2d)) in [(camera.fx, du), (camera.fy, dv)].into_iter().enumerate() {
        let z = p[2];
        d_p[axis] += d_mean2d * f / z;
        d_p[2] -= d_mean2d * f * p[axis] / (z * z);
        d_p[2] -= d_j[axis][axis] * f / (z * z);
        // J's last entry is -f tangent / z.
        d_p[2] += d_j[axis][2] * f * jac.tangent[axis] / (z * z);
        if !jac.clamped[axis] {
            let d_tangent = -d_j[axis][2] * f / z;
            d_p[axis] += d_tangent / z;
            d_p[2] -= d_tangent * p[axis] / (z * z);
        }
    }
    let d_mean_geometry = apply(&transpose(&w), &d_p);
    out.mean = std::array::from_fn(|axis| d_mean_geometry[axis] + d_mean_color[axis]);

    // A turn moves the camera-space point and W's rows, a shift the point and, seen from the
    // centre, the direction of the colour.
    let columns = (transpose(&wm), transpose(&d_wm));
    let turns = columns.0.iter().zip(&columns.1).map(|(x, d)| cross(x, d));
    let turn = turns.fold(cross(&p, &d_p), |sum, t| [0, 1, 2].map(|k| sum[k] + t[k]));
    let d_color_point = apply(&w, &d_mean_color);
    let shift: Vec3 = std::array::from_fn(|k| d_p[k] + d_color_point[k]);
    out.pose = std::array::from_fn(|k| if k < 3 { turn[k] } else { shift[k - 3] });
    out
}
