//! This module finds cameras by their names, and the frame that cameras stand in.

use glam::DVec3;

use crate::camera::{Camera, Frame};
use crate::error::{Error, Result};
use crate::field::Focus;
use crate::scene::PointCloud;

/// Names of views that an error lists: a line of hundreds helps nobody.
pub(super) const MAX_LISTED: usize = 8;

/// Returns the cameras of these names, in their order.
///
/// # Errors
/// A name that no camera has.
pub(super) fn named(names: &[String], cameras: &[Camera]) -> Result<Vec<Camera>> {
    names
        .iter()
        .map(|name| {
            let found = cameras.iter().find(|camera| camera.name == *name);
            found.cloned().ok_or_else(|| {
                let mut known: Vec<&str> = cameras.iter().map(|c| c.name.as_str()).collect();
                let n_known = known.len();
                if n_known > MAX_LISTED {
                    known.truncate(MAX_LISTED);
                    known.push("...");
                }
                Error::usage(format!("no view is named `{}`", name.escape_debug()))
                    .way_out(format!("the {n_known} views are {}", known.join(", ")))
            })
        })
        .collect()
}

/// Finds the frame of a run by its training cameras, so that near planes are where its evaluation
/// has them; `None` where they span none.
pub(super) fn frame_of_cameras(train: &[Camera]) -> Option<Frame> {
    let focus = Focus::find(train, &PointCloud::default()).ok()?;
    Some(focus.frame())
}

/// Returns a frame about cameras alone: their mean, and the greatest distance from it.
pub(super) fn around(cameras: &[Camera]) -> Frame {
    let n = cameras.len().max(1) as f64;
    let center = cameras
        .iter()
        .map(|camera| camera.center() / n)
        .sum::<DVec3>();
    let reach = cameras
        .iter()
        .map(|c| c.center().distance(center))
        .fold(0.0, f64::max);
    let radius = if reach > 0.0 { reach } else { 1.0 };
    Frame {
        center,
        radius,
        extent: radius,
    }
}
