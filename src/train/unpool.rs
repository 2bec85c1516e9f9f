//! Unpooling grows Gaussians where they are large and few (Zhu et al. 2024, "FSGS": proximity-guided growth).
//!
//! A Gaussian unpools if its three nearest others are far away in the mean and its greatest scale is large. Half-way to
//! each of the three comes a new one, with scales and opacity of that neighbour, unturned and grey: all its SH coefficients are
//! 0. Both thresholds are in 3DGS's camera extent, 1.1 times the greatest distance of a training camera from their mean.
//! Distances are taken as the paper has them; the published program compares the mean of their squares with 5 extents, so that what
//! unpools depends on the scene's unit.
//!
//! It follows what densification adds and prunes, as a change of its own. Gaussians of the far shell neither unpool nor are
//! neighbours.

use glam::Vec3;
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::policy::{Gathered, NEW, Plan};
use super::record::PlanCounts;
use super::trainer::Trainer;
use crate::config::UnpoolConfig;
use crate::error::Result;
use crate::gpu::{Gpu, shader_count};
use crate::render::{BLOCK_PLANES, Model, n_blocks};

/// Neighbours that a Gaussian unpools to.
const N_NEIGHBORS: usize = 3;

/// A rotation that turns nothing, w first.
const UNTURNED: [f32; 4] = [1.0, 0.0, 0.0, 0.0];

/// A Gaussian and a neighbour of it, half-way between which a new one comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair {
    /// Index of the one that unpools.
    pub of: usize,
    /// Index of the other, whose scales and opacity the new one has.
    pub neighbor: usize,
}

/// Returns what unpools of these Gaussians, in their order, to the nearest neighbour first; lengths of `config` are in `extent`, and
/// Gaussians beyond `frozen_beyond` do not take part. There are at most `room` pairs: the most distant Gaussians unpool where not
/// all can.
pub fn pairs(
    gathered: &Gathered,
    config: &UnpoolConfig,
    (extent, frozen_beyond): (f64, f32),
    room: usize,
) -> Vec<Pair> {
    let means = &gathered.means;
    let takes_part = |i: &usize| means[*i].is_finite() && means[*i].length() <= frozen_beyond;
    let point = |i: usize| means[i].as_dvec3().to_array();
    let scene = (0..means.len()).filter(takes_part);
    let tree = RTree::bulk_load(scene.map(|i| GeomWithData::new(point(i), i)).collect());
    let is_large = |i: &usize| {
        let scale = gathered.scales_log[*i].as_dvec3().exp().max_element();
        scale > config.scale * extent
    };
    let mut found: Vec<(f64, usize, Vec<usize>)> = (0..means.len())
        .into_par_iter()
        .filter(takes_part)
        .filter(is_large)
        .filter_map(|i| {
            let others = tree.nearest_neighbor_iter_with_distance_2(point(i));
            let others = others.filter(|(other, _)| other.data != i);
            let nearest: Vec<(usize, f64)> = others
                .take(N_NEIGHBORS)
                .map(|(other, squared)| (other.data, squared.sqrt()))
                .collect();
            let sum: f64 = nearest.iter().map(|(_, distance)| distance).sum();
            let mean = sum / nearest.len() as f64;
            let neighbors = nearest.into_iter().map(|(other, _)| other).collect();
            // Without others the mean is no number.
            (mean > config.distance * extent).then_some((mean, i, neighbors))
        })
        .collect();
    found.sort_by(|(a, i, _), (b, k, _)| b.total_cmp(a).then(i.cmp(k)));
    let mut n_left = room;
    found.retain(|(_, _, neighbors)| {
        let fits = neighbors.len() <= n_left;
        n_left = if fits { n_left - neighbors.len() } else { 0 };
        fits
    });
    found.sort_by_key(|(_, i, _)| *i);
    let of_one = |(_, of, neighbors): (f64, usize, Vec<usize>)| {
        let pair = move |neighbor| Pair { of, neighbor };
        neighbors.into_iter().map(pair)
    };
    found.into_iter().flat_map(of_one).collect()
}

impl Trainer<'_> {
    /// Unpools after `done` iterations.
    ///
    /// # Errors
    /// More Gaussians than the adapter can hold, or a GPU fault.
    pub(super) fn unpool(&mut self, done: u32) -> Result<()> {
        let gathered = self.optimizer.gather(self.gpu)?;
        let means = &gathered.means;
        let lengths = (self.supervision.extent, self.supervision.frozen_beyond());
        let room = self.config.densify.max_gaussians;
        let room = room.saturating_sub(means.len());
        let pairs = pairs(&gathered, &self.config.unpool, lengths, room);
        if pairs.is_empty() {
            return Ok(());
        }
        let counts = PlanCounts {
            unpooled: pairs.len(),
            ..PlanCounts::default()
        };
        let n_old = means.len();
        let mut plan = Plan::of_those_that_stay(&vec![true; n_old], counts);
        for Pair { of, neighbor } in pairs {
            let Vec3 { x, y, z } = 0.5 * (means[of] - means[neighbor]);
            plan.sources.push(shader_count(neighbor) | NEW);
            plan.changes.push([x, y, z, 0.0]);
        }
        self.rearrange(&plan, true, done)?;
        blank(self.gpu, &self.optimizer.model, n_old);
        Ok(())
    }
}

/// Takes turn and colour from the Gaussians from index `first` on.
fn blank(gpu: &Gpu, model: &Model, first: usize) {
    let n = model.n - first;
    let write = |block: usize, plane: usize, value: [f32; 4]| {
        let start = size_of_val(&value) * (plane * model.stride + first);
        let part = model.blocks[block].part(start as u64, (n * size_of_val(&value)) as u64);
        part.write(gpu, &vec![value; n]);
    };
    // The last plane of geometry.
    write(0, 2, UNTURNED);
    for (block, n_planes) in BLOCK_PLANES
        .iter()
        .enumerate()
        .take(n_blocks(model.sh_degree))
    {
        for plane in (0..*n_planes).filter(|_| block > 0) {
            write(block, plane, [0.0; 4]);
        }
    }
}
