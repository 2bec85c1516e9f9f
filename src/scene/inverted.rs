//! This module finds poses that a program wrote the wrong way round: camera-to-world where
//! world-to-camera belongs.
//!
//! Some converters to COLMAP's format do, DUSt3R's among them, and every trainer then learns from
//! cameras that look elsewhere. The point cloud tells: its colours are those of the photographs
//! where the poses are right.

use super::{PointCloud, View};
use crate::camera::Camera;

/// Points that are looked at, evenly over the cloud's order.
const MAX_POINTS: usize = 40_000;
/// Cells along a view's width; only the nearest of the points in one cell is seen.
const CELLS: u32 = 160;
/// A view in which fewer points are seen says nothing.
const MIN_SEEN: usize = 100;
/// How much better than chance the turned poses have to be, and how much better than those written.
const MOST: f64 = 0.8;
const GAIN: f64 = 0.75;
/// A single view may be worse by this, as where both ways are the same.
const SLACK: f64 = 1.05;

/// Returns the camera with its pose read as camera-to-world.
pub(super) fn turned(camera: &Camera) -> Camera {
    Camera {
        rotation: camera.rotation.transpose(),
        translation: camera.center(),
        ..camera.clone()
    }
}

/// Returns whether the photographs of `views` agree with the cloud's colours if their poses are
/// turned round, and clearly less as they are written.
pub(super) fn are_inverted(views: &[View], cloud: &PointCloud) -> bool {
    let pair = |view: &View| {
        // A camera that sees nothing of the cloud agrees with it no better than chance.
        let written = disagreement(view, &view.camera, cloud).unwrap_or(1.0);
        let turned = disagreement(view, &turned(&view.camera), cloud)?;
        Some((written, turned))
    };
    let Some(pairs) = views.iter().map(pair).collect::<Option<Vec<_>>>() else {
        return false;
    };
    let n = pairs.len().max(1) as f64;
    let written = pairs.iter().map(|p| p.0).sum::<f64>() / n;
    let turned = pairs.iter().map(|p| p.1).sum::<f64>() / n;
    let none_suffers = pairs.iter().all(|(w, t)| *t <= SLACK * w);
    !pairs.is_empty() && none_suffers && turned < MOST && turned < GAIN * written
}

/// Returns the mean difference between the colours of the points that `camera` sees and the
/// photograph's, as a share of what it is for points in other places: about 1 where they have
/// nothing to do with each other. `None` if too few are seen.
fn disagreement(view: &View, camera: &Camera, cloud: &PointCloud) -> Option<f64> {
    let (width, height) = (camera.width, camera.height);
    let cell = f64::from(width.div_ceil(CELLS));
    let columns = (f64::from(width) / cell).ceil() as usize;
    let rows = (f64::from(height) / cell).ceil() as usize;
    let mut nearest: Vec<Option<(f64, usize, usize)>> = vec![None; columns * rows];
    let step = cloud.len().div_ceil(MAX_POINTS).max(1);
    for point in (0..cloud.len()).step_by(step) {
        let (at, depth) = camera.project(cloud.positions[point]);
        let is_inside =
            at.x >= 0.0 && at.y >= 0.0 && at.x < f64::from(width) && at.y < f64::from(height);
        if !(depth > 0.0 && depth.is_finite() && is_inside) {
            continue;
        }
        let place = (at.y / cell) as usize * columns + (at.x / cell) as usize;
        let pixel = at.y as usize * width as usize + at.x as usize;
        if nearest[place].is_none_or(|(before, ..)| depth < before) {
            nearest[place] = Some((depth, point, pixel));
        }
    }
    let seen: Vec<(usize, usize)> = nearest.into_iter().flatten().map(|s| (s.1, s.2)).collect();
    if seen.len() < MIN_SEEN {
        return None;
    }
    let difference = |point: usize, pixel: usize| -> f64 {
        let photographed = &view.image.rgb[3 * pixel..][..3];
        let colors = cloud.colors[point].iter().zip(photographed);
        colors.map(|(a, b)| f64::from(a.abs_diff(*b))).sum()
    };
    let own: f64 = seen
        .iter()
        .map(|(point, pixel)| difference(*point, *pixel))
        .sum();
    // Half an image further, and at a few other distances.
    let n = seen.len();
    let shifts = [n / 2, n / 3, 2 * n / 3, n / 5, 4 * n / 5];
    let other = |shift: usize| -> f64 {
        let pairs = (0..n).map(|i| (seen[i].0, seen[(i + shift) % n].1));
        pairs.map(|(point, pixel)| difference(point, pixel)).sum()
    };
    let chance = shifts.iter().map(|s| other(*s)).sum::<f64>() / shifts.len() as f64;
    (chance > 0.0).then(|| own / chance)
}
