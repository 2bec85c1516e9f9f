//! This module makes a cloud of depth maps: of their surest pixels, without edges and without what
//! another view denies.

use rayon::prelude::*;

use super::DepthMap;
use super::edges::is_edge;
use crate::scene::PointCloud;

/// Depths of two views agree within this share.
const AGREEMENT: f64 = 0.05;

/// Options that say which pixels become points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudOptions {
    /// Share of each view's pixels that are kept, the surest.
    pub share: f64,
}

/// A cloud, and what was left out of it.
#[derive(Clone, Debug, Default)]
pub struct Cloud {
    /// The points in the world frame, with colour and confidence.
    pub points: PointCloud,
    /// The number of the view that each point came from.
    pub views: Vec<u32>,
    /// Pixels left out because their confidence is too low or they have no depth.
    pub n_unsure: usize,
    /// Pixels left out at an edge of depth, where a point would lie between two surfaces.
    pub n_edges: usize,
    /// Pixels left out because more views see through the point than confirm it.
    pub n_denied: usize,
}

enum Pixel {
    Kept(f32),
    Unsure,
    Edge,
    Denied,
}

/// Makes one cloud from all views, view by view and row by row.
///
/// A view denies a point where it sees through it: its own surface lies farther behind the point
/// than both depths may be wrong. A point that more views deny than confirm goes; one that is
/// denied at all loses confidence in proportion. A point behind a view's surface is hidden
/// from it and counts neither way.
pub fn cloud(maps: &[DepthMap], options: CloudOptions) -> Cloud {
    let mut cloud = Cloud::default();
    let mut confidences = Vec::new();
    for (view, map) in maps.iter().enumerate() {
        let least = quantile(map, 1.0 - options.share);
        let width = map.camera.width as usize;
        let judged: Vec<Pixel> = (0..map.depth.len())
            .into_par_iter()
            .map(|i| judge(maps, view, (i % width, i / width), least))
            .collect();
        for (i, pixel) in judged.into_iter().enumerate() {
            match pixel {
                Pixel::Kept(confidence) => {
                    let (x, y) = (i % width, i / width);
                    cloud
                        .points
                        .positions
                        .push(map.point(x, y, f64::from(map.depth[i])));
                    cloud.points.colors.push(map.colors[i]);
                    cloud.views.push(view as u32);
                    confidences.push(confidence);
                }
                Pixel::Unsure => cloud.n_unsure += 1,
                Pixel::Edge => cloud.n_edges += 1,
                Pixel::Denied => cloud.n_denied += 1,
            }
        }
    }
    cloud.points.confidence = Some(confidences);
    cloud
}

/// Returns the confidence below which this share of a view's pixels lies.
fn quantile(map: &DepthMap, share: f64) -> f32 {
    let mut sorted = map.confidence.clone();
    let Some(last) = sorted.len().checked_sub(1) else {
        return 0.0;
    };
    let at = (share.clamp(0.0, 1.0) * last as f64).round() as usize;
    *sorted.select_nth_unstable_by(at, f32::total_cmp).1
}

fn judge(maps: &[DepthMap], view: usize, (x, y): (usize, usize), least: f32) -> Pixel {
    let map = &maps[view];
    let confidence = map.confidence[y * map.camera.width as usize + x];
    let Some(depth) = map.at(x, y).filter(|_| confidence >= least) else {
        return Pixel::Unsure;
    };
    if is_edge(map, x, y, depth) {
        return Pixel::Edge;
    }
    let point = map.point(x, y, depth);
    let (mut confirmed, mut denied) = (1, 0);
    for (_, other) in maps.iter().enumerate().filter(|(i, _)| *i != view) {
        let (place, z) = other.camera.project(point);
        let pixel = if z > 0.0 { other.pixel(place) } else { None };
        let Some((x, y)) = pixel else { continue };
        // A view's opinion counts where it is not itself in doubt.
        let Some(seen) = other.at(x, y).filter(|seen| !is_edge(other, x, y, *seen)) else {
            continue;
        };
        if seen > z * (1.0 + AGREEMENT) {
            denied += 1;
        } else if z <= seen * (1.0 + AGREEMENT) {
            confirmed += 1;
        }
    }
    if denied > confirmed {
        return Pixel::Denied;
    }
    Pixel::Kept(confidence * confirmed as f32 / (confirmed + denied) as f32)
}
