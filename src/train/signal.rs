//! This module measures the signal: how well virtual views are shown that nothing was learned from.
//!
//! One in `need.hold_out` virtual views is held out of training. Its splat shows what the photographs saw from where
//! none was taken: it tells what was learned of the scene from what was learned by heart, which the training
//! views cannot, and no test view is looked at for it. Pixels of full weight alone are measured: a point was
//! seen there, while the others were filled in.
//!
//! A measurement renders up to 16 held-out views and up to 16 photographs once, forward alone, in the buffers of training.

use std::time::Instant;

use super::length::Settling;
use super::record::SignalPoint;
use super::schedule;
use super::supervision::TrainingView;
use super::trainer::Trainer;
use crate::error::Result;
use crate::gpu::Commands;
use crate::metrics::{FloatImage, masked_psnr, mean};
use crate::render::{
    Pass, PassStep, Rendered, ViewUniform, read_rendered, read_totals, until_it_fits,
};
use crate::scene::Image;

/// Measurements lie at least this share of the iterations done apart.
const SPACING: u32 = 10;

/// Most held-out views that a measurement renders, evenly over all: it costs what some eight iterations do.
const MOST_MEASURED: usize = 16;

/// Most photographs that a measurement renders, evenly over all: what hundreds cost would be more than training.
const MOST_PHOTOGRAPHS: usize = 16;

/// Greatest PSNR that is told, dB: an error of a 400th of a level. That of equal images is no number.
const MOST_PSNR: f64 = 100.0;

/// A view and its camera as kernels take it.
type Measured<'a> = (&'a TrainingView, ViewUniform);

/// Says whether a measurement follows after `done` iterations, `interval` or more after the last.
fn is_due(signal: &[SignalPoint], interval: u32, done: u32) -> bool {
    let last = signal.last().map_or(0, |point| point.iteration);
    done >= last.saturating_add(interval.max(last / SPACING))
}

impl Trainer<'_> {
    /// Says whether the held-out views are measured after `done` iterations; the last is among them.
    pub(super) fn measures(&self, done: u32) -> bool {
        let Settling { from, until } = self.settling;
        let is_new = self.signal.last().is_none_or(|p| p.iteration < done);
        let is_turn = done == from || done == until || self.trims(done);
        let interval = self.config.need.interval;
        !self.held_out.is_empty() && (is_due(&self.signal, interval, done) || (is_new && is_turn))
    }

    /// Returns the settling as the measurements so far have it.
    pub(super) fn settles(&self) -> Settling {
        Settling::of(self.config, &self.signal)
    }

    /// Returns the active SH degree at `iteration` (from 0). None begins once rates fall: it would hardly be trained.
    pub(super) fn sh_degree(&self, iteration: u32) -> u32 {
        schedule::sh_degree(self.config, iteration.min(self.settling.from))
    }

    /// Measures after `done` iterations, and returns what came of it.
    ///
    /// # Errors
    /// A view that the adapter cannot hold, or a GPU fault.
    pub(super) fn measure(&mut self, done: u32) -> Result<SignalPoint> {
        let clock = Instant::now();
        let point = self.point(done, MOST_MEASURED)?;
        self.signal.push(point);
        self.settling = self.settles();
        self.seconds.signal += clock.elapsed().as_secs_f64();
        Ok(point)
    }

    /// Returns what a measurement gives after `done` iterations, of at most so many held-out views, evenly over all.
    pub(super) fn point(&mut self, done: u32, most_held_out: usize) -> Result<SignalPoint> {
        let degree = self.sh_degree(done.saturating_sub(1));
        let supervision = self.supervision;
        let held_out = evenly(self.held_out.len(), most_held_out);
        let held_out = held_out.map(|i| (&supervision.held_out[i], self.held_out[i]));
        let held_out: Vec<Measured<'_>> = held_out.collect();
        let real = evenly(self.real.len(), MOST_PHOTOGRAPHS);
        let real = real.map(|i| (&supervision.real[i], self.real[i]));
        let real: Vec<Measured<'_>> = real.collect();
        Ok(SignalPoint {
            iteration: done,
            n_gaussians: self.optimizer.model.n,
            held_out: self.mean_psnr(&held_out, degree)?.unwrap_or(0.0),
            photographs: self.mean_psnr(&real, degree)?,
        })
    }

    /// Returns the mean PSNR of views over their pixels of full weight; `None` where there are none.
    fn mean_psnr(&mut self, views: &[Measured<'_>], degree: u32) -> Result<Option<f64>> {
        let mut scores = Vec::with_capacity(views.len());
        for &(view, uniform) in views {
            self.pass(uniform, degree, |pass, commands| pass.forward(commands))?;
            let rendered = self.workspace.buffer("rendered");
            let rendered = read_rendered(self.gpu, rendered, &uniform)?;
            view.goal.unpack(&mut self.goal);
            let visible = self.goal.iter().map(|texel| view.weight_of(*texel) == 1.0);
            let visible: Vec<bool> = visible.collect();
            scores.push(visible_psnr(&rendered, &self.goal, &visible)?);
        }
        Ok(mean(scores.into_iter().filter(Option::is_some)))
    }

    /// Runs stages of one view between two steps, without dropout; their results are in the workspace. Training goes
    /// on as if nothing had been, with more room where the view has asked for it.
    ///
    /// # Errors
    /// A view that the adapter cannot hold, or a GPU fault.
    pub(super) fn pass(
        &mut self,
        view: ViewUniform,
        sh_degree: u32,
        record: impl Fn(&Pass<'_>, &mut Commands<'_>),
    ) -> Result<()> {
        let gpu = self.gpu;
        until_it_fits(gpu, self.workspace.capacity, |needed| {
            if needed != self.workspace.capacity {
                self.grow(needed)?;
            }
            let step = PassStep {
                slot: 0,
                sh_degree,
                number: 1,
            };
            let (workspace, model) = (&self.workspace, &self.optimizer.model);
            let pass = Pass::new(gpu, self.kernels, workspace, &self.bound, model, view, step);
            let mut commands = Commands::new(gpu);
            record(&pass, &mut commands);
            commands.submit();
            read_totals(gpu, workspace)
        })
    }
}

/// Iterates over at most `most` of the indices below `n`, evenly.
pub(super) fn evenly(n: usize, most: usize) -> impl Iterator<Item = usize> {
    let taken = n.min(most);
    (0..taken).map(move |i| i * n / taken)
}

/// Returns the PSNR of a render over the pixels of `goal` that are `visible`.
fn visible_psnr(rendered: &Rendered, goal: &[u32], visible: &[bool]) -> Result<Option<f64>> {
    let (width, height) = (rendered.width, rendered.height);
    let rgb = goal.iter().flat_map(|texel| {
        let [r, g, b, _] = texel.to_le_bytes();
        [r, g, b]
    });
    let truth = Image {
        width,
        height,
        rgb: rgb.collect(),
    };
    let render = FloatImage {
        width,
        height,
        rgb: &rendered.rgb,
    };
    let psnr = masked_psnr(&render, &truth, visible)?;
    Ok(psnr.map(|psnr| psnr.min(MOST_PSNR)))
}
