//! Carving removes points that the photographs contradict.
//!
//! A training photograph shows, in every pixel, the nearest surface of the scene. So a point of
//! the cloud that a training view has in front must look like the photograph there, or it does
//! not belong where it is: it hides what the photograph shows. That is judged of the nearest
//! point `x` of every pixel of training view `i`, with colour `q`, against the photograph's
//! range in the window `W` around the pixel:
//!
//! `excess_i(x) = max_channel max(min_W I_i - q, q - max_W I_i, 0)`, and `x` goes if
//! `excess_i(x) > threshold` in some view `i`, unless it is seen through a gap there: unless some
//! point within `g` pixels lies nearer than `(1 - depth_tolerance) z_i(x)`.
//!
//! - A point's colour comes from one of the photographs, which agrees with it wherever the point
//!   lies on its ray. The other views accuse a point; that its own does not is no excuse.
//! - Where the cloud is sparser than the pixels, points behind a surface show through its gaps,
//!   but not in the photograph. `g` is the smallest reach whose window holds 3 points on
//!   average, `(2 g + 1)^2 >= 3 n_pixels / n_points`: of points strewn at random 1 window in 20
//!   would hold none. In a dense cloud it is 0, and every nearest point is judged.
//! - A pixel that a mask has training ignore accuses nobody.
//! - What a carved point hid is judged in the next round, until a round finds nothing.

use rayon::prelude::*;

use crate::camera::{Camera, Frame};
use crate::cloud::splat::{Points, Winner, ZBuffer};
use crate::config::CarveConfig;
use crate::error::Result;
use crate::scene::{Image, PointCloud, View};

/// A carved cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Carved {
    /// The points that are left.
    pub cloud: PointCloud,
    /// Points removed in each round.
    pub removed: Vec<usize>,
    /// Why carving stopped early.
    pub warning: Option<String>,
}

/// Carves `cloud` by the training `views`. Nothing nearer to a camera than `near * frame.radius`
/// is seen. A round that would bring the removed points above `config.max_share` of the cloud is
/// not carried out: then cloud and photographs do not belong together.
///
/// # Errors
/// More than 2^32 - 2 points.
pub fn carve(
    cloud: &PointCloud,
    frame: &Frame,
    views: &[View],
    config: &CarveConfig,
    near: f64,
) -> Result<Carved> {
    let n_pixels: usize = views.iter().map(|v| v.image.rgb.len() / 3).sum();
    let gap = gap(n_pixels, cloud.len());
    let witnesses: Vec<Witness> = views
        .par_iter()
        .map(|view| Witness::new(view, frame, config, gap))
        .collect();
    let most = (config.max_share * cloud.len() as f64) as usize;
    let mut carved = Carved {
        cloud: cloud.clone(),
        removed: Vec::new(),
        warning: None,
    };
    for _ in 0..config.max_rounds {
        let points = Points::new(&carved.cloud, frame)?;
        let accused: Vec<Vec<usize>> = witnesses
            .par_iter()
            .map_init(ZBuffer::default, |z_buffer, witness| {
                points.draw_pixels(&witness.camera, near, z_buffer);
                witness.accused(z_buffer, &carved.cloud.colors, config)
            })
            .collect();
        let mut kept = vec![true; carved.cloud.len()];
        accused
            .iter()
            .flatten()
            .for_each(|&point| kept[point] = false);
        let n = kept.iter().filter(|kept| !**kept).count();
        if n == 0 {
            break;
        }
        let n_before: usize = carved.removed.iter().sum();
        if n_before + n > most {
            carved.warning = Some(format!(
                "carving stopped after {} rounds: the next would bring the removed points from {n_before} to {} of {}, \
                 more than carve.max_share, {}; do the cloud and the photographs belong together?",
                carved.removed.len(),
                n_before + n,
                cloud.len(),
                config.max_share
            ));
            break;
        }
        carved.cloud.retain(&kept);
        carved.removed.push(n);
    }
    Ok(carved)
}

