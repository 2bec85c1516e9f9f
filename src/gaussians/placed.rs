//! This module takes Gaussians to another frame.

use glam::{DMat3, DQuat};
use rayon::prelude::*;

use super::Gaussians;
use super::sh::ShRotation;
use crate::camera::Similarity;

impl Gaussians {
    /// Returns the Gaussians seen from the new frame of `similarity`: means, scales, rotations and
    /// view-dependent colour. What it leaves alone keeps its bits; one that has no rotation, and is
    /// never drawn, keeps that.
    pub fn placed(mut self, similarity: &Similarity) -> Gaussians {
        self.means
            .iter_mut()
            .for_each(|mean| *mean = similarity.point(mean.as_dvec3()).as_vec3());
        if similarity.scale != 1.0 {
            let log = similarity.scale.ln();
            self.scales_log
                .iter_mut()
                .for_each(|scale| *scale = (scale.as_dvec3() + log).as_vec3());
        }
        if similarity.rotation == DMat3::IDENTITY {
            return self;
        }
        let turn = DQuat::from_mat3(&similarity.rotation);
        for i in 0..self.len() {
            if let Some([w, x, y, z]) = self.rotation(i) {
                let [w, x, y, z] = [w, x, y, z].map(f64::from);
                let turned = (turn * DQuat::from_xyzw(x, y, z, w)).normalize();
                self.rotations_wxyz[i] = [turned.w, turned.x, turned.y, turned.z].map(|q| q as f32);
            }
        }
        let turn = ShRotation::new(similarity.rotation);
        let n = 3 * self.n_sh();
        self.sh.par_chunks_exact_mut(n).for_each(|sh| turn.turn(sh));
        self
    }
}
