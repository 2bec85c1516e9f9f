//! The point cloud has the exact depth of the training views, worsened in the ways of DUSt3R's.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::noise::{lerp, random, smoothstep, value_noise};
use super::trace::{Hit, Traced, unproject};
use crate::camera::Camera;
use crate::scene::{Image, PointCloud};

/// What is wrong with the cloud. Each field stands alone: its random choices are its own, so
/// switching one off leaves what the others do to each point as it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Imperfections {
    /// Greatest relative depth error of a view: depths are multiplied by 1 plus a smooth random
    /// field over the image (cosines up to one and a half periods) of this peak.
    pub depth_bias: f64,
    /// Share of the pixels at depth edges that fly, to a random depth between the edge's sides.
    pub flying_pixels: f64,
    /// Share of points whose depth is grossly wrong, by a factor of 0.5 to 0.85 or 1.2 to 2.
    pub outliers: f64,
    /// Share of each view's pixels, the backdrop's aside, that lie in holes: patches without
    /// points, for the most part where there is little texture or a grazing view.
    pub holes: f64,
    /// Share of the backdrop's pixels without a point.
    pub backdrop_loss: f64,
    /// Gives points a confidence of 1 to 20, low at depth edges, for flying pixels and outliers,
    /// at grazing angles and far away. Without it the cloud has none.
    pub confidence: bool,
}

impl Imperfections {
    /// Every point exact, one for each pixel asked for, no confidence.
    pub const NONE: Self = Self {
        depth_bias: 0.0,
        flying_pixels: 0.0,
        outliers: 0.0,
        holes: 0.0,
        backdrop_loss: 0.0,
        confidence: false,
    };
}

impl Default for Imperfections {
    fn default() -> Self {
        Self {
            depth_bias: 0.02,
            flying_pixels: 0.3,
            outliers: 0.005,
            holes: 0.08,
            backdrop_loss: 0.9,
            confidence: true,
        }
    }
}

/// The purpose of a random number, which keeps the choices of one imperfection from those of
/// another.
#[derive(Clone, Copy)]
enum Purpose {
    Bias,
    Fly,
    FlyTo,
    Outlier,
    OutlierTo,
    Hole,
    Backdrop,
    Confidence,
}

/// Random numbers of one view.
#[derive(Clone, Copy)]
struct Dice {
    seed: u64,
    view: usize,
}

impl Dice {
    /// Draws a number in `[0, 1)`, the same for the same arguments.
    fn roll(self, purpose: Purpose, index: usize) -> f64 {
        let stream = (self.view as i64) << 8 | purpose as i64;
        random([self.seed as i64, stream, index as i64])
    }
}

/// Makes the cloud of these views: one point for every `pixel_step`-th pixel in x and y (0 counts
/// as 1), view by view and row by row, coloured by the view's image.
pub fn point_cloud(
    cameras: &[Camera],
    traced: &[Traced],
    pixel_step: u32,
    seed: u64,
    imperfections: &Imperfections,
) -> PointCloud {
    let step = pixel_step.max(1) as usize;
    let mut cloud = PointCloud::default();
    let mut confidence = Vec::new();
    for (view, (camera, traced)) in cameras.iter().zip(traced).enumerate() {
        let dice = Dice { seed, view };
        let holes = holes(camera, traced, imperfections.holes, dice);
        let bias = DepthBias::new(imperfections.depth_bias, dice);
        let (width, height) = (camera.width as usize, camera.height as usize);
        for y in (0..height).step_by(step) {
            for x in (0..width).step_by(step) {
                let i = y * width + x;
                let is_backdrop = traced.hit[i] == Hit::Backdrop;
                if holes[i]
                    || is_backdrop && dice.roll(Purpose::Backdrop, i) < imperfections.backdrop_loss
                {
                    continue;
                }
                let (u, v) = (x as f64 + 0.5, y as f64 + 0.5);
                let mut depth = traced.depth[i];
                let across = across_edge(traced, width, x, y);
                let mut is_astray = false;
                if let Some(other) = across
                    && dice.roll(Purpose::Fly, i) < imperfections.flying_pixels
                {
                    depth = lerp(depth, other, dice.roll(Purpose::FlyTo, i));
                    is_astray = true;
                }
                if dice.roll(Purpose::Outlier, i) < imperfections.outliers {
                    depth *= match 2.0 * dice.roll(Purpose::OutlierTo, i) {
                        near if near < 1.0 => lerp(0.5, 0.85, near),
                        far => lerp(1.2, 2.0, far - 1.0),
                    };
                    is_astray = true;
                }
                depth *= bias.factor(u / width as f64, v / height as f64);
                cloud.positions.push(unproject(camera, u, v, depth));
                let rgb = &traced.image.rgb[3 * i..3 * i + 3];
                cloud.colors.push([rgb[0], rgb[1], rgb[2]]);
                if imperfections.confidence {
                    let mut trust = trust(camera, traced, i, unproject(camera, u, v, 1.0));
                    if across.is_some() {
                        trust *= 0.3;
                    }
                    if is_astray {
                        trust *= 0.2;
                    }
                    trust *= lerp(0.8, 1.0, dice.roll(Purpose::Confidence, i));
                    confidence.push((1.0 + 19.0 * trust) as f32);
                }
            }
        }
    }
    cloud.confidence = imperfections.confidence.then_some(confidence);
    cloud
}

