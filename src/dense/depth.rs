//! This module holds depth maps with their cameras.

use glam::{DVec2, DVec3};

use crate::camera::{Camera, Similarity};

/// A view's depth with its confidence and colours, `[height][width]` at the camera's size.
#[derive(Clone, Debug)]
pub struct DepthMap {
    /// Pose and intrinsics, world frame.
    pub camera: Camera,
    /// Along the viewing direction; not above 0, or not finite, where there is none.
    pub depth: Vec<f32>,
    /// Larger is surer, on a scale that all views share.
    pub confidence: Vec<f32>,
    /// RGB, 8-bit sRGB.
    pub colors: Vec<[u8; 3]>,
}

impl DepthMap {
    /// Returns the depth at a pixel, `None` if there is none.
    pub fn at(&self, x: usize, y: usize) -> Option<f64> {
        let depth = f64::from(*self.depth.get(y * self.camera.width as usize + x)?);
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    }

    /// Returns the pixel that a place in the image lies in.
    pub fn pixel(&self, place: DVec2) -> Option<(usize, usize)> {
        let inside = place.x >= 0.0
            && place.y >= 0.0
            && place.x < f64::from(self.camera.width)
            && place.y < f64::from(self.camera.height);
        inside.then_some((place.x as usize, place.y as usize))
    }

    /// Returns the point of the world that a pixel's centre shows at a depth.
    pub fn point(&self, x: usize, y: usize, depth: f64) -> DVec3 {
        Self::point_of(&self.camera, x, y, depth)
    }

    /// Does what [`DepthMap::point`] does for another camera of the same pixels.
    pub(super) fn point_of(camera: &Camera, x: usize, y: usize, depth: f64) -> DVec3 {
        let ray = DVec3::new(
            (x as f64 + 0.5 - camera.cx) / camera.fx,
            (y as f64 + 0.5 - camera.cy) / camera.fy,
            1.0,
        );
        camera.rotation.transpose() * (ray * depth - camera.translation)
    }
}

/// Fewest points that tell a scale.
const MIN_POINTS: usize = 8;

/// Returns the factor that all depths must be multiplied by so that known points lie where the maps
/// have them: the median over all points in all views. `None` if too few are seen.
pub fn scale_to_points(maps: &[DepthMap], points: &[DVec3]) -> Option<f64> {
    let seen = maps
        .iter()
        .flat_map(|map| points.iter().map(move |point| (map, *point)));
    let ratio = |(map, point): (&DepthMap, DVec3)| {
        let (place, z) = map.camera.project(point);
        let (x, y) = if z > 0.0 {
            map.pixel(place)?
        } else {
            return None;
        };
        Some(z / map.at(x, y)?)
    };
    let mut ratios: Vec<f64> = seen.filter_map(ratio).filter(|r| r.is_finite()).collect();
    if ratios.len() < MIN_POINTS {
        return None;
    }
    let middle = ratios.len() / 2;
    Some(*ratios.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Returns the unit of the `known` cameras in that of the `found` ones, by their centres: the scale
/// of the similarity between both, or the ratio of their spreads where they lie on a line. 1 where
/// they tell nothing.
pub fn scale_of_cameras(known: &[Camera], found: &[Camera]) -> f64 {
    let centers =
        |cameras: &[Camera]| -> Vec<DVec3> { cameras.iter().map(Camera::center).collect() };
    let (known, found) = (centers(known), centers(found));
    if let Ok(similarity) = Similarity::between(&known, &found) {
        return similarity.scale;
    }
    let spread = |centers: &[DVec3]| {
        let mean = centers.iter().sum::<DVec3>() / centers.len().max(1) as f64;
        centers
            .iter()
            .map(|c| c.distance_squared(mean))
            .sum::<f64>()
            .sqrt()
    };
    let ratio = spread(&found) / spread(&known);
    if ratio.is_finite() && ratio > 0.0 {
        ratio
    } else {
        1.0
    }
}
