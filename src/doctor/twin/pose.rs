//! Motion of a camera, and the gradient with respect to it.

use super::linalg::{Mat3, Vec3, apply, mul};
use super::model::{SplatGradient, TwinCamera, TwinGaussians};
use super::project::project_backward;

/// Returns the camera after the motion `(w, v)`: what lies at `p` in its axes lies at
/// `exp([w]x) p + v` afterwards.
pub fn moved(camera: &TwinCamera, motion: &[f64; 6]) -> TwinCamera {
    let [x, y, z, shift @ ..] = *motion;
    let turn = rotation(&[x, y, z]);
    let translation: Vec3 = std::array::from_fn(|i| camera.w2c[i][3]);
    let (r, t) = (mul(&turn, &camera.rotation()), apply(&turn, &translation));
    let row = |i: usize| [r[i][0], r[i][1], r[i][2], t[i] + shift[i]];
    TwinCamera {
        w2c: [row(0), row(1), row(2), camera.w2c[3]],
        ..camera.clone()
    }
}

/// Returns `exp([w]x)` by its series, for turns of at most a radian or so.
fn rotation(w: &Vec3) -> Mat3 {
    let skew = [[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]];
    let mut sum: Mat3 =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    let mut term = sum;
    for n in 1..=20 {
        term = mul(&term, &skew).map(|row| row.map(|x| x / f64::from(n)));
        for (sum, term) in sum.as_flattened_mut().iter_mut().zip(term.as_flattened()) {
            *sum += term;
        }
    }
    sum
}

/// Returns the gradient with respect to the motion `(w, v)` of [`moved`] at 0, from those to the
/// splats.
pub fn pose_gradient(
    gaussians: &TwinGaussians,
    camera: &TwinCamera,
    splats: &[SplatGradient],
) -> [f64; 6] {
    let mut sum = [0.0; 6];
    for (i, splat) in splats.iter().enumerate() {
        let part = project_backward(gaussians, i, camera, splat).pose;
        sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
    }
    sum
}
