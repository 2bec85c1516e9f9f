//! This module reads point clouds by format, cleans and thins them.

use std::path::Path;

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::PointCloud;
use super::formats::{read_points_binary, read_points_text};
use super::ply::read_ply;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::files::read_file;

/// Points within this share of the cameras' extent of a camera centre count as at it.
const CENTER_TOLERANCE: f64 = 1e-6;

/// Reads the point cloud of a `.ply`, or COLMAP's points of a `.bin` or `.txt`, as stored:
/// positions may be NaN or infinite.
///
/// # Errors
///
/// Files that cannot be read or parsed, with the byte or line.
pub fn read_cloud(path: &Path) -> Result<PointCloud> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let read = match extension.to_ascii_lowercase().as_str() {
        "ply" => read_ply,
        "bin" => read_points_binary,
        "txt" => read_points_text,
        _ => {
            return Err(Error::new("not a point cloud")
                .at_path(path)
                .way_out("give a .ply, or COLMAP's points3D.bin or .txt"));
        }
    };
    read(&read_file(path)?).map_err(|e| e.at_path(path))
}

/// Drops points that are not finite (positions, as `f32` too, and confidence) and points at a
/// camera centre, whose Gaussians would be degenerate; each with a counted line in `warnings`.
/// The order of the rest is kept.
pub(super) fn clean(cloud: &mut PointCloud, cameras: &[Camera], warnings: &mut Vec<String>) {
    let n = cloud.len();
    let confidence = cloud.confidence.as_deref();
    let finite: Vec<bool> = (0..n)
        .map(|i| {
            cloud.positions[i].as_vec3().is_finite() && confidence.is_none_or(|c| c[i].is_finite())
        })
        .collect();
    cloud.retain(&finite);
    let n_finite = cloud.len();
    if n_finite < n {
        warnings.push(format!(
            "{} of {n} points are not finite: dropped",
            n - n_finite
        ));
    }

    let mut centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
    centers.sort_by(|a, b| a.x.total_cmp(&b.x));
    let tolerance = CENTER_TOLERANCE * camera_extent(&centers, &cloud.positions);
    let kept: Vec<bool> = cloud
        .positions
        .iter()
        .map(|p| {
            let first = centers.partition_point(|c| c.x < p.x - tolerance);
            !centers[first..]
                .iter()
                .take_while(|c| c.x <= p.x + tolerance)
                .any(|c| c.distance(*p) <= tolerance)
        })
        .collect();
    cloud.retain(&kept);
    if cloud.len() < n_finite {
        warnings.push(format!(
            "{} of {n_finite} points lie at a camera centre: dropped",
            n_finite - cloud.len()
        ));
    }
}

/// Returns the median distance of the camera centres from the middle of them, or of the points from
/// there where most cameras coincide: a camera far away, used or not, changes neither.
fn camera_extent(centers: &[DVec3], points: &[DVec3]) -> f64 {
    let axis = |i: usize| median(centers.iter().map(|c| c[i]).collect());
    let middle = DVec3::new(axis(0), axis(1), axis(2));
    let spread = |places: &[DVec3]| median(places.iter().map(|p| p.distance(middle)).collect());
    match spread(centers) {
        extent if extent > 0.0 => extent,
        _ => spread(points),
    }
}

/// Returns the upper middle of the values; 0 without one.
fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Returns at most `n` points of `cloud`, in its order: one drawn at random from each of `n` equal
/// stretches of the index range, so that a cloud in pixel order is thinned evenly over the images.
/// The same on every platform for the same `seed`.
pub fn thin(cloud: &PointCloud, n: usize, seed: u64) -> PointCloud {
    if n >= cloud.len() {
        return cloud.clone();
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // Other random choices of a run share the seed; the stream keeps this one apart.
    rng.set_stream(u64::from_be_bytes(*b"thin    "));
    let bound = |stretch: usize| (stretch as u128 * cloud.len() as u128 / n as u128) as u64;
    let chosen: Vec<usize> = (0..n)
        .map(|stretch| {
            let (start, end) = (bound(stretch), bound(stretch + 1));
            let offset = (u128::from(rng.next_u64()) * u128::from(end - start)) >> 64;
            start as usize + offset as usize
        })
        .collect();
    PointCloud {
        positions: chosen.iter().map(|&i| cloud.positions[i]).collect(),
        colors: chosen.iter().map(|&i| cloud.colors[i]).collect(),
        confidence: cloud
            .confidence
            .as_ref()
            .map(|confidence| chosen.iter().map(|&i| confidence[i]).collect()),
    }
}

/// Share of the points that a random cloud's box leaves out at either end of an axis: flying
/// points would blow it up.
const OUTLIERS: f64 = 0.01;

/// Makes as many points as `cloud` has, uniform in the box that holds the middle 98 % of its points
/// along each axis, of uniform colours and without confidence: what 3DGS starts from where there is
/// no cloud. The same on every platform for the same `seed`.
pub fn random_like(cloud: &PointCloud, seed: u64) -> PointCloud {
    let Some(last) = cloud.len().checked_sub(1) else {
        return PointCloud::default();
    };
    let quantiles = [OUTLIERS, 1.0 - OUTLIERS].map(|q| (q * last as f64).round() as usize);
    let mut bounds = [DVec3::ZERO; 2];
    for axis in 0..3 {
        let mut values: Vec<f64> = cloud.positions.iter().map(|p| p[axis]).collect();
        for (bound, i) in bounds.iter_mut().zip(quantiles) {
            bound[axis] = *values.select_nth_unstable_by(i, f64::total_cmp).1;
        }
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(u64::from_be_bytes(*b"random  "));
    let [low, high] = bounds;
    let mut unit = || (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let mut random = PointCloud::default();
    for _ in 0..cloud.len() {
        let place = DVec3::new(unit(), unit(), unit());
        random.positions.push(low + place * (high - low));
        random
            .colors
            .push([unit(), unit(), unit()].map(|v| (256.0 * v) as u8));
    }
    random
}
