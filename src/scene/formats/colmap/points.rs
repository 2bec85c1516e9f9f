//! This module reads `points3D.bin` and `points3D.txt`: COLMAP's sparse points, without confidence.

use super::text::{at_line, lines, number, numbers};
use crate::error::Result;
use crate::files::bytes::Reader;
use crate::scene::PointCloud;
use glam::DVec3;

/// id, position, colour, error and track length of a point.
const POINT_BYTES: usize = 8 + 3 * 8 + 3 + 8 + 8;
/// Image id and index of an observation.
const TRACK_BYTES: usize = 4 + 4;

pub(crate) fn read_points_binary(bytes: &[u8]) -> Result<PointCloud> {
    let mut reader = Reader::new(bytes);
    let n = reader.count(POINT_BYTES, "points")?;
    let mut cloud = PointCloud::default();
    cloud.positions.reserve_exact(n);
    cloud.colors.reserve_exact(n);
    for _ in 0..n {
        reader.u64("a point's id")?;
        let position: [f64; 3] = reader.f64s("a point's position")?;
        cloud.positions.push(DVec3::from(position));
        cloud.colors.push(reader.rgb("a point's colour")?);
        reader.f64("a point's error")?;
        reader.skip_list(TRACK_BYTES, "observations of a point")?;
    }
    Ok(cloud)
}

pub(crate) fn read_points_text(bytes: &[u8]) -> Result<PointCloud> {
    let mut cloud = PointCloud::default();
    for line in lines(bytes) {
        let (at, line) = line?;
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let (position, color) = read_point(line).map_err(|e| at_line(e, at))?;
        cloud.positions.push(position);
        cloud.colors.push(color);
    }
    Ok(cloud)
}

fn read_point(mut line: &str) -> Result<(DVec3, [u8; 3])> {
    let _id: u64 = number(&mut line, "the point's id")?;
    let position: [f64; 3] = numbers(&mut line, "the point's position")?;
    let mut color = [0; 3];
    for channel in &mut color {
        *channel = number(&mut line, "the point's colour")?;
    }
    Ok((DVec3::from(position), color))
}
