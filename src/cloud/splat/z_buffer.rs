//! Points into the z-buffer of one view.

use std::ops::Range;

use glam::{DMat3, DVec3};

use crate::camera::{Camera, Frame};
use crate::error::{Error, Result};
use crate::scene::PointCloud;

/// Points transformed at a time: their projections stay in the first-level cache.
const BLOCK: usize = 256;

/// A pixel's key where nothing was drawn.
const EMPTY: u64 = u64::MAX;

/// The nearest point of every pixel, row by row.
#[derive(Default)]
pub(crate) struct ZBuffer {
    /// Pixels.
    width: usize,
    /// f32 depth bits above, index below, so that the smaller number is the nearer point or, at
    /// equal depth, the lower index.
    keys: Vec<u64>,
}

/// A point in a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Winner {
    /// Index in the cloud.
    pub point: usize,
    /// Along the optical axis, canonical.
    pub depth: f32,
}

impl ZBuffer {
    fn clear(&mut self, camera: &Camera) {
        self.width = camera.width as usize;
        self.keys.clear();
        self.keys.resize(self.width * camera.height as usize, EMPTY);
    }

    /// Pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The nearest point of every pixel, row by row.
    pub fn winners(&self) -> impl ExactSizeIterator<Item = Option<Winner>> + '_ {
        self.keys.iter().map(|key| winner(*key))
    }

    /// The nearest point of a pixel.
    pub fn winner(&self, pixel: usize) -> Option<Winner> {
        winner(self.keys[pixel])
    }
}

fn winner(key: u64) -> Option<Winner> {
    (key != EMPTY).then(|| Winner {
        point: (key & u64::from(u32::MAX)) as usize,
        depth: f32::from_bits((key >> 32) as u32),
    })
}

/// A cloud to draw: canonical positions, one array a coordinate so that the projection vectorises.
///
/// f64 throughout: a point falls into the pixel that exact arithmetic gives it, and the
/// scattered writes cost more than the arithmetic.
pub(crate) struct Points {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

impl Points {
    /// # Errors
    /// More than 2^32 - 2 points: a pixel keeps its point's index in 32 bits.
    pub fn new(cloud: &PointCloud, frame: &Frame) -> Result<Points> {
        if cloud.len() as u64 >= u64::from(u32::MAX) {
            return Err(Error::new(format!(
                "the cloud has {} points, more than can be splatted ({})",
                cloud.len(),
                u32::MAX - 1
            ))
            .way_out("thin the cloud"));
        }
        let canonical: Vec<DVec3> = cloud
            .positions
            .iter()
            .map(|p| frame.to_canonical(*p))
            .collect();
        Ok(Points {
            x: canonical.iter().map(|p| p.x).collect(),
            y: canonical.iter().map(|p| p.y).collect(),
            z: canonical.iter().map(|p| p.z).collect(),
        })
    }

    /// Draws no point from now on that `hidden`, one entry a point, says true of.
    pub fn hide(&mut self, hidden: impl Iterator<Item = bool>) {
        for (z, hidden) in self.z.iter_mut().zip(hidden) {
            if hidden {
                // Nothing that is NaN is drawn.
                *z = f64::NAN;
            }
        }
    }

    /// Draws all points into a canonical `camera`'s `z_buffer`, which is emptied first: squares
    /// of `size_px` pixels, and nothing nearer than `near`.
    pub fn draw(&self, camera: &Camera, size_px: u32, near: f64, z_buffer: &mut ZBuffer) {
        z_buffer.clear(camera);
        let keys = z_buffer.keys.as_mut_slice();
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let size = f64::from(size_px);
        // The square's first column is floor(u - reach): pixel centres lie at +0.5.
        let reach = 0.5 * (size - 1.0);
        let projection = Projection::new(camera);
        let (mut u, mut v, mut depth) = ([0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
        for start in (0..self.x.len()).step_by(BLOCK) {
            let end = (start + BLOCK).min(self.x.len());
            let block = Block {
                x: &self.x[start..end],
                y: &self.y[start..end],
                z: &self.z[start..end],
            };
            projection.project(&block, reach, &mut u, &mut v, &mut depth);
            for (i, ((u, v), z)) in u.iter().zip(&v).zip(&depth).take(end - start).enumerate() {
                // Written so that NaN fails; then the rounded values fit an integer.
                let seen = *z > near
                    && *z <= f64::from(f32::MAX)
                    && *u > -size
                    && *v > -size
                    && *u < width
                    && *v < height;
                if !seen {
                    continue;
                }
                let key = u64::from((*z as f32).to_bits()) << 32 | (start + i) as u64;
                let (left, top) = (u.floor() as i64, v.floor() as i64);
                let columns = span(left, size_px, camera.width);
                for row in span(top, size_px, camera.height) {
                    let row = &mut keys[row * camera.width as usize..][columns.clone()];
                    for nearest in row {
                        *nearest = key.min(*nearest);
                    }
                }
            }
        }
    }
}

/// The part of `size` pixels from `first` on that lies in an image `limit` pixels wide.
fn span(first: i64, size: u32, limit: u32) -> Range<usize> {
    let end = (first + i64::from(size)).clamp(0, i64::from(limit));
    first.clamp(0, end) as usize..end as usize
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

    /// Pixel positions less `reach`, and depths, of up to `BLOCK` points.
    fn project(
        &self,
        points: &Block,
        reach: f64,
        u: &mut [f64; BLOCK],
        v: &mut [f64; BLOCK],
        depth: &mut [f64; BLOCK],
    ) {
        let [a, b, c] = [0, 1, 2].map(|i| self.rotation.row(i));
        let t = self.translation;
        let (cx, cy) = (self.principal[0] - reach, self.principal[1] - reach);
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
