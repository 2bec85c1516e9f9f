//! This module does what goes on beside training: progress, checkpoints, the curve.

use std::time::Instant;

use super::keep::{Keeper, Log};
use super::profile::Sampler;
use crate::camera::Frame;
use crate::config::Config;
use crate::error::Result;
use crate::eval::{self, EvalOptions};
use crate::gpu::{Gpu, Profile};
use crate::live::Live;
use crate::render::{Model, Renderer};
use crate::run::{CurvePoint, Evaluation};
use crate::scene::View;
use crate::terminal::progress::Progress;
use crate::train::{LossSample, Observer, SignalPoint, State};

/// Shows the training's progress, on a page, too, where one is served, keeps its state, and measures
/// on the way where a curve is asked for.
pub(super) struct Watch<'a> {
    pub(super) progress: Progress,
    pub(super) curve: Option<Curve<'a>>,
    pub(super) keeper: Keeper<'a>,
    /// The sampler of a profiled run; `None` in others.
    pub(super) sampler: Option<Sampler>,
    /// The page that shows the training; `None`: none.
    pub(super) live: Option<&'a Live>,
    pub(super) gpu: &'a Gpu,
    /// Training and curve before `clock`.
    pub(super) before_s: f64,
    pub(super) clock: Instant,
    pub(super) log: Log,
    /// Number of iterations, as far as it is decided.
    pub(super) iterations: u32,
}

impl Watch<'_> {
    /// Returns the seconds of training alone so far.
    pub(super) fn train_s(&self) -> f64 {
        self.before_s + self.clock.elapsed().as_secs_f64() - self.log.curve_s
    }

    /// Says whether the curve has a point after `done` iterations.
    fn is_curve_due(&self, done: u32) -> bool {
        let due = |c: &Curve| done.is_multiple_of(c.every) && done < self.iterations;
        self.curve.as_ref().is_some_and(due)
    }

    /// Measures a point of the curve.
    fn measure(&mut self, done: u32, model: &Model) -> Result<()> {
        let train_s = self.train_s();
        let Some(curve) = &mut self.curve else {
            return Ok(());
        };
        let start = Instant::now();
        let (views, config) = (curve.views, &curve.config.model);
        let mut scores = Vec::with_capacity(views.len());
        let renderer = &mut curve.renderer;
        eval::render_model(
            renderer,
            model,
            curve.frame,
            views,
            config,
            |view, render| {
                scores.push(eval::score(render, view, None, &curve.options)?);
                Ok(())
            },
        )?;
        let evaluation = Evaluation::new(scores, model.n, Some(train_s));
        let point = curve_point(done, &evaluation);
        if let Some(live) = self.live {
            live.tested(&point);
        }
        self.log.curve.push(point);
        self.log.curve_s += start.elapsed().as_secs_f64();
        Ok(())
    }
}

/// Errors at the test views every so many iterations. The last iteration's are those of the
/// written model, which are measured anyway.
pub(super) struct Curve<'a> {
    pub(super) every: u32,
    pub(super) renderer: Renderer<'a>,
    pub(super) views: &'a [View],
    pub(super) frame: &'a Frame,
    pub(super) config: &'a Config,
    /// Without LPIPS, which takes longer than many iterations.
    pub(super) options: EvalOptions,
}

/// Returns an evaluation as a point of the curve.
pub(super) fn curve_point(iteration: u32, evaluation: &Evaluation) -> CurvePoint {
    CurvePoint {
        iteration,
        n_gaussians: evaluation.n_gaussians,
        train_s: evaluation.train_s,
        psnr: evaluation.mean.psnr,
        ssim: evaluation.mean.ssim,
    }
}

impl Observer for Watch<'_> {
    fn ends(&mut self, iterations: u32) {
        if iterations < self.iterations {
            log::info!(
                "the held-out views have stopped rising: training ends after {iterations} iterations"
            );
        }
        self.iterations = iterations;
        self.progress.ends(iterations);
        self.keeper.ends(iterations);
        if let Some(live) = self.live {
            live.ends(iterations);
        }
        if let Some(sampler) = &mut self.sampler {
            sampler.ends(iterations);
        }
    }

    fn times(&self, done: u32) -> bool {
        self.sampler.as_ref().is_some_and(|s| s.is_due(done))
    }

    fn profile(&mut self) -> Option<&mut Profile> {
        self.sampler.as_mut().and_then(Sampler::profile)
    }

    fn timed(&mut self, gpu: &Gpu) -> Result<()> {
        self.sampler.as_mut().map_or(Ok(()), |s| s.take(gpu))
    }

    fn inspects(&self, done: u32) -> bool {
        self.is_curve_due(done) || self.live.is_some_and(Live::is_due)
    }

    fn inspect(&mut self, done: u32, model: &Model) -> Result<()> {
        if let Some(live) = self.live
            && live.is_due()
        {
            let start = Instant::now();
            let gaussians = model.download_base(self.gpu)?;
            live.show(done, gaussians, start.elapsed());
        }
        if self.is_curve_due(done) {
            self.measure(done, model)?;
        }
        Ok(())
    }

    fn measured(&mut self, point: &SignalPoint) {
        if let Some(live) = self.live {
            live.measured(point);
        }
    }

    fn look(&mut self, sample: &LossSample, n_gaussians: usize) {
        let done = sample.iteration;
        self.progress.update(done, sample.loss, n_gaussians);
        if let Some(live) = self.live {
            let (_, seconds_left) = self.progress.pace(done);
            live.look(sample, n_gaussians, seconds_left);
        }
    }

    fn keeps(&self, done: u32) -> bool {
        self.keeper.is_due(done)
    }

    fn keep(
        &mut self,
        state: &State,
        buffers: &mut dyn Iterator<Item = Result<Vec<u8>>>,
    ) -> Result<()> {
        self.log.train_s = self.train_s();
        self.keeper.keep(state, buffers, &mut self.log)
    }
}
