//! This module measures how much of what a view shows of the cloud the training cameras see, too.

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::{Camera, Frame};
use crate::cloud::splat::{self, Filter, Points, ZBuffer};
use crate::config::{Config, Footprint, SplatConfig, VisibilityConfig};
use crate::error::Result;
use crate::scene::{PointCloud, thin};

/// Longer side of the training views' depth maps, pixels: few enough that the points of a
/// DUSt3R-style cloud leave no gaps between them through which hidden points show.
const DEPTH_MAP_PX: u32 = 128;

/// A candidate's splat is the full one in miniature: the cloud thinned to so many points, and the
/// image shrunk alike, so that a pixel gets as many of them and as many gaps. A share is a mean
/// over pixels, for which some thousand will do.
const CANDIDATE_POINTS: usize = 8192;

/// The same for discs: more, since one answers for several pixels, so that pixels are fewer
/// independent samples of a share.
const CANDIDATE_DISCS: usize = 2 * CANDIDATE_POINTS;

/// Longer side of a candidate's splat at most, pixels.
const CANDIDATE_PX: u32 = 192;

/// The shares of a view's pixels that the cloud covers, and of these that training cameras see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Support {
    /// Share of the pixels that a point covers.
    pub coverage: f64,
    /// Share of the covered pixels whose point some training camera sees from within the greatest
    /// angle; 0 where none is covered.
    pub visible_share: f64,
}

/// A cloud with the training cameras that see each of its points.
///
/// Camera `i` with centre `o_i` sees the point `x` if `x` projects into its image and is not
/// hidden, `z_i(x) <= (1 + depth_tolerance) min z_i` over the points in the same pixel of the
/// camera's depth map. It does so from within the greatest angle of a view from `e` if
/// `angle(o_i - x, e - x) <= max_angle_deg`: the angle at the point, because that is what the
/// two see the surface under.
pub struct Visibility {
    frame: Frame,
    near: f64,
    points: Points,
    /// Centres of the training cameras.
    centers: Vec<DVec3>,
    /// Training cameras that see a point, one point's after the other's; `first[k]..first[k + 1]`
    /// are point `k`'s.
    seen_by: Vec<u32>,
    first: Vec<usize>,
    cos_max_angle: f64,
}

impl Visibility {
    /// Finds which training cameras see each point of `cloud`; `occluders`, often the same cloud,
    /// hide points. Nothing nearer than `near * frame.radius` is seen.
    ///
    /// # Errors
    /// More than 2^32 - 2 points, or a training image without pixels.
    pub fn new(
        cloud: &PointCloud,
        occluders: &PointCloud,
        frame: &Frame,
        train: &[Camera],
        config: &VisibilityConfig,
        near: f64,
    ) -> Result<Visibility> {
        splat::check_size(train)?;
        let occluders = Points::new(occluders, frame)?;
        let maps: Vec<DepthMap> = train
            .par_iter()
            .map(|camera| DepthMap::new(&occluders, &frame.camera_to_canonical(camera), near))
            .collect();
        // Two clouds at once would be the most that is held.
        drop(occluders);
        let mut points = Points::new(cloud, frame)?;
        // A list for each point of millions would take more room than all else.
        let runs: Vec<(Vec<u32>, Vec<u32>)> = (0..points.len().div_ceil(POINTS_A_RUN))
            .into_par_iter()
            .map(|run| {
                let run = run * POINTS_A_RUN..((run + 1) * POINTS_A_RUN).min(points.len());
                let (mut seen, mut ends) = (Vec::new(), Vec::with_capacity(run.len()));
                for p in run.map(|point| points.position(point)) {
                    let sees = |map: &DepthMap| map.sees(p, near, config.depth_tolerance);
                    seen.extend((0..).zip(&maps).filter(|(_, m)| sees(m)).map(|(i, _)| i));
                    ends.push(seen.len() as u32);
                }
                (seen, ends)
            })
            .collect();
        let mut seen_by: Vec<u32> =
            Vec::with_capacity(runs.iter().map(|(seen, _)| seen.len()).sum());
        let mut first = Vec::with_capacity(points.len() + 1);
        first.push(0);
        for (seen, ends) in runs {
            first.extend(ends.iter().map(|end| seen_by.len() + *end as usize));
            seen_by.extend(seen);
        }
        points.measure_discs(frame, train);
        Ok(Visibility {
            frame: *frame,
            near,
            points,
            centers: maps.iter().map(|map| map.camera.center()).collect(),
            seen_by,
            first,
            cos_max_angle: config.max_angle_deg.to_radians().cos(),
        })
    }

