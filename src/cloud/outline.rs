//! This module tells what a virtual view can know of the outline of a cut-out subject.
//!
//! A splat says where points are, not where nothing is: a pixel without a point may be a hole, and a disc reaches beyond the
//! subject's edge. So training on splats alone lets the subject swell and the space about it fill. Photographs whose
//! subject is cut out say more: what lies outside of one of their masks is empty. Beyond the visual hull (Laurentini 1994) a virtual
//! view shows the background. Within it a covered pixel that is as near to an empty one as a disc's radius does not count.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::hull::{COARSE, Grid};
use super::splat::SplatImage;
use crate::camera::{Camera, Frame};
use crate::gpu::constants::LEVEL_MAX;
use crate::scene::{PointCloud, View};

/// Cells of the hull along each axis.
const FINE: usize = 128;

/// Share of the cloud that lies within the hull if the photographs show the subject whole.
const WITHIN: f64 = 0.95;

/// The visual hull of a cut-out subject, and what lies beyond it.
#[derive(Debug)]
pub struct Outline {
    /// Middles of the cells on its surface, in the world frame.
    places: Vec<DVec3>,
    /// Half the diagonal of a cell, in the world's unit.
    reach: f64,
    /// RGBA.
    ground: [u8; 4],
    /// Pixels.
    rim: usize,
}

impl Outline {
    /// Finds the hull of the subject that all `views` are cut out for, within the sphere's radius about the focus: the places
    /// that all views but one show, and none has in its frame but outside of its mask. A virtual view has `background` (RGB in
    /// `[0, 1]`) beyond it, and discs of at most `max_radius_px`. Returns `None` where a subject is not cut out, or the hull
    /// does not hold the `cloud`: photographs that do not show the subject whole bound a part of it.
    pub fn of(
        views: &[View],
        cloud: &PointCloud,
        frame: &Frame,
        background: [f64; 3],
        max_radius_px: f64,
    ) -> Option<Outline> {
        if !views.iter().all(View::is_cut_out) {
            return None;
        }
        let within = cloud.positions.par_iter();
        let within = within.filter(|place| is_shown(views, **place)).count();
        if (within as f64) < WITHIN * cloud.len() as f64 {
            return None;
        }
        let half = DVec3::splat(frame.radius);
        let cube = Grid {
            n: COARSE,
            low: frame.center - half,
            high: frame.center + half,
        };
        let found = (0..COARSE.pow(3)).into_par_iter().map(|i| cube.place(i));
        let found = found.filter(|place| is_shown(views, *place));
        let (low, high) = found
            .map(|place| (place, place))
            .reduce_with(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        let grid = Grid {
            n: FINE,
            low: low - cube.cell(),
            high: high + cube.cell(),
        };
        let cells = (0..FINE.pow(3)).into_par_iter();
        let shown: Vec<bool> = cells.map(|i| is_shown(views, grid.place(i))).collect();
        let places = (0..shown.len()).filter(|i| is_surface(&shown, *i));
        let [r, g, b] = background.map(|c| (LEVEL_MAX * c).round() as u8);
        Some(Outline {
            places: places.map(|i| grid.place(i)).collect(),
            reach: 0.5 * grid.cell().length(),
            ground: [r, g, b, u8::MAX],
            rim: max_radius_px.ceil() as usize,
        })
    }

    /// Gives the splat of a camera, of the world frame, the background beyond the hull, and empties its rim.
    pub fn draw(&self, camera: &Camera, splat: &mut SplatImage) {
        let width = splat.width as usize;
        let hull = self.silhouette(camera);
        let empty: Vec<bool> = splat.mask().map(|covered| !covered).collect();
        let rim = dilated(&empty, width, self.rim);
        let pixels = splat.rgba.chunks_exact_mut(4).zip(hull.iter().zip(rim));
        for (pixel, (hull, rim)) in pixels {
            match (hull, rim) {
                (false, _) => pixel.copy_from_slice(&self.ground),
                (true, true) => pixel.fill(0),
                (true, false) => {}
            }
        }
    }

    /// Returns the pixels, `height * width`, that some cell of the hull may touch.
    fn silhouette(&self, camera: &Camera) -> Vec<bool> {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut set = vec![false; width * height];
        for place in &self.places {
            let (pixel, depth) = camera.project(*place);
            if depth <= 0.0 {
                continue;
            }
            let reach = self.reach * camera.fx.max(camera.fy) / depth;
            let columns = touched(pixel.x, reach, width);
            for y in touched(pixel.y, reach, height) {
                set[y * width..][columns.clone()].fill(true);
            }
        }
        set
    }
}

/// Returns whether all views but one show a place, and none says that nothing is there.
fn is_shown(views: &[View], place: DVec3) -> bool {
    let mut n = 0;
    for view in views {
        match view.has_within(place) {
            Some(true) => n += 1,
            Some(false) => return false,
            None => {}
        }
    }
    n >= views.len().saturating_sub(1).max(1)
}

/// Returns whether a cell of the cube of [`FINE`] cells a side is set and one that it shares a side with is not.
fn is_surface(set: &[bool], i: usize) -> bool {
    let steps = [1, FINE, FINE * FINE];
    let is_open = |step: usize| {
        let at = i / step % FINE;
        at == 0 || at == FINE - 1 || !set[i - step] || !set[i + step]
    };
    set[i] && steps.into_iter().any(is_open)
}

/// Returns the pixels of a row of `limit` that lie at least partly within `reach` of `middle`.
fn touched(middle: f64, reach: f64, limit: usize) -> Range<usize> {
    // Casts saturate, and NaN becomes 0.
    let first = (middle - reach).floor().max(0.0) as usize;
    let end = ((middle + reach).floor() + 1.0).clamp(0.0, limit as f64) as usize;
    first.min(end)..end
}

/// Returns the pixels that lie within `reach` rows and columns of one that is set.
fn dilated(set: &[bool], width: usize, reach: usize) -> Vec<bool> {
    let height = set.len() / width;
    let about = |at: usize, limit: usize| at.saturating_sub(reach)..(at + reach + 1).min(limit);
    let mut in_rows = vec![false; set.len()];
    for i in (0..set.len()).filter(|i| set[*i]) {
        in_rows[i - i % width..][about(i % width, width)].fill(true);
    }
    let mut all = vec![false; set.len()];
    for i in (0..set.len()).filter(|i| in_rows[*i]) {
        about(i / width, height).for_each(|y| all[y * width + i % width] = true);
    }
    all
}
