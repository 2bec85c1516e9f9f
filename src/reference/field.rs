//! The camera potential field by chords, a direction at a time.

use super::linalg::{Vec3, dot, sub};

/// `U_info = sum_i sech(sigma (1 - p . v_i))` and `U_conf = min_i angle(p, v_i)` of a unit
/// direction: with the chord `c` between two of them, `1 - p . v = c^2 / 2`, the angle is
/// `2 asin(c / 2)`.
pub fn potentials(p: &Vec3, directions: &[Vec3], sigma: f64) -> (f64, f64) {
    let (mut info, mut conf) = (0.0, f64::INFINITY);
    for v in directions {
        let offset = sub(p, v);
        let square = dot(&offset, &offset);
        let x = sigma * 0.5 * square;
        info += 2.0 / (x.exp() + (-x).exp());
        conf = f64::min(conf, 2.0 * (0.5 * square.sqrt()).min(1.0).asin());
    }
    (info, conf)
}