/// Returns whether depth jumps between a pixel and one of its four neighbours: another surface, and
/// a depth that differs by more than 2%.
pub fn is_depth_edge(traced: &Traced, x: u32, y: u32) -> bool {
    let width = traced.image.width as usize;
    across_edge(traced, width, x as usize, y as usize).is_some()
}

/// Returns the depth on the other side of the widest depth edge at a pixel.
fn across_edge(traced: &Traced, width: usize, x: usize, y: usize) -> Option<f64> {
    const MIN_JUMP: f64 = 0.02;
    let i = y * width + x;
    let depth = traced.depth[i];
    let neighbors = [
        (x > 0).then(|| i - 1),
        (x + 1 < width).then_some(i + 1),
        (y > 0).then(|| i - width),
        (i + width < traced.depth.len()).then_some(i + width),
    ];
    let mut widest = None;
    let mut widest_jump = MIN_JUMP;
    for j in neighbors.into_iter().flatten() {
        let jump = (traced.depth[j] - depth).abs() / depth.min(traced.depth[j]);
        if traced.hit[j] != traced.hit[i] && jump > widest_jump {
            widest_jump = jump;
            widest = Some(traced.depth[j]);
        }
    }
    widest
}

/// Returns how well a stereo network would know this pixel, in `[0, 1]`: less at grazing angles and
/// far away, next to nothing on the backdrop.
fn trust(camera: &Camera, traced: &Traced, i: usize, at_unit_depth: DVec3) -> f64 {
    let ray = (at_unit_depth - camera.center()).normalize();
    let facing = smoothstep(0.02, 0.5, -traced.normal[i].dot(ray));
    let near = 1.0 - smoothstep(3.5, 9.0, traced.depth[i]);
    match traced.hit[i] {
        Hit::Backdrop => 0.02,
        Hit::Floor | Hit::Object(_) => lerp(0.08, 1.0, facing) * lerp(0.08, 1.0, near),
    }
}

/// A smooth random field over one image.
struct DepthBias {
    /// Coefficients of `cos(i pi u) cos(j pi v)`.
    coefficients: [[f64; Self::ORDERS]; Self::ORDERS],
}

impl DepthBias {
    const ORDERS: usize = 4;

    fn new(peak: f64, dice: Dice) -> Self {
        let mut coefficients = [[0.0; Self::ORDERS]; Self::ORDERS];
        for (k, c) in coefficients.as_flattened_mut().iter_mut().enumerate() {
            *c = 2.0 * dice.roll(Purpose::Bias, k) - 1.0;
        }
        let field = Self { coefficients };
        const GRID: u32 = 64;
        let at = |k: u32| f64::from(k) / f64::from(GRID);
        let largest = (0..=GRID)
            .flat_map(|y| (0..=GRID).map(move |x| (x, y)))
            .map(|(x, y)| (field.factor(at(x), at(y)) - 1.0).abs())
            .fold(0.0, f64::max);
        Self {
            coefficients: field
                .coefficients
                .map(|row| row.map(|c| c * peak / largest)),
        }
    }

