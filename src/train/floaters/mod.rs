//! Floaters are pruned where a training view shows them before the surface (Xiong et al. 2023, "SparseGS").
//!
//! A pixel has two depths: that of its heaviest Gaussian, the mode, and the mean by weight. A floater that hides a surface is
//! the mode and far before the mean. Over the pixels of a view, with the depth `d` and the mode `m`,
//!
//! ```text
//! x = (d - m) / (d + max(least d, mean d - 3 sigma d))
//! ```
//!
//! and of those above 0 a share stays: `share exp(-falloff dip)`, 0.8 at the least, where the [`dip`](dip::dip) of these `x`, in the mean
//! over the views, says how far they fall apart into surfaces and floaters. In every pixel beyond that share's quantile of its view, all Gaussians up
//! to the mode go whose falloff there is above `exp(-4)`. Those of the far shell stay.
//!
//! The paper's rule is taken here, by the lists that the views were composited from. The published program reads other places
//! of the lists than it means to: it notes the place of what a thread has fetched, not of what it blends.
//!
//! It happens once, so that it runs on the CPU, and each view is rendered twice: for the dips, and for the pixels.

pub mod dip;

use std::f64::consts::LOG2_E;

use glam::DVec3;
use rayon::prelude::*;

use self::dip::dip;
use super::policy::Plan;
use super::record::PlanCounts;
use super::trainer::Trainer;
use crate::camera::Camera;
use crate::config::FloatersConfig;
use crate::error::Result;
use crate::gpu::constants::{ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN};
use crate::render::{Listed, Lists, ViewUniform};

/// Share of the pixels that stays at the least.
const LEAST_SHARE: f64 = 0.8;

/// Natural logarithm of the falloff above which a Gaussian is in a pixel.
const LEAST_EXPONENT: f64 = -4.0;

/// Deviations below the mean depth to which the least depth is raised.
const N_DEVIATIONS: f64 = 3.0;

/// The depths of a pixel in which something is drawn, along the camera's axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depths {
    /// That of the heaviest Gaussian, the first of equals.
    pub mode: f64,
    /// By how much the mean by weight lies behind it; exactly 0 where all lie as deep.
    pub beyond: f64,
}

/// Returns `x` of a view's pixels; 0 where nothing is drawn.
pub fn differences(pixels: &[Option<Depths>]) -> Vec<f64> {
    let depths = || pixels.iter().flatten().map(|p| p.mode + p.beyond);
    let n = depths().count() as f64;
    let mean = depths().sum::<f64>() / n;
    let squares: f64 = depths().map(|d| (d - mean) * (d - mean)).sum();
    // A pixel alone deviates by nothing.
    let deviation = (squares / (n - 1.0).max(1.0)).sqrt();
    let least = depths().fold(f64::INFINITY, f64::min);
    let base = least.max(mean - N_DEVIATIONS * deviation);
    let difference = |p: &Option<Depths>| p.map_or(0.0, |p| p.beyond / (p.mode + p.beyond + base));
    pixels.iter().map(difference).collect()
}

/// Returns the share of pixels that stays if dips are `dip` in the mean.
pub fn share(config: &FloatersConfig, dip: f64) -> f64 {
    (config.share * (-config.falloff * dip).exp()).max(LEAST_SHARE)
}

/// Returns the quantile of sorted values, between two of them in proportion; `None` without values.
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let at = share * sorted.len().checked_sub(1)? as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(low + at.fract() * (high - low))
}

/// Returns the differences above 0, sorted.
fn positive(differences: &[f64]) -> Vec<f64> {
    let mut positive: Vec<f64> = differences.iter().copied().filter(|x| *x > 0.0).collect();
    positive.par_sort_unstable_by(f64::total_cmp);
    positive
}

/// A rendered view: the lists of its pixels, and the depth of every Gaussian.
struct Seen {
    lists: Lists,
    depths: Vec<f64>,
}

impl Seen {
    /// Blends pixel `x`, `y` as `rasterize` does; returns its depths and the place of the mode in its list.
    fn pixel(&self, x: u32, y: u32) -> Option<(Depths, usize)> {
        let mut transmittance = 1.0;
        // Place, depth and weight.
        let mut mode: Option<(usize, f64, f64)> = None;
        // The first depth, beyond which the others are summed.
        let mut front = None;
        let (mut sum, mut total) = (0.0, 0.0);
        for (place, listed) in self.lists.at(x, y).enumerate() {
            let alpha = f64::from(listed.alpha);
            if alpha < ALPHA_MIN {
                continue;
            }
            let weight = transmittance * alpha.min(ALPHA_MAX);
            let next = transmittance - weight;
            if next <= TRANSMITTANCE_MIN {
                break;
            }
            let depth = self.depths[listed.gaussian as usize];
            sum += weight * (depth - *front.get_or_insert(depth));
            total += weight;
            if mode.is_none_or(|(_, _, most)| weight > most) {
                mode = Some((place, depth, weight));
            }
            transmittance = next;
        }
        let (place, mode, _) = mode?;
        let beyond = (front? - mode) + sum / total;
        Some((Depths { mode, beyond }, place))
    }

