//! This module has the potentials of a direction, and the grid of candidate directions.

use std::f64::consts::TAU;

use glam::DVec3;

use super::Focus;
use crate::camera::Camera;
use crate::config::{FieldConfig, Kernel};

/// The camera potential field on the unit sphere of directions seen from the focus.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Unit directions `v_i` from the focus to the training cameras.
    pub directions: Vec<DVec3>,
    /// The kernel of `U_info`.
    pub kernel: Kernel,
    /// `sigma` or `kappa` of the kernel.
    pub sigma: f64,
    /// Weight of `U_conf` in `U_total`.
    pub lambda: f64,
}

impl Field {
    /// Makes the field of the training cameras. A camera at the focus itself has no direction; it
    /// counts as if drawn back along its optical axis, where cameras that look at `c` lie.
    pub fn new(cameras: &[Camera], focus: &Focus, config: &FieldConfig) -> Field {
        let directions = cameras
            .iter()
            .map(|camera| {
                let offset = (camera.center() - focus.center) / focus.radius;
                if offset.length() > 1e-9 {
                    offset.normalize()
                } else {
                    -camera.forward()
                }
            })
            .collect();
        Field {
            directions,
            kernel: config.kernel,
            sigma: config.sigma,
            lambda: config.lambda,
        }
    }

    /// Returns the information potential of a unit direction, the sum of the kernel over the
    /// cameras: `U_info(p) = sum_i sech(sigma (1 - p . v_i))` (Eq. 2), or with von Mises-Fisher
    /// `sum_i exp(kappa (p . v_i - 1))`, 1 at a lone camera's direction, too.
    pub fn u_info(&self, p: DVec3) -> f64 {
        let kernel = |x: f64| match self.kernel {
            Kernel::Sech => 1.0 / x.cosh(),
            Kernel::VonMisesFisher => (-x).exp(),
        };
        self.directions
            .iter()
            .map(|v| kernel(self.sigma * (1.0 - p.dot(*v))))
            .sum()
    }

    /// Returns the confidence penalty `U_conf(p) = min_i arccos(p . v_i)` of a unit direction,
    /// radians.
    pub fn u_conf(&self, p: DVec3) -> f64 {
        self.directions
            .iter()
            .map(|v| angle(p, *v))
            .fold(f64::INFINITY, f64::min)
    }

    /// Returns the camera potential `U_total = U_info + lambda U_conf` of a unit direction.
    pub fn u_total(&self, p: DVec3) -> f64 {
        self.u_info(p) + self.lambda * self.u_conf(p)
    }

    /// Returns the index of the training camera nearest to a unit direction, by angle; the first of
    /// equals.
    pub fn nearest(&self, p: DVec3) -> usize {
        let mut nearest = 0;
        for (i, v) in self.directions.iter().enumerate() {
            if angle(p, *v) < angle(p, self.directions[nearest]) {
                nearest = i;
            }
        }
        nearest
    }
}

/// Returns the angle between two unit vectors in radians; unlike `acos`, exact to rounding near 0
/// and pi.
pub fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// Directional coverage scores `Q_i` and their normalisation over the candidate grid.
#[derive(Clone, Debug)]
pub struct Coverage {
    field: Field,
    min: f64,
    max: f64,
    mean: f64,
}

impl Coverage {
    /// Takes the extremes and the mean of `U_info` over `grid`, unit directions, at least one.
    ///
    /// The grid and not the Gaussians sets the scale, so that thresholds stay put while
    /// Gaussians come and go.
    pub fn new(field: &Field, grid: &[DVec3]) -> Coverage {
        let mut coverage = Coverage {
            field: field.clone(),
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            mean: 0.0,
        };
        for &p in grid {
            let u = field.u_info(p);
            coverage.min = coverage.min.min(u);
            coverage.max = coverage.max.max(u);
            coverage.mean += u / grid.len() as f64;
        }
        coverage
    }

    /// Returns `Q_i = U_info((x_i - c) / |x_i - c|)` for `offset = x_i - c`, any unit of length. At
    /// `c` itself, which has no direction, the mean over the sphere.
    pub fn q(&self, offset: DVec3) -> f64 {
        match offset.try_normalize() {
            Some(direction) => self.field.u_info(direction),
            None => self.mean,
        }
    }

    /// Returns `Norm(Q)` in `[0, 1]`, min-max over the grid; 1 where the field is flat.
    pub fn norm_q(&self, q: f64) -> f64 {
        if self.max > self.min {
            ((q - self.min) / (self.max - self.min)).clamp(0.0, 1.0)
        } else {
            1.0
        }
    }
}

/// Returns `n` nearly uniform unit directions on a Fibonacci (golden angle) spiral around z.
pub fn fibonacci_sphere(n: usize) -> Vec<DVec3> {
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    (0..n)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
            let r = (1.0 - z * z).max(0.0).sqrt();
            // Whole turns are dropped before the multiplication, to keep the angle's digits.
            let (sin, cos) = (TAU * (golden * i as f64).fract()).sin_cos();
            DVec3::new(r * cos, r * sin, z)
        })
        .collect()
}
