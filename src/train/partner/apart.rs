//! This module finds the Gaussians of one set that stand apart from all of the other.

use glam::Vec3;
use rayon::prelude::*;
use rstar::RTree;

/// Says of every one of `means` whether no finite one of `others` lies within `distance` (that far
/// itself counts as within); all in one unit.
pub fn apart(means: &[Vec3], others: &[Vec3], distance: f64) -> Vec<bool> {
    let point = |mean: &Vec3| mean.as_dvec3().to_array();
    // Distances to what is not finite have no order.
    let finite = others.iter().filter(|mean| mean.is_finite());
    let tree = RTree::bulk_load(finite.map(point).collect());
    let is_apart = |mean: &Vec3| {
        let within = |mean| tree.locate_within_distance(point(mean), distance * distance);
        !mean.is_finite() || within(mean).next().is_none()
    };
    means.par_iter().map(is_apart).collect()
}
