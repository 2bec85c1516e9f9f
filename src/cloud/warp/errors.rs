//! The errors of splats and of warped photographs are measured where the truth is known: at the
//! photographs, each warped to and splatted from the others alone.
//!
//! A photograph that is left out takes its points with it: those that have its colour
//! ([`Photographs::origins`]). What is left is splatted and warped into its camera and compared with
//! it, pixel by pixel. No test view is looked at.
//!
//! - The variance of a photograph's colour grows with the square of the chord `c` between the rays;
//!   that of the splat is as large as that of the nearest photograph and larger by a constant:
//!   `excess = (e_splat / e_warp - 1) mean c^2` of the mean squared errors `e`, at least 0.
//! - The squared error of both, joined by the inverse of these variances, is `by_chord c +
//!   by_difference d`, by least squares with factors of at least 0; `d` is the mean squared
//!   difference between splat and warp in the window around.

use super::photographs::{Photographs, Seen, Weighing, inverse_variance, squared_difference};
use super::surface::Scratch;
use crate::camera::Frame;
use crate::cloud::splat::{SplatImage, splat_views};
use crate::config::Config;
use crate::error::Result;
use crate::scene::{PointCloud, View};

/// Most pixels of a photograph that errors are measured at, evenly over it.
const MOST_SAMPLES: usize = 1 << 16;

/// Fewer pixels than this that another photograph sees say nothing about errors.
const LEAST_SAMPLES: usize = 256;

/// Pixels to each side of a pixel over which the difference between splat and warp is averaged.
const REACH: usize = 2;

/// The measured errors; variances in squared levels, of 0 to 255.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Errors {
    /// Square of a chord that the splat's variance has beyond that of the nearest photograph.
    excess: f64,
    /// Variance a chord.
    by_chord: f64,
    /// Variance a squared difference.
    by_difference: f64,
    /// Variance of the splat where no photograph sees the surface.
    unseen: f64,
    /// Variance up to which a pixel has full weight: the mean of all that were measured.
    full: f64,
}

/// A pixel of a photograph that was left out.
struct Sample {
    truth: [f32; 3],
    splat: [f32; 3],
    seen: Seen,
    /// See [`differences`].
    difference: f32,
}

impl Errors {
    /// Measures the errors at the `views`, canonical `near`; `origins` are the points' of `cloud`.
    /// `None` where too few pixels are seen from another photograph to tell.
    ///
    /// # Errors
    /// As [`Photographs::new`].
    pub(super) fn measure(
        (cloud, origins): (&PointCloud, &[Option<usize>]),
        frame: &Frame,
        views: &[&View],
        config: &Config,
        near: f64,
    ) -> Result<Option<Errors>> {
        let mut all = Vec::new();
        // One after the other: each has a cloud of its own.
        for left_out in 0..views.len() {
            let mut kept = cloud.clone();
            let is_other = |origin: &Option<usize>| origin.is_some_and(|i| i != left_out);
            kept.retain(&origins.iter().map(is_other).collect::<Vec<_>>());
            let mut others = views.to_vec();
            let view = others.remove(left_out);
            all.extend(samples(&kept, frame, (view, &others), config, near)?);
        }
        Ok(Errors::fit(&all))
    }

    fn fit(samples: &[Sample]) -> Option<Errors> {
        let is_seen = |sample: &&Sample| sample.seen.weight > 0.0;
        let seen: Vec<&Sample> = samples.iter().filter(is_seen).collect();
        if seen.len() < LEAST_SAMPLES {
            return None;
        }
        let error =
            |color: [f32; 3], sample: &Sample| f64::from(squared_difference(color, sample.truth));
        let mean = |of: &dyn Fn(&Sample) -> f64| {
            seen.iter().map(|sample| of(sample)).sum::<f64>() / seen.len() as f64
        };
        let by_splat = mean(&|sample| error(sample.splat, sample));
        let by_warp = mean(&|sample| error(sample.seen.color, sample));
        let chord_squared = mean(&|sample| sample.seen.chord_squared.into());
        // Without any error on either side this is NaN, of which `max` makes 0.
        let excess = ((by_splat - by_warp) / by_warp * chord_squared).max(0.0);
        let left = |sample: &Sample| error(joined(sample.splat, sample.seen, excess), sample);
        let chord = |sample: &Sample| f64::from(sample.seen.chord_squared).sqrt();
        let difference = |sample: &Sample| f64::from(sample.difference);
        let [by_chord, by_difference] = factors([
            mean(&|s| chord(s) * chord(s)),
            mean(&|s| chord(s) * difference(s)),
            mean(&|s| difference(s) * difference(s)),
            mean(&|s| chord(s) * left(s)),
            mean(&|s| difference(s) * left(s)),
        ]);
        let unseen: Vec<f64> = samples
            .iter()
            .filter(|sample| !is_seen(sample))
            .map(|sample| error(sample.splat, sample))
            .collect();
        let full = mean(&left);
        Some(Errors {
            excess,
            by_chord,
            by_difference,
            unseen: match unseen.len() {
                0 => full,
                n => unseen.iter().sum::<f64>() / n as f64,
            },
            full,
        })
    }

