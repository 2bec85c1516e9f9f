//! A surface mesh of trained Gaussians: depth of every view, fused into a volume of signed
//! distances, and the surface where they change sign.
//!
//! [`depth`] is where a view's rays lose half of their light; [`Volume`] averages what the views
//! say of each voxel (TSDF fusion, Curless and Levoy 1996), and [`Volume::surface`] takes the mesh
//! from it by surface nets. Voxels that no view saw have no surface, so holes stay open.

mod depth;
mod pieces;
mod volume;
mod write;

pub use depth::depth;
pub use volume::{DepthImage, Grid, Volume};
pub use write::MeshFormat;

use glam::DVec3;

use crate::camera::Similarity;

/// A mesh of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Places of the vertices.
    pub positions: Vec<DVec3>,
    /// Colours of the vertices, sRGB in [0, 1].
    pub colors: Vec<[f32; 3]>,
    /// Vertices of each triangle, anticlockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Returns the mesh in the new frame of a similarity.
    pub fn placed(mut self, similarity: &Similarity) -> Mesh {
        self.positions
            .iter_mut()
            .for_each(|p| *p = similarity.point(*p));
        self
    }

    /// Returns the mesh of the triangles for which `keeps` is true, by their number, and of the
    /// vertices that they have.
    fn kept(&self, keeps: impl Fn(usize) -> bool) -> Mesh {
        let mut number = vec![u32::MAX; self.positions.len()];
        let mut mesh = Mesh::default();
        for (_, triangle) in self.triangles.iter().enumerate().filter(|(i, _)| keeps(*i)) {
            let corners = triangle.map(|vertex| {
                let vertex = vertex as usize;
                if number[vertex] == u32::MAX {
                    number[vertex] = mesh.positions.len() as u32;
                    mesh.positions.push(self.positions[vertex]);
                    mesh.colors.push(self.colors[vertex]);
                }
                number[vertex]
            });
            mesh.triangles.push(corners);
        }
        mesh
    }
}
