//! This module draws a cloud's points into one view.

use glam::{DMat3, DVec3};

use super::{Disc, Winner, ZBuffer};
use crate::camera::{Camera, Frame};
use crate::config::{Footprint, SplatConfig};
use crate::error::{Error, Result};
use crate::scene::PointCloud;

/// Points transformed at a time: their projections stay in the first-level cache.
const BLOCK: usize = 256;

/// A cloud to draw: canonical positions, one array a coordinate so that the projection vectorises.
///
/// f64 throughout: a point falls into the pixel that exact arithmetic gives it, and the
/// scattered writes cost more than the arithmetic.
#[derive(Clone)]
pub(crate) struct Points {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// Canonical radii of the points' discs; empty until [`Points::measure_discs`].
    radii: Vec<f64>,
}

/// Bytes that each point takes in [`Points`], with its disc.
pub(crate) const BYTES_A_POINT: usize = 4 * size_of::<f64>();

impl Points {
    /// Takes the cloud's points to the canonical `frame`.
    ///
    /// # Errors
    /// More than 2^32 - 2 points: a pixel keeps its point's index in 32 bits.
    pub(crate) fn new(cloud: &PointCloud, frame: &Frame) -> Result<Points> {
        if cloud.len() as u64 >= u64::from(u32::MAX) {
            return Err(Error::new(format!(
                "the cloud has {} points, more than can be splatted ({})",
                cloud.len(),
                u32::MAX - 1
            ))
            .way_out("thin the cloud"));
        }
        let mut points = Points {
            x: Vec::with_capacity(cloud.len()),
            y: Vec::with_capacity(cloud.len()),
            z: Vec::with_capacity(cloud.len()),
            radii: Vec::new(),
        };
        for p in &cloud.positions {
            let p = frame.to_canonical(*p);
            points.x.push(p.x);
            points.y.push(p.y);
            points.z.push(p.z);
        }
        Ok(points)
    }

    pub(crate) fn len(&self) -> usize {
        self.x.len()
    }

    /// Returns a point's canonical place.
    pub(crate) fn position(&self, point: usize) -> DVec3 {
        DVec3::new(self.x[point], self.y[point], self.z[point])
    }

    /// Gives every point's disc the radius of its source pixel: the pixel of the nearest of the
    /// `sources`, world frame, were the cloud made of one depth map a source with as many pixels in
    /// all as there are points, `r(x) = sqrt(n_pixels / n_points) min_i |x - o_i| / f_i`.
    ///
    /// The spacing of the points about `x` would say the same of a clean cloud; of a noisy one it
    /// says how far astray `x` is.
    pub(crate) fn measure_discs(&mut self, frame: &Frame, sources: &[Camera]) {
        let n_points = self.z.iter().filter(|z| !z.is_nan()).count();
        let n_pixels: f64 = sources
            .iter()
            .map(|c| f64::from(c.width) * f64::from(c.height))
            .sum();
        let stride = (n_pixels / n_points.max(1) as f64).sqrt();
        let eyes: Vec<(DVec3, f64)> = sources
            .iter()
            .map(|c| (frame.to_canonical(c.center()), stride / c.mean_focal()))
            .collect();
        let radius = |p: DVec3| {
            eyes.iter()
                .map(|(eye, per_length)| p.distance(*eye) * per_length)
                .fold(f64::INFINITY, f64::min)
        };
        let places = self.x.iter().zip(&self.y).zip(&self.z);
        self.radii = places
            .map(|((x, y), z)| radius(DVec3::new(*x, *y, *z)))
            .collect();
    }

    /// Draws all points into a canonical `camera`'s `z_buffer`, which is emptied first, as `config`
    /// says; nothing nearer than `near`.
    pub(crate) fn draw(
        &self,
        camera: &Camera,
        config: &SplatConfig,
        near: f64,
        z_buffer: &mut ZBuffer,
    ) {
        match config.footprint {
            Footprint::Pixel => self.draw_pixels(camera, near, z_buffer),
            Footprint::Disc => self.draw_discs(camera, config.max_radius_px, near, z_buffer),
        }
    }

