//! This module leaves out pieces of a mesh that float alone.

use super::Mesh;

/// A piece of fewer triangles than this share of the mesh is left out.
const LEAST_SHARE: f64 = 1e-3;

/// Returns the mesh without its small pieces: triangles that hang together through vertices, and are
/// fewer than a thousandth of all.
pub(super) fn without_small_pieces(mesh: &Mesh) -> Mesh {
    let mut roots = Roots((0..mesh.positions.len() as u32).collect());
    for [a, b, c] in &mesh.triangles {
        roots.join(*a, *b);
        roots.join(*b, *c);
    }
    let of: Vec<usize> = mesh
        .triangles
        .iter()
        .map(|triangle| roots.root(triangle[0]) as usize)
        .collect();
    let mut sizes = vec![0_usize; mesh.positions.len()];
    of.iter().for_each(|root| sizes[*root] += 1);
    let least = LEAST_SHARE * mesh.triangles.len() as f64;
    mesh.kept(|i| sizes[of[i]] as f64 >= least)
}

/// Sets of vertices, each known by one of them.
struct Roots(Vec<u32>);

impl Roots {
    fn root(&mut self, vertex: u32) -> u32 {
        let mut at = vertex;
        loop {
            let above = self.0[at as usize];
            if above == at {
                return at;
            }
            // Halves the way for the next time.
            self.0[at as usize] = self.0[above as usize];
            at = above;
        }
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
