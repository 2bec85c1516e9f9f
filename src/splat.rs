//! Point splatting: the cloud drawn into a camera as squares, with a mask of what it covers, and
//! the holes between filled from around.

mod fill;

pub use fill::fill_holes;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::camera::{Camera, Frame};
use crate::config::SplatConfig;
use crate::error::{Error, Result};
use crate::scene::PointCloud;

/// Points transformed at a time: their projections stay in the first-level cache.
const BLOCK: usize = 256;

/// The z-buffer's value where nothing was drawn.
const EMPTY: u64 = u64::MAX;

/// A splatted image with its mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplatImage {
    pub width: u32,
    pub height: u32,
    /// `height * width * 4` bytes, row 0 on top: sRGB as in the cloud and alpha 255 where a
    /// point was drawn; all 0 elsewhere.
    pub rgba: Vec<u8>,
}

impl SplatImage {
    /// Whether each pixel is covered, row by row.
    pub fn mask(&self) -> impl Iterator<Item = bool> + '_ {
        self.rgba.chunks_exact(4).map(|p| p[3] != 0)
    }

    /// The share of covered pixels.
    pub fn coverage(&self) -> f64 {
        let n_pixels = self.rgba.len() / 4;
        self.mask().filter(|m| *m).count() as f64 / n_pixels.max(1) as f64
    }
}

/// Splats the cloud into every camera, in parallel over cameras.
///
/// A point covers a square of `config.size_px` pixels, aligned to the pixels and centred as
/// well as that allows. The nearest point wins a pixel; depths are compared rounded to f32, and
/// of equal ones the lower index wins. Then the connectivity filter empties covered pixels with
/// fewer than `config.filter_min_neighbors` other covered pixels in their window, all decided
/// on the unfiltered mask. Points nearer than `near * frame.radius` are not drawn.
///
/// Memory: 4 bytes a pixel for every camera, and 9 a pixel for every thread at work. The result
/// does not depend on the number of threads.
///
/// # Errors
/// A splat size of 0, an even filter window, an empty image, or more than 2^32 - 2 points.
pub fn splat_views(
    cloud: &PointCloud,
    frame: &Frame,
    cameras: &[Camera],
    config: &SplatConfig,
    near: f64,
) -> Result<Vec<SplatImage>> {
    if config.size_px == 0 {
        return Err(Error::usage("splat.size_px must be at least 1"));
    }
    if config.filter_window_px.is_multiple_of(2) {
        return Err(Error::usage(format!(
            "splat.filter_window_px is {}, but must be odd",
            config.filter_window_px
        )));
    }
    if u32::try_from(cloud.len()).is_err() || cloud.len() as u64 >= u64::from(u32::MAX) {
        return Err(Error::new(format!(
            "the cloud has {} points, more than can be splatted ({})",
            cloud.len(),
            u32::MAX - 1
        ))
        .way_out("thin the cloud"));
    }
    if let Some(camera) = cameras.iter().find(|c| c.width == 0 || c.height == 0) {
        return Err(Error::new("the image has no pixels").at(&camera.name));
    }
    let points = Points::new(cloud, frame);
    Ok(cameras
        .par_iter()
        .map_init(Scratch::default, |scratch, camera| {
            let camera = frame.camera_to_canonical(camera);
            points.draw(&camera, config.size_px, near, scratch);
            resolve(&camera, &cloud.colors, config, scratch)
        })
        .collect())
}

/// What a thread reuses from view to view.
#[derive(Default)]
struct Scratch {
    /// A pixel's nearest point: f32 depth bits above, index below, so that the smaller number
    /// is the nearer point or, at equal depth, the lower index.
    z_buffer: Vec<u64>,
    /// 1 where covered, before the filter.
    mask: Vec<u8>,
    /// Covered pixels of each column within the filter window's rows.
    columns: Vec<u32>,
}

/// Canonical positions, one array a coordinate so that the projection vectorises.
///
/// f64 throughout: a point falls into the pixel that exact arithmetic gives it, and the
/// scattered writes cost more than the arithmetic.
struct Points {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

impl Points {
    fn new(cloud: &PointCloud, frame: &Frame) -> Points {
        let canonical: Vec<DVec3> = cloud
            .positions
            .iter()
            .map(|p| frame.to_canonical(*p))
            .collect();
        Points {
            x: canonical.iter().map(|p| p.x).collect(),
            y: canonical.iter().map(|p| p.y).collect(),
            z: canonical.iter().map(|p| p.z).collect(),
        }
    }

    /// Draws all points into `scratch.z_buffer`.
    fn draw(&self, camera: &Camera, size_px: u32, near: f64, scratch: &mut Scratch) {
        let n_pixels = camera.width as usize * camera.height as usize;
        scratch.z_buffer.clear();
        scratch.z_buffer.resize(n_pixels, EMPTY);
        let z_buffer = scratch.z_buffer.as_mut_slice();
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
                    let row = &mut z_buffer[row * camera.width as usize..][columns.clone()];
                    for nearest in row {
                        *nearest = key.min(*nearest);
                    }
                }
            }
        }
    }
}

/// The part of `size` pixels from `first` on that lies in an image `limit` pixels wide.
fn span(first: i64, size: u32, limit: u32) -> std::ops::Range<usize> {
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

/// Colours the z-buffer and applies the connectivity filter.
fn resolve(
    camera: &Camera,
    colors: &[[u8; 3]],
    config: &SplatConfig,
    scratch: &mut Scratch,
) -> SplatImage {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let Scratch {
        z_buffer,
        mask,
        columns,
    } = scratch;
    mask.clear();
    mask.extend(z_buffer.iter().map(|key| u8::from(*key != EMPTY)));
    columns.clear();
    columns.resize(width, 0);
    let reach = (config.filter_window_px / 2) as usize;
    let mut rgba = vec![0; width * height * 4];
    // The first row's window reaches `reach` rows down.
    for row in mask.chunks_exact(width).take(reach) {
        columns
            .iter_mut()
            .zip(row)
            .for_each(|(c, m)| *c += u32::from(*m));
    }
    for y in 0..height {
        if let Some(row) = mask.chunks_exact(width).nth(y + reach) {
            columns
                .iter_mut()
                .zip(row)
                .for_each(|(c, m)| *c += u32::from(*m));
        }
        if y > reach {
            let row = &mask[(y - reach - 1) * width..][..width];
            columns
                .iter_mut()
                .zip(row)
                .for_each(|(c, m)| *c -= u32::from(*m));
        }
        let mut in_window: u32 = columns.iter().take(reach).sum();
        for x in 0..width {
            if let Some(column) = columns.get(x + reach) {
                in_window += column;
            }
            if x > reach {
                in_window -= columns[x - reach - 1];
            }
            let key = z_buffer[y * width + x];
            // The window counts the pixel itself.
            if key != EMPTY && in_window > config.filter_min_neighbors {
                let [r, g, b] = colors[(key & u64::from(u32::MAX)) as usize];
                rgba[(y * width + x) * 4..][..4].copy_from_slice(&[r, g, b, 255]);
            }
        }
    }
    SplatImage {
        width: camera.width,
        height: camera.height,
        rgba,
    }
}
