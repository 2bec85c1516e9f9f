//! If subjects are cut out of their photographs, the cloud keeps what lies within them.

use glam::DVec3;
use rayon::prelude::*;

use super::cloud::thin;
use super::{PointCloud, View};

/// Points of the whole cloud that are kept where masks drop some: what needs more than a sample of
/// it needs what is left.
const MAX_SAMPLE: usize = 60_000;

/// Drops points that some training view, its subject cut out, has in its frame but outside of its
/// mask, so that what is left lies within the visual hull (Laurentini 1994). A pixel beside the
/// mask's edge does not accuse: edges are seldom better than that. The count goes to `warnings`.
/// Returns, if any is dropped, a sample of the cloud as it was.
pub(super) fn keep_within_masks(
    cloud: &mut PointCloud,
    train: &[View],
    warnings: &mut Vec<String>,
) -> Option<PointCloud> {
    let n = cloud.len();
    let positions = cloud.positions.par_iter();
    let kept: Vec<bool> = positions
        .map(|p| train.iter().all(|view| view.has_within(*p) != Some(false)))
        .collect();
    if kept.iter().all(|kept| *kept) {
        return None;
    }
    let whole = thin(cloud, MAX_SAMPLE, 0);
    cloud.retain(&kept);
    warnings.push(format!(
        "{} of {n} points lie outside of the masks: dropped",
        n - cloud.len()
    ));
    Some(whole)
}

impl View {
    /// Returns whether the mask of a cut-out subject sets a pixel at a point of the world or beside it; `None` where the
    /// subject is not cut out, or the point does not lie in the frame.
    pub(crate) fn has_within(&self, point: DVec3) -> Option<bool> {
        let mask = self.mask.as_ref().filter(|_| self.is_cut_out())?;
        let (pixel, depth) = self.camera.project(point);
        let (width, height) = (self.image.width as usize, self.image.height as usize);
        let is_in = |at: f64, size: usize| (0.0..size as f64).contains(&at);
        if depth <= 0.0 || !is_in(pixel.x, width) || !is_in(pixel.y, height) {
            return None;
        }
        let beside =
            |at: f64, size: usize| (at as usize).saturating_sub(1)..(at as usize + 2).min(size);
        let is_set = |y: usize| beside(pixel.x, width).any(|x| mask.set[y * width + x]);
        Some(beside(pixel.y, height).any(is_set))
    }
}
