//! The far shell is a background that lives in the file.
//!
//! Large round Gaussians tile a sphere about the focus, beyond every camera and every point of the
//! cloud. They learn colour alone: with their geometry frozen they can neither come before the
//! scene nor leave holes. Position tells them from others, whatever densification does to the set:
//! what lies beyond [`Shell::inner_radius`] is frozen, is never pruned, cloned or split, and keeps
//! its opacity when the others' is reset.

use glam::{DVec3, Vec3};

use crate::config::ShellConfig;
use crate::field::fibonacci_sphere;
use crate::gaussians::{Gaussians, SH_0, n_sh};

/// The shell lies at least this far beyond the farthest Gaussian of the scene.
const MARGIN: f64 = 1.5;

/// Standard deviation in spacings, `r sqrt(4 pi / count)`: at 0.7 no gap lets 3 % through.
const SIZE: f64 = 0.7;

const OPACITY: f64 = 0.99;

/// The shell's place, in the canonical frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shell {
    count: usize,
    radius: f64,
}

impl Shell {
    /// Returns the shell around `scene`, or `None` where `config.count` is 0.
    pub fn around(scene: &Gaussians, config: &ShellConfig) -> Option<Shell> {
        let distances = scene.means.iter().map(|mean| mean.as_dvec3().length());
        let farthest = distances.fold(0.0, f64::max);
        (config.count > 0).then_some(Shell {
            count: config.count,
            radius: config.radius.max(MARGIN * farthest),
        })
    }

    /// Returns the number of its Gaussians.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the distance from the focus beyond which Gaussians are the shell's.
    pub fn inner_radius(&self) -> f64 {
        self.radius / MARGIN.sqrt()
    }

    /// Makes its Gaussians, all of one `color` (RGB, 0 to 1), on a Fibonacci sphere.
    pub fn gaussians(&self, color: DVec3, sh_degree: u32) -> Gaussians {
        let count = self.count;
        let spacing = self.radius * (4.0 * std::f64::consts::PI / count as f64).sqrt();
        let n_sh = 3 * n_sh(sh_degree);
        let mut sh = vec![0.0; count * n_sh];
        for sh in sh.chunks_exact_mut(n_sh) {
            for (dc, value) in sh.iter_mut().zip(color.to_array()) {
                *dc = ((value - 0.5) / SH_0) as f32;
            }
        }
        Gaussians {
            means: fibonacci_sphere(count)
                .into_iter()
                .map(|direction| (self.radius * direction).as_vec3())
                .collect(),
            scales_log: vec![Vec3::splat((SIZE * spacing).ln() as f32); count],
            rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]; count],
            opacity_logits: vec![(OPACITY / (1.0 - OPACITY)).ln() as f32; count],
            sh,
            sh_degree,
        }
    }
}