    /// Measures what each camera, world frame, shows of the cloud, splatted as `splat` says; in
    /// parallel.
    ///
    /// # Errors
    /// A largest radius of discs that is too small, an even filter window, or an empty image.
    pub fn measure(&self, cameras: &[Camera], splat: &SplatConfig) -> Result<Vec<Support>> {
        splat::check(cameras, splat)?;
        Ok(cameras
            .par_iter()
            .map_init(Default::default, |scratch, camera| {
                self.support(&self.frame.camera_to_canonical(camera), splat, scratch)
            })
            .collect())
    }

    fn support(
        &self,
        camera: &Camera,
        splat: &SplatConfig,
        (z_buffer, filter): &mut (ZBuffer, Filter),
    ) -> Support {
        self.points.draw(camera, splat, self.near, z_buffer);
        let eye = camera.center();
        let (mut covered, mut visible) = (0usize, 0usize);
        filter.kept(z_buffer, splat, |_, winner| {
            covered += 1;
            visible += usize::from(self.is_seen(winner.point, eye));
        });
        Support {
            coverage: covered as f64 / z_buffer.winners().len() as f64,
            visible_share: visible as f64 / covered.max(1) as f64,
        }
    }

    /// Returns whether some training camera sees the point of this index from within the greatest
    /// angle of `eye`, canonical.
    pub fn is_seen(&self, point: usize, eye: DVec3) -> bool {
        let x = self.points.position(point);
        let to_eye = eye - x;
        self.seen_by[self.first[point]..self.first[point + 1]]
            .iter()
            .any(|&i| {
                let to_camera = self.centers[i as usize] - x;
                let reach = to_eye.length() * to_camera.length();
                to_eye.dot(to_camera) >= self.cos_max_angle * reach
            })
    }
}

/// Returns the visible shares of `candidates`, estimated from splats in miniature.
///
/// # Errors
/// As [`Visibility::new`] and [`Visibility::measure`].
pub fn candidate_shares(
    candidates: &[Camera],
    cloud: &PointCloud,
    frame: &Frame,
    train: &[Camera],
    config: &Config,
) -> Result<Vec<f64>> {
    let n_points = match config.splat.footprint {
        Footprint::Pixel => CANDIDATE_POINTS,
        Footprint::Disc => CANDIDATE_DISCS,
    };
    let thinned = thin(cloud, n_points, config.seed);
    let near = frame.near(config.model.near);
    let visibility = &config.views.visibility;
    let visibility = Visibility::new(&thinned, cloud, frame, train, visibility, near)?;
    let scale = (thinned.len() as f64 / cloud.len().max(1) as f64).sqrt();
    let miniatures: Vec<Camera> = candidates
        .iter()
        .map(|camera| {
            let longer = f64::from(camera.width.max(camera.height)) * scale;
            camera.at_most((longer.round() as u32).clamp(1, CANDIDATE_PX))
        })
        .collect();
    let supports = visibility.measure(&miniatures, &config.splat)?;
    Ok(supports.iter().map(|s| s.visible_share).collect())
}

/// Points whose cameras are listed together.
const POINTS_A_RUN: usize = 1 << 14;

/// Returns the bytes a point that a [`Visibility`] takes at most with so many training cameras,
/// beside those of splatting it. The lists of a run lie beside that of all only while no other
/// cloud does.
pub fn bytes_a_point(n_cameras: usize) -> usize {
    splat::BYTES_A_POINT + size_of::<usize>() + n_cameras * size_of::<u32>()
}

/// Depths of the nearest points in a training view, at a low resolution.
struct DepthMap {
    camera: Camera,
    /// Row by row; infinite where there is no point.
    depths: Vec<f32>,
}

impl DepthMap {
    fn new(points: &Points, camera: &Camera, near: f64) -> DepthMap {
        let camera = camera.at_most(DEPTH_MAP_PX);
        let mut z_buffer = ZBuffer::default();
        points.draw_pixels(&camera, near, &mut z_buffer);
        let depths = z_buffer
            .winners()
            .map(|w| w.map_or(f32::INFINITY, |w| w.depth));
        DepthMap {
            depths: depths.collect(),
            camera,
        }
    }

    fn sees(&self, p: DVec3, near: f64, tolerance: f64) -> bool {
        let camera = &self.camera;
        let (pixel, depth) = camera.project(p);
        let [u, v] = pixel.floor().to_array();
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        // Written so that NaN fails; then u and v fit an index.
        if !(depth > near && u >= 0.0 && v >= 0.0 && u < width && v < height) {
            return false;
        }
        let nearest = self.depths[v as usize * camera.width as usize + u as usize];
        depth <= f64::from(nearest) * (1.0 + tolerance)
    }
}