    /// Returns the factor of the depth at `(u, v)` in the unit square.
    fn factor(&self, u: f64, v: f64) -> f64 {
        let mut factor = 1.0;
        for (j, row) in self.coefficients.iter().enumerate() {
            for (i, c) in row.iter().enumerate() {
                factor += c * (i as f64 * PI * u).cos() * (j as f64 * PI * v).cos();
            }
        }
        factor
    }
}

/// Returns which pixels lie in holes: the `share` of the pixels off the backdrop that rank highest
/// in a smooth random field, raised where the image is plain and where the view is grazing.
fn holes(camera: &Camera, traced: &Traced, share: f64, dice: Dice) -> Vec<bool> {
    let width = camera.width as usize;
    let contrast = Contrast::new(&traced.image);
    let shift = 1000.0 * dice.roll(Purpose::Hole, 0);
    let score = |i: usize| {
        let p = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let patch = value_noise((p * (14.0 / width as f64)).extend(shift));
        let plain = 1.0 - smoothstep(0.0, 24.0, contrast.at(p));
        let ray = unproject(camera, p.x, p.y, 1.0) - camera.center();
        let grazing = 1.0 - smoothstep(0.1, 0.5, -traced.normal[i].dot(ray.normalize()));
        patch + 0.4 * plain + 0.4 * grazing
    };
    let mut ranked: Vec<(f64, usize)> = (0..traced.hit.len())
        .filter(|&i| traced.hit[i] != Hit::Backdrop)
        .map(|i| (score(i), i))
        .collect();
    ranked.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut is_hole = vec![false; traced.hit.len()];
    let n_holes = (share * ranked.len() as f64).round() as usize;
    for &(_, i) in ranked.iter().take(n_holes) {
        is_hole[i] = true;
    }
    is_hole
}

/// Standard deviation of brightness in blocks of an image, interpolated between their centres.
struct Contrast {
    block: f64,
    columns: usize,
    deviation: Vec<f64>,
}

impl Contrast {
    fn new(image: &Image) -> Self {
        let (width, height) = (image.width as usize, image.height as usize);
        let block = width.div_ceil(40).max(2);
        let (columns, rows) = (width.div_ceil(block), height.div_ceil(block));
        let brightness = |x: usize, y: usize| {
            let i = 3 * (y * width + x);
            image.rgb[i..i + 3]
                .iter()
                .map(|&c| f64::from(c))
                .sum::<f64>()
                / 3.0
        };
        let deviation = (0..rows * columns)
            .map(|k| {
                let (x0, y0) = (k % columns * block, k / columns * block);
                let (mut n, mut sum, mut sum2) = (0.0, 0.0, 0.0);
                for y in y0..(y0 + block).min(height) {
                    for x in x0..(x0 + block).min(width) {
                        let b = brightness(x, y);
                        n += 1.0;
                        sum += b;
                        sum2 += b * b;
                    }
                }
                (sum2 / n - (sum / n).powi(2)).max(0.0).sqrt()
            })
            .collect();
        Self {
            block: block as f64,
            columns,
            deviation,
        }
    }

    /// Returns the contrast at a point of the image, pixels.
    fn at(&self, p: DVec2) -> f64 {
        let rows = self.deviation.len() / self.columns;
        let last = DVec2::new(self.columns as f64 - 1.0, rows as f64 - 1.0);
        let q = (p / self.block - DVec2::splat(0.5)).clamp(DVec2::ZERO, last);
        let (x, y) = (q.x as usize, q.y as usize);
        let (x1, y1) = ((x + 1).min(self.columns - 1), (y + 1).min(rows - 1));
        let value = |x: usize, y: usize| self.deviation[y * self.columns + x];
        lerp(
            lerp(value(x, y), value(x1, y), q.x.fract()),
            lerp(value(x, y1), value(x1, y1), q.x.fract()),
            q.y.fract(),
        )
    }
}