    /// Joins the colours of splat and photographs by the inverse of their variances.
    pub(super) fn joined(&self, splat: [f32; 3], seen: Seen) -> [f32; 3] {
        joined(splat, seen, self.excess)
    }

    /// Returns the weight, in (0, 1], of a pixel with this `difference` ([`differences`]).
    pub(super) fn weight(&self, seen: Seen, difference: f32) -> f64 {
        let variance = match seen.weight > 0.0 {
            true => {
                self.by_chord * f64::from(seen.chord_squared).sqrt()
                    + self.by_difference * f64::from(difference)
            }
            false => self.unseen,
        };
        // Without any error the quotient is NaN, of which `min` makes 1.
        (self.full / variance).min(1.0)
    }
}

/// Splats and warps the `others` into a view's camera, and returns the covered pixels of its
/// photograph, evenly over it.
fn samples(
    cloud: &PointCloud,
    frame: &Frame,
    (view, others): (&View, &[&View]),
    config: &Config,
    near: f64,
) -> Result<Vec<Sample>> {
    if others.is_empty() {
        return Ok(Vec::new());
    }
    let sources: Vec<_> = others.iter().map(|view| view.camera.clone()).collect();
    let camera = std::slice::from_ref(&view.camera);
    let splats = splat_views(cloud, frame, (camera, &sources), &config.splat, near)?;
    let photographs = Photographs::new(cloud, frame, others, (config, Weighing::Chord), near)?;
    let seen = photographs.look(&view.camera, &mut Scratch::default())?;
    let mut samples = Vec::new();
    for splat in &splats {
        let differences = differences(splat, &seen);
        let step = seen.len().div_ceil(MOST_SAMPLES);
        for pixel in (0..seen.len()).step_by(step) {
            if splat.rgba[4 * pixel + 3] != 0 && view.shows(pixel) {
                samples.push(Sample {
                    truth: color(&view.image.rgb[3 * pixel..]),
                    splat: color(&splat.rgba[4 * pixel..]),
                    seen: seen[pixel],
                    difference: differences[pixel],
                });
            }
        }
    }
    Ok(samples)
}

/// Returns the mean squared difference between splat and photographs over the window around every
/// pixel, of those pixels that both show; 0 where they do not show the pixel itself.
pub(super) fn differences(splat: &SplatImage, seen: &[Seen]) -> Vec<f32> {
    let own = |pixel: usize| {
        let both = splat.rgba[4 * pixel + 3] != 0 && seen[pixel].weight > 0.0;
        both.then(|| squared_difference(color(&splat.rgba[4 * pixel..]), seen[pixel].color))
    };
    let own: Vec<Option<f32>> = (0..seen.len()).map(own).collect();
    let (width, height) = (splat.width as usize, splat.height as usize);
    let around = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let (mut sum, mut n) = (0.0, 0.0);
        for row in y.saturating_sub(REACH)..=(y + REACH).min(height - 1) {
            for column in x.saturating_sub(REACH)..=(x + REACH).min(width - 1) {
                if let Some(difference) = own[row * width + column] {
                    sum += difference;
                    n += 1.0;
                }
            }
        }
        sum / n
    };
    (0..own.len())
        .map(|pixel| own[pixel].map_or(0.0, |_| around(pixel)))
        .collect()
}

fn joined(splat: [f32; 3], seen: Seen, excess: f64) -> [f32; 3] {
    let weight = inverse_variance(seen.chord_squared.into(), excess) as f32;
    let all = weight + seen.weight;
    std::array::from_fn(|i| (weight * splat[i] + seen.weight * seen.color[i]) / all)
}

/// Returns the factors `f` of at least 0 that bring `f_0 x_0 + f_1 x_1` nearest to `y` by least
/// squares, from the means of `x_0 x_0`, `x_0 x_1`, `x_1 x_1`, `x_0 y`, `x_1 y`, none negative.
fn factors([aa, ab, bb, ay, by]: [f64; 5]) -> [f64; 2] {
    let determinant = aa * bb - ab * ab;
    let [a, b] = [ay * bb - by * ab, by * aa - ay * ab];
    if determinant > 0.0 && a >= 0.0 && b >= 0.0 {
        return [a / determinant, b / determinant];
    }
    // The best lies on one of the axes.
    match b < 0.0 || bb <= 0.0 {
        true => [ay / aa, 0.0],
        false => [0.0, by / bb],
    }
}

/// Returns the first three bytes as levels.
pub(super) fn color(bytes: &[u8]) -> [f32; 3] {
    std::array::from_fn(|i| f32::from(bytes[i]))
}
