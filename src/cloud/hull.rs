//! This module makes the visual hull of a cut-out subject (Laurentini 1994), which GaussianObject (Yang et al. 2024) starts
//! from in place of a point cloud.
//!
//! A place agrees with a view if the view has it before itself, in its frame and within its mask; those that all views but one
//! agree with belong to the hull. It is looked for twice: in a coarse grid of a cube about the focus, and in a finer one of the
//! box about what was found, doubled. GaussianObject's cube is 4 units wide to each side of the cameras' mean; here it reaches
//! to the sphere's radius, whatever the unit. A point has the mean colour of the views that agree with it.

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::Frame;
use crate::error::{Error, Result};
use crate::scene::{PointCloud, View};

/// Places of the first grid along each axis.
pub(super) const COARSE: usize = 200;

/// Places of the second.
const FINE: usize = 64;

/// The second grid's box, in boxes about what the first has found.
const ENLARGED: f64 = 2.0;

/// Returns the points of the hull, in the world frame.
///
/// # Errors
/// A view without a mask, or masks that have no place in common.
pub fn visual_hull(views: &[View], frame: &Frame) -> Result<PointCloud> {
    if let Some(view) = views.iter().find(|view| view.mask.is_none()) {
        return Err(Error::new("no mask says what the subject is")
            .at(&view.camera.name)
            .way_out("give photographs with an alpha channel or a mask in masks/, or `--set model.start=cloud`"));
    }
    let half = DVec3::splat(frame.radius);
    let coarse = Grid {
        n: COARSE,
        low: frame.center - half,
        high: frame.center + half,
    };
    let found = coarse.agreed(views);
    let Some(&first) = found.positions.first() else {
        return Err(nothing());
    };
    let (low, high) = found
        .positions
        .iter()
        .fold((first, first), |(low, high), p| (low.min(*p), high.max(*p)));
    // A box of one place is as large as its cell.
    let half = (0.5 * (high - low)).max(0.5 * coarse.cell());
    let fine = Grid {
        n: FINE,
        low: low.midpoint(high) - ENLARGED * half,
        high: low.midpoint(high) + ENLARGED * half,
    };
    let hull = fine.agreed(views);
    match hull.is_empty() {
        true => Err(nothing()),
        false => Ok(hull),
    }
}

fn nothing() -> Error {
    Error::new("the masks have no place in common").way_out(
        "masks are white where the subject is, and poses must belong to the photographs; `--set model.start=cloud` starts from \
         the point cloud",
    )
}

/// Places in a box of the world, in the middle of `n` cells along each axis.
pub(super) struct Grid {
    pub(super) n: usize,
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Grid {
    /// Returns the sides of a cell.
    pub(super) fn cell(&self) -> DVec3 {
        (self.high - self.low) / self.n as f64
    }

    /// Returns place `i`: x runs fastest, then y.
    pub(super) fn place(&self, i: usize) -> DVec3 {
        let [x, y, z] = [i % self.n, i / self.n % self.n, i / self.n.pow(2)].map(|at| at as f64);
        self.low + (DVec3::new(x, y, z) + DVec3::splat(0.5)) * self.cell()
    }

    /// Returns the places that all views but one agree with, layer by layer.
    fn agreed(&self, views: &[View]) -> PointCloud {
        let least = views.len().saturating_sub(1).max(1);
        let layers = (0..self.n).into_par_iter().map(|z| {
            let layer = (0..self.n * self.n).filter_map(|i| {
                let place = self.place(z * self.n * self.n + i);
                let seen = views.iter().filter_map(|view| seen_at(view, place));
                let (n, sum) = seen.fold((0, [0; 3]), |(n, sum), rgb| {
                    (n + 1, [0, 1, 2].map(|c| sum[c] + u32::from(rgb[c])))
                });
                let mean = |sum: u32| ((sum + n / 2) / n) as u8;
                (n as usize >= least).then(|| (place, sum.map(mean)))
            });
            layer.collect::<Vec<_>>()
        });
        let layers: Vec<Vec<(DVec3, [u8; 3])>> = layers.collect();
        let mut cloud = PointCloud::default();
        for (position, color) in layers.into_iter().flatten() {
            cloud.positions.push(position);
            cloud.colors.push(color);
        }
        cloud
    }
}

/// Returns the colour of a view that agrees with a place.
fn seen_at(view: &View, place: DVec3) -> Option<[u8; 3]> {
    let (pixel, depth) = view.camera.project(place);
    let (width, height) = (view.image.width as usize, view.image.height as usize);
    let is_in = |at: f64, size: usize| (0.0..size as f64).contains(&at);
    if depth <= 0.0 || !is_in(pixel.x, width) || !is_in(pixel.y, height) {
        return None;
    }
    let i = pixel.y as usize * width + pixel.x as usize;
    let rgb = &view.image.rgb[3 * i..3 * i + 3];
    let shows = view.mask.as_ref().is_some_and(|mask| mask.set[i]);
    shows.then(|| [rgb[0], rgb[1], rgb[2]])
}
