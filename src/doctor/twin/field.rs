//! The camera potential field by chords, one direction at a time.

use super::linalg::{Vec3, dot, sub};

/// The potentials of a unit direction `p` among the directions `v_i` to the cameras.
#[derive(Clone, Copy, Debug)]
pub struct TwinPotentials {
    /// `U_info = sum_i sech(sigma (1 - p . v_i))`.
    pub sech: f64,
    /// `U_info = sum_i exp(sigma (p . v_i - 1))`.
    pub von_mises_fisher: f64,
    /// `U_conf = min_i angle(p, v_i)`.
    pub conf: f64,
}

/// Returns the potentials at `p`. With the chord `c` between two directions, `1 - p . v = c^2 / 2`
/// and the angle is `2 asin(c / 2)`.
pub fn potentials(p: &Vec3, directions: &[Vec3], sigma: f64) -> TwinPotentials {
    let mut out = TwinPotentials {
        sech: 0.0,
        von_mises_fisher: 0.0,
        conf: f64::INFINITY,
    };
    for v in directions {
        let offset = sub(p, v);
        let square = dot(&offset, &offset);
        let x = sigma * 0.5 * square;
        out.sech += 2.0 / (x.exp() + (-x).exp());
        out.von_mises_fisher += (-x).exp();
        out.conf = out.conf.min(2.0 * (0.5 * square.sqrt()).min(1.0).asin());
    }
    out
}