/// Returns the reach in pixels within which a surface of the cloud shows some point.
fn gap(n_pixels: usize, n_points: usize) -> usize {
    let side = (3.0 * n_pixels as f64 / n_points.max(1) as f64).sqrt();
    (0.5 * (side - 1.0)).ceil().max(0.0) as usize
}

/// A training view that judges points.
struct Witness<'a> {
    view: &'a View,
    /// Canonical.
    camera: Camera,
    /// Least and greatest value of each channel in every pixel's window.
    ranges: Vec<[[u8; 3]; 2]>,
    /// Pixels to each side within which a surface shows some point.
    gap: usize,
}

impl<'a> Witness<'a> {
    fn new(view: &'a View, frame: &Frame, config: &CarveConfig, gap: usize) -> Witness<'a> {
        let reach = (config.window_px / 2) as usize;
        Witness {
            view,
            camera: frame.camera_to_canonical(&view.camera),
            ranges: window_ranges(&view.image, reach),
            gap,
        }
    }

    /// Returns the points in `z_buffer`, drawn from this view, that its photograph contradicts.
    fn accused(&self, z_buffer: &ZBuffer, colors: &[[u8; 3]], config: &CarveConfig) -> Vec<usize> {
        z_buffer
            .winners()
            .enumerate()
            .filter_map(|(pixel, winner)| Some((pixel, winner?)))
            .filter(|(pixel, winner)| {
                self.view.counts(*pixel)
                    && excess(colors[winner.point], self.ranges[*pixel]) > 255.0 * config.threshold
                    && !self.is_behind(z_buffer, *pixel, *winner, config.depth_tolerance)
            })
            .map(|(_, winner)| winner.point)
            .collect()
    }

    /// Returns whether a clearly nearer point is so close by that the winner shows through a gap.
    fn is_behind(&self, z_buffer: &ZBuffer, pixel: usize, winner: Winner, tolerance: f64) -> bool {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let front = f64::from(winner.depth) * (1.0 - tolerance);
        window(pixel / width, self.gap, height)
            .flat_map(|y| window(pixel % width, self.gap, width).map(move |x| y * width + x))
            .filter_map(|neighbor| z_buffer.winner(neighbor))
            .any(|neighbor| f64::from(neighbor.depth) < front)
    }
}

/// Returns how far a colour lies outside a range, in the channel where it lies outside most; 0 to
/// 255.
fn excess(color: [u8; 3], [low, high]: [[u8; 3]; 2]) -> f64 {
    let [r, g, b] = [0, 1, 2].map(|c| {
        let below = low[c].saturating_sub(color[c]);
        below.max(color[c].saturating_sub(high[c]))
    });
    f64::from(r.max(g).max(b))
}

/// Returns the pixels within `reach` of `at` in a row or column of `length`.
fn window(at: usize, reach: usize, length: usize) -> std::ops::RangeInclusive<usize> {
    at.saturating_sub(reach)..=(at + reach).min(length - 1)
}

/// Returns the least and greatest value of each channel in the window around every pixel, clipped
/// at the border: first over rows, then over columns of those.
fn window_ranges(image: &Image, reach: usize) -> Vec<[[u8; 3]; 2]> {
    let (width, height) = (image.width as usize, image.height as usize);
    let n = width * height;
    let own: Vec<[[u8; 3]; 2]> = image
        .rgb
        .chunks_exact(3)
        .map(|p| [[p[0], p[1], p[2]]; 2])
        .collect();
    let in_rows: Vec<[[u8; 3]; 2]> = (0..n)
        .map(|i| {
            let row = i - i % width;
            range_over(window(i % width, reach, width).map(|x| own[row + x]))
        })
        .collect();
    (0..n)
        .map(|i| {
            let column = i % width;
            range_over(window(i / width, reach, height).map(|y| in_rows[y * width + column]))
        })
        .collect()
}

fn range_over(ranges: impl Iterator<Item = [[u8; 3]; 2]>) -> [[u8; 3]; 2] {
    ranges.fold([[u8::MAX; 3], [u8::MIN; 3]], |[low, high], [l, h]| {
        [
            [0, 1, 2].map(|c| low[c].min(l[c])),
            [0, 1, 2].map(|c| high[c].max(h[c])),
        ]
    })
}
