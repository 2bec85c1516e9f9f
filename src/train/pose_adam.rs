//! This module applies Adam to the pose of a camera.

use serde::{Deserialize, Serialize};

use crate::camera::Camera;

const BETAS: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-15;

/// The moments of a camera's six motions, in the camera's own axes: turn, then shift.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseAdam {
    first: [f64; 6],
    second: [f64; 6],
    /// Steps taken.
    n: u32,
}

impl PoseAdam {
    /// Returns the camera after a step (Kingma and Ba 2015) against the gradient `d`; `rates` are
    /// those of turns (radians) and of shifts (units of length).
    pub fn step(&mut self, camera: &Camera, d: [f64; 6], rates: [f64; 2]) -> Camera {
        self.n += 1;
        let [b1, b2] = BETAS;
        let corrections = BETAS.map(|b| 1.0 - b.powf(f64::from(self.n)));
        let motion = std::array::from_fn(|k| {
            self.first[k] = b1 * self.first[k] + (1.0 - b1) * d[k];
            self.second[k] = b2 * self.second[k] + (1.0 - b2) * d[k] * d[k];
            let (m, v) = (
                self.first[k] / corrections[0],
                self.second[k] / corrections[1],
            );
            -rates[k / 3] * m / (v.sqrt() + EPSILON)
        });
        camera.moved(motion)
    }
}