    /// Draws all points into `z_buffer`, each in the one pixel that it falls into.
    pub(crate) fn draw_pixels(&self, camera: &Camera, near: f64, z_buffer: &mut ZBuffer) {
        z_buffer.clear(camera);
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        self.project(camera, near, |point, [u, v], depth| {
            // Written so that NaN fails; then the rounded values fit an index.
            if u >= 0.0 && v >= 0.0 && u < width && v < height {
                let pixel = v as usize * camera.width as usize + u as usize;
                let depth = depth as f32;
                z_buffer.put(pixel, Winner { point, depth });
            }
        });
    }

    fn draw_discs(&self, camera: &Camera, max_radius_px: f64, near: f64, z_buffer: &mut ZBuffer) {
        z_buffer.clear(camera);
        self.discs(camera, max_radius_px, near, |point, disc| {
            let depth = disc.depth;
            disc.pixels(camera, |pixel, _| {
                z_buffer.put(pixel, Winner { point, depth });
            });
        });
    }

    /// Visits the discs of all points before a canonical `camera`, in the cloud's order.
    pub(crate) fn discs(
        &self,
        camera: &Camera,
        max_radius_px: f64,
        near: f64,
        mut visit: impl FnMut(usize, Disc),
    ) {
        let focal = camera.mean_focal();
        self.project(camera, near, |point, center, depth| {
            // Without a source the disc is as large as allowed.
            let radius = self.radii.get(point).copied().unwrap_or(f64::INFINITY);
            let disc = Disc::new(center, depth, radius * focal / depth, max_radius_px);
            visit(point, disc);
        });
    }

    /// Visits the pixel position and the depth of every point farther than `near` before a
    /// canonical `camera`, in the cloud's order.
    fn project(&self, camera: &Camera, near: f64, mut visit: impl FnMut(usize, [f64; 2], f64)) {
        let projection = Projection::new(camera);
        let (mut u, mut v, mut depth) = ([0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
        for start in (0..self.x.len()).step_by(BLOCK) {
            let end = (start + BLOCK).min(self.x.len());
            let block = Block {
                x: &self.x[start..end],
                y: &self.y[start..end],
                z: &self.z[start..end],
            };
            projection.project(&block, &mut u, &mut v, &mut depth);
            for (i, ((u, v), z)) in u.iter().zip(&v).zip(&depth).take(end - start).enumerate() {
                // Written so that NaN fails.
                if *z > near && *z <= f64::from(f32::MAX) {
                    visit(start + i, [*u, *v], *z);
                }
            }
        }
    }
}

/// A run of points.
struct Block<'a> {
    x: &'a [f64],
    y: &'a [f64],
    z: &'a [f64],
}

/// World to pixels: the rows of the rotation with the translation, and the intrinsics.
struct Projection {
    rotation: DMat3,
    translation: DVec3,
    focal: [f64; 2],
    principal: [f64; 2],
}

impl Projection {
    fn new(camera: &Camera) -> Projection {
        Projection {
            rotation: camera.rotation,
            translation: camera.translation,
            focal: [camera.fx, camera.fy],
            principal: [camera.cx, camera.cy],
        }
    }

    /// Computes pixel positions and depths of up to `BLOCK` points.
    fn project(
        &self,
        points: &Block,
        u: &mut [f64; BLOCK],
        v: &mut [f64; BLOCK],
        depth: &mut [f64; BLOCK],
    ) {
        let [a, b, c] = [0, 1, 2].map(|i| self.rotation.row(i));
        let t = self.translation;
        let [cx, cy] = self.principal;
        let n = points.x.len().min(BLOCK);
        let (x, y, z) = (&points.x[..n], &points.y[..n], &points.z[..n]);
        let (u, v, depth) = (&mut u[..n], &mut v[..n], &mut depth[..n]);
        for i in 0..n {
            let (x, y, z) = (x[i], y[i], z[i]);
            let w = c.x * x + c.y * y + c.z * z + t.z;
            let inverse = 1.0 / w;
            u[i] = self.focal[0] * (a.x * x + a.y * y + a.z * z + t.x) * inverse + cx;
            v[i] = self.focal[1] * (b.x * x + b.y * y + b.z * z + t.y) * inverse + cy;
            depth[i] = w;
        }
    }
}