    /// Returns `of` every pixel, row by row from the top.
    fn map<T: Send>(&self, of: impl Fn(u32, u32) -> T + Sync) -> Vec<T> {
        let [width, height] = self.lists.size();
        let pixel = |i: u32| of(i % width, i / width);
        (0..width * height).into_par_iter().map(pixel).collect()
    }

    fn differences(&self) -> Vec<f64> {
        differences(&self.map(|x, y| self.pixel(x, y).map(|(depths, _)| depths)))
    }

    /// Lists the Gaussians of pixel `x`, `y` up to its mode.
    fn up_to_mode(&self, x: u32, y: u32) -> Vec<u32> {
        let n = self.pixel(x, y).map_or(0, |(_, place)| place + 1);
        let is_in = |listed: &Listed| f64::from(listed.log2_falloff) > LEAST_EXPONENT * LOG2_E;
        let listed = self.lists.at(x, y).take(n).filter(is_in);
        listed.map(|listed| listed.gaussian).collect()
    }
}

impl Trainer<'_> {
    /// Prunes floaters after `done` iterations.
    ///
    /// # Errors
    /// A view that the adapter cannot hold, or a GPU fault.
    pub(super) fn prune_floaters(&mut self, done: u32) -> Result<()> {
        let floats = self.floaters(done)?;
        let counts = PlanCounts {
            pruned_floaters: floats.iter().filter(|floats| **floats).count(),
            ..PlanCounts::default()
        };
        if counts.pruned_floaters == 0 {
            return Ok(());
        }
        let stays: Vec<bool> = floats.iter().map(|floats| !floats).collect();
        let plan = Plan::of_those_that_stay(&stays, counts);
        self.rearrange(&plan, false, done)
    }

    /// Says of every Gaussian whether it floats, after `done` iterations.
    ///
    /// # Errors
    /// A view that the adapter cannot hold, or a GPU fault.
    pub fn floaters(&mut self, done: u32) -> Result<Vec<bool>> {
        let degree = self.sh_degree(done.saturating_sub(1));
        let means = self.optimizer.model.means(self.gpu)?;
        let means: Vec<DVec3> = means.iter().map(|mean| mean.as_dvec3()).collect();
        let views: Vec<(Camera, ViewUniform)> =
            self.cameras().into_iter().zip(self.real.clone()).collect();
        let mut dips = Vec::new();
        for view in &views {
            let sorted = positive(&self.look(view, degree, &means)?.differences());
            if !sorted.is_empty() {
                dips.push(dip(&sorted));
            }
        }
        let mean_dip = dips.iter().sum::<f64>() / dips.len().max(1) as f64;
        let share = share(&self.config.floaters, mean_dip);
        let mut floats = vec![false; means.len()];
        for view in &views {
            let seen = self.look(view, degree, &means)?;
            let differences = seen.differences();
            let Some(threshold) = quantile(&positive(&differences), share) else {
                continue;
            };
            let width = seen.lists.size()[0];
            let found = seen.map(
                |x, y| match differences[(y * width + x) as usize] > threshold {
                    true => seen.up_to_mode(x, y),
                    false => Vec::new(),
                },
            );
            for gaussian in found.into_iter().flatten() {
                floats[gaussian as usize] = true;
            }
        }
        let within = f64::from(self.supervision.frozen_beyond());
        for (floats, mean) in floats.iter_mut().zip(&means) {
            *floats &= mean.length() <= within;
        }
        Ok(floats)
    }

    /// Renders a training view of Gaussians with these means.
    fn look(
        &mut self,
        (camera, uniform): &(Camera, ViewUniform),
        degree: u32,
        means: &[DVec3],
    ) -> Result<Seen> {
        self.pass(*uniform, degree, |pass, commands| pass.forward(commands))?;
        let (workspace, model) = (&self.workspace, &self.optimizer.model);
        let lists = Lists::read(self.gpu, self.kernels, workspace, model, uniform)?;
        let (axis, eye) = (camera.forward(), camera.center());
        let depth = |mean: &DVec3| axis.dot(*mean - eye);
        Ok(Seen {
            lists,
            depths: means.par_iter().map(depth).collect(),
        })
    }
}
