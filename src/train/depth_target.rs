//! This module has what a training view is held to beside its photograph.

use crate::render::{DepthSize, ViewUniform};

/// The depths and normals that a training view is held to, row 0 on top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthTarget {
    /// `height * width`, in the form that is compared: canonical depths, or what correlates with them.
    pub depth: Vec<f32>,
    /// `height * width`: weights of the depths; 0: there is none.
    pub weight: Vec<f32>,
    /// `height * width`, in the camera's axes, times their weight; empty without normals.
    pub normal: Vec<[f32; 3]>,
}

impl DepthTarget {
    /// Returns the bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.depth[..]) + size_of_val(&self.weight[..]) + size_of_val(&self.normal[..])
    }

    /// Returns everything that the loss follows from, for checksums.
    pub(super) fn parts(&self) -> [&[u8]; 3] {
        [
            bytemuck::cast_slice(&self.depth),
            bytemuck::cast_slice(&self.weight),
            bytemuck::cast_slice(&self.normal),
        ]
    }

    /// Writes the planes of a padded image as the kernels take them; what is not there weighs 0.
    pub(super) fn pack(&self, view: &ViewUniform, size: DepthSize, planes: &mut Vec<f32>) {
        let (row, plane) = (4 * view.padded_size().0, 4 * view.plane_len());
        let (width, height) = (view.size[0] as usize, view.size[1] as usize);
        planes.clear();
        planes.resize(size.n_planes() * plane, 0.0);
        for y in 0..height {
            let (from, to) = (y * width, y * row);
            for (k, values) in [&self.depth, &self.weight].into_iter().enumerate() {
                planes[k * plane + to..][..width].copy_from_slice(&values[from..][..width]);
            }
            if size.normals && !self.normal.is_empty() {
                for (x, normal) in self.normal[from..][..width].iter().enumerate() {
                    for (k, value) in normal.iter().enumerate() {
                        planes[(2 + k) * plane + to + x] = *value;
                    }
                }
            }
        }
    }
}
