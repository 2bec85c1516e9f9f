//! This module places cameras on a full turn around the focus.

use crate::camera::Camera;
use crate::camera::compass::Compass;
use crate::error::{Error, Result};
use crate::field::Focus;

/// Places `n` cameras at equal angles that look at the focus, from the first of `cameras` to the
/// right, with its intrinsics: at their median distance and mean elevation.
///
/// # Errors
/// No camera.
pub(crate) fn orbit(cameras: &[Camera], focus: &Focus, n: u32) -> Result<Vec<Camera>> {
    let Some(first) = cameras.first() else {
        return Err(Error::new("there is no camera to orbit from"));
    };
    let compass = Compass::of_cameras(cameras, focus.center)?;
    let offsets = || cameras.iter().map(|c| c.center() - focus.center);
    let mut distances: Vec<f64> = offsets().map(|offset| offset.length()).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let distance = distances[distances.len() / 2];
    let elevations = offsets().map(|offset| compass.angles(offset.normalize_or_zero()).1);
    // At a pole a turn would spin the image about its centre.
    let elevation = (elevations.sum::<f64>() / cameras.len() as f64).clamp(-80.0, 80.0);
    let camera = |i: u32| {
        let azimuth = 360.0 * f64::from(i) / f64::from(n);
        let eye = focus.center + distance * compass.direction(azimuth, elevation);
        first.looking_at(format!("orbit_{i:03}"), eye, focus.center, compass.up())
    };
    Ok((0..n).map(camera).collect())
}
