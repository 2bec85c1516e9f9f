//! This module has the training loop.

use std::time::Instant;

use super::capacity::{start_capacity, uniform};
use super::depths::Depths;
use super::generator::Generated;
use super::guide::Guide;
use super::length::Settling;
use super::observer::Observer;
use super::optimizer::{Optimizer, OptimizerKernels, StepUniform};
use super::partner::{self, Partner};
use super::policy::{self, Plan, Surroundings};
use super::record::{ImageLoss, LossSample, PlanRecord, SignalPoint, Trained, Trim};
use super::refine::Refinement;
use super::schedule::{self, ViewOrder};
use super::supervision::{Supervision, TrainingView};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::gaussians::Gaussians;
use crate::gpu::{Commands, Exp2, Gpu, Profile};
use crate::render::{
    Bound, DepthKernels, Kernels, LossUniform, Model, Pass, PassStep, Targets, ViewUniform,
    Workspace, read_totals,
};

/// Iterations between two looks at the GPU: a loss sample, the overflow flag, the progress.
const LOOK_INTERVAL: u32 = 10;

/// Opacity that 3DGS's reset leaves at most.
const RESET_OPACITY: f64 = 0.01;

/// Trains `start` on `supervision` for `config.iterations` iterations.
///
/// # Errors
/// No training view, a request that the adapter cannot hold, or a GPU fault.
pub fn train(
    gpu: &Gpu,
    kernels: &Kernels,
    start: &Gaussians,
    supervision: &Supervision,
    config: &Config,
    observer: &mut dyn Observer,
) -> Result<Trained> {
    Trainer::new(gpu, kernels, start, supervision, config)?.run(observer)
}

/// Wall-clock seconds of parts of a training run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrainerSeconds {
    /// The pipelines of the first iteration.
    pub compile: f64,
    /// Densification, pruning and opacity resets.
    pub densify: f64,
    /// Measuring the held-out views, and pruning by them.
    pub signal: f64,
}

/// The views of an iteration, by number among their kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepViews {
    /// Index into [`Supervision::real`].
    pub real: usize,
    /// Index into [`Supervision::virtual_views`]; `None` in an iteration without one.
    pub virtual_view: Option<usize>,
    /// Whether a pseudo view stands in its place.
    pub pseudo_view: bool,
}

/// A training run in progress.
pub struct Trainer<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) kernels: &'a Kernels,
    pub(super) optimizer_kernels: OptimizerKernels,
    pub(super) supervision: &'a Supervision,
    pub(super) config: &'a Config,
    pub(super) real: Vec<ViewUniform>,
    pub(super) virtual_views: Vec<ViewUniform>,
    pub(super) held_out: Vec<ViewUniform>,
    real_order: ViewOrder,
    virtual_order: ViewOrder,
    /// The set that is exported.
    pub(super) optimizer: Optimizer,
    pub(super) workspace: Workspace,
    pub(super) bound: Bound,
    pub(super) adam: Vec<Vec<wgpu::BindGroup>>,
    /// The set beside it, where there is one.
    pub(super) partner: Option<Partner>,
    /// What makes the Gaussians, where they are not trained themselves.
    pub(super) generated: Option<Generated>,
    pub(super) refinement: Option<Refinement>,
    pub(super) depths: Option<Depths>,
    /// One a view, the real ones first; empty unless dropout is guided.
    pub(super) guides: Vec<Guide>,
    /// A view's, unpacked.
    pub(super) goal: Vec<u32>,
    /// The target images that stay on the GPU, the real views' first.
    pub(super) targets: Targets,
    /// Number of finished iterations, where the run starts or has last been kept.
    pub(super) done: u32,
    pub(super) samples: Vec<LossSample>,
    pub(super) plans: Vec<PlanRecord>,
    pub(super) signal: Vec<SignalPoint>,
    pub(super) trims: Vec<Trim>,
    /// As it is planned by now.
    pub(super) settling: Settling,
    pub(super) seconds: TrainerSeconds,
}

impl<'a> Trainer<'a> {
    /// Uploads `start` and allocates.
    ///
    /// # Errors
    /// No training view, or a request that the adapter cannot hold.
    pub fn new(
        gpu: &'a Gpu,
        kernels: &'a Kernels,
        start: &Gaussians,
        supervision: &'a Supervision,
        config: &'a Config,
    ) -> Result<Trainer<'a>> {
        if supervision.real.is_empty() {
            return Err(Error::new("no training view"));
        }
        let uniforms = |views: &[TrainingView]| -> Vec<ViewUniform> {
            views
                .iter()
                .map(|view| uniform(&view.camera, supervision, config))
                .collect()
        };
        let real = uniforms(&supervision.real);
        let virtual_views = uniforms(&supervision.virtual_views);
        let held_out = uniforms(&supervision.held_out);
        let model = Model::upload(gpu, start, start.len())?;
        let capacity = start_capacity(gpu, kernels.rasterizer, model.n, supervision, config);
        let optimizer_kernels = OptimizerKernels::default();
        let mut optimizer = Optimizer::new(gpu, model)?;
        optimizer.set_position_gains(gpu, &supervision.position_gains);
        let workspace = Workspace::new(gpu, capacity, true)?;
        let bound = Bound::new(gpu, kernels, &workspace, &optimizer.model);
        let adam = optimizer.bind(gpu, &optimizer_kernels, &workspace);
        let partner = || {
            let kernels = (kernels, &optimizer_kernels);
            Partner::new(gpu, kernels, (&workspace, start), supervision)
        };
        let partner = config.partner.enabled.then(partner).transpose()?;
        let refine = || Refinement::new(gpu, &workspace, &optimizer.model, &supervision.real);
        let refinement = config.poses.refine.then(refine).transpose()?;
        let depths = config.prior.is_on().then(|| {
            let of = (&workspace, &optimizer.model);
            // Weights are the colours' only with the same 2^x.
            let sources = Exp2::of(config.render.exp2, gpu)?.sources();
            let depth_kernels = DepthKernels::from_sources(kernels.rasterizer, sources);
            Depths::new(gpu, depth_kernels, of, &real, &config.prior)
        });
        let depths = depths.transpose()?;
        let trained = [real.as_slice(), &virtual_views].concat();
        let targets = Self::upload_targets(gpu, &trained, supervision, config)?;
        let mut trainer = Trainer {
            gpu,
            kernels,
            optimizer_kernels,
            supervision,
            config,
            real_order: ViewOrder::real(config.seed, real.len()),
            virtual_order: ViewOrder::virtual_views(config.seed, virtual_views.len()),
            real,
            virtual_views,
            held_out,
            optimizer,
            workspace,
            bound,
            adam,
            partner,
            generated: config
                .generator
                .enabled
                .then(|| Generated::new(start, config)),
            refinement,
            depths,
            guides: Vec::new(),
            goal: Vec::new(),
            targets,
            done: 0,
            samples: Vec::new(),
            plans: Vec::new(),
            signal: Vec::new(),
            trims: Vec::new(),
            settling: Settling::of(config, &[]),
            seconds: TrainerSeconds::default(),
        };
        trainer.generate();
        Ok(trainer)
    }

    /// Returns what parts of the run have taken so far.
    pub fn seconds(&self) -> TrainerSeconds {
        self.seconds
    }

    /// Runs all iterations that are left, from the first or from where the run was restored.
    ///
    /// # Errors
    /// A request that the adapter cannot hold, or a GPU fault.
    pub fn run(&mut self, observer: &mut dyn Observer) -> Result<Trained> {
        let mut done = self.done;
        if done == 0 && observer.inspects(done) {
            observer.inspect(done, &self.optimizer.model)?;
        }
        observer.ends(self.settling.until);
        while done < self.settling.until {
            self.guide(done)?;
            let times = observer.times(done + 1);
            let profile = if times { observer.profile() } else { None };
            let views = self.step(done, profile);
            self.refine(done, views.real)?;
            self.train_generator(done, views)?;
            done += 1;
            let changes = self.changes(done);
            let looks = self.looks(done);
            let keeps = observer.keeps(done);
            let measures = self.measures(done);
            if !(looks || observer.inspects(done) || keeps || times || measures) {
                continue;
            }
            if let Some(skipped) = self.make_room()? {
                done = skipped;
                continue;
            }
            if times {
                observer.timed(self.gpu)?;
            }
            if measures {
                observer.measured(&self.measure(done)?);
                // It may have decided that training ends.
                observer.ends(self.settling.until);
            }
            let is_last = done == self.settling.until;
            if looks || is_last {
                let sample = self.sample(done, views)?;
                observer.look(&sample, self.optimizer.model.n);
                self.samples.push(sample);
            }
            if observer.inspects(done) {
                observer.inspect(done, &self.optimizer.model)?;
            }
            if self.trims(done) {
                self.trim(done)?;
            }
            // No step would train what a change at the end leaves.
            if changes && !is_last {
                self.change(done)?;
            }
            if keeps || (is_last && observer.keeps(done)) {
                self.done = done;
                observer.keep(&self.state(), &mut self.buffers())?;
            }
        }
        let lowering = self.lower(done)?;
        self.gpu.wait()?;
        Ok(Trained {
            lowering,
            gaussians: self.optimizer.model.download(self.gpu)?,
            cameras: self.cameras(),
            samples: std::mem::take(&mut self.samples),
            plans: std::mem::take(&mut self.plans),
            signal: std::mem::take(&mut self.signal),
            trims: std::mem::take(&mut self.trims),
            iterations: self.settling.until,
        })
    }

    /// Says whether a set or its opacities change after `done` iterations.
    fn changes(&self, done: u32) -> bool {
        schedule::changes(self.config, done) || partner::prunes(self.config, done)
    }

    /// Says whether a loss is sampled after `done` iterations, whatever a measurement then decides.
    fn looks(&self, done: u32) -> bool {
        self.changes(done) || done.is_multiple_of(LOOK_INTERVAL) || done == self.settling.until
    }

    /// Compiles the pipelines of the iteration that comes next. Those that only a later one needs are
    /// compiled then.
    pub fn compile(&mut self) {
        let clock = Instant::now();
        let mut commands = Commands::new(self.gpu);
        self.record(self.done, &mut commands);
        commands.compile();
        self.seconds.compile = clock.elapsed().as_secs_f64();
    }

    /// Records and submits iteration `iteration` (from 0), timed where there is a profile;
    /// returns its views.
    pub fn step(&mut self, iteration: u32, profile: Option<&mut Profile>) -> StepViews {
        let mut commands = Commands::profiled(self.gpu, profile);
        let views = self.record(iteration, &mut commands);
        commands.submit();
        views
    }

    fn record(&mut self, iteration: u32, commands: &mut Commands<'_>) -> StepViews {
        let config = self.config;
        let degree = self.sh_degree(iteration);
        // There is at least one real view.
        let real = self.real_order.view(iteration).unwrap_or(0);
        if self.partner.is_some() {
            return self.record_both(iteration, real, commands);
        }
        let virtual_view = self.virtual_order.view(iteration);
        let dropout = schedule::dropout(config, iteration);
        let background = schedule::background(config, iteration);
        // A measurement may find that this was the last iteration, whose loss is sampled.
        let sampled = self.looks(iteration + 1) || self.measures(iteration + 1);
        let mut centers = Vec::with_capacity(2);
        let chosen = [
            Some((&self.supervision.real[real], self.real[real], real)),
            virtual_view.map(|k| {
                let view = &self.supervision.virtual_views[k];
                (view, self.virtual_views[k], self.real.len() + k)
            }),
        ];
        let has_depths = self.depths.as_mut().is_some_and(|depths| {
            let view = &self.supervision.real[real];
            depths.set(self.gpu, iteration, view, &self.real[real])
        });
        // Copies of both first, so that the dispatches lie in a row.
        for (slot, (view, uniform, k)) in chosen.into_iter().flatten().enumerate() {
            self.set_goal(commands, slot, view, &uniform, k, background);
        }
        for (slot, (view, uniform, k)) in chosen.into_iter().flatten().enumerate() {
            let scale = [1.0, config.loss.virtual_weight_beside(self.real.len())][slot];
            let w = config.loss.ssim_weight;
            let weight = view.weight * scale;
            let loss = LossUniform::new(weight, w, view.total_weight, view.masked)
                .with_far(weight * config.loss.far_weight, view.n_far)
                .with_silhouette(weight * config.loss.silhouette_weight, view.n_outlined);
            let pass = Pass::new(
                self.gpu,
                self.kernels,
                &self.workspace,
                &self.bound,
                &self.optimizer.model,
                self.dropped_out(uniform.before(background), k, dropout),
                PassStep {
                    slot,
                    sh_degree: degree,
                    number: iteration + 1,
                },
            );
            pass.forward(commands);
            pass.loss_gradient(commands, loss);
            if sampled {
                pass.sum_losses(commands);
            }
            match &self.depths {
                Some(depths) if slot == 0 && has_depths => depths.backward(&pass, commands),
                _ => pass.backward(commands),
            }
            if let (0, Some(refinement)) = (slot, &self.refinement)
                && let Some(gradient) = &refinement.gradient
            {
                pass.pose_backward(commands, &refinement.kernels, gradient);
            }
            centers.push(uniform.center());
        }
        if self.generated.is_none() {
            let step = self.step_uniform(iteration, &centers);
            let kernels = &self.optimizer_kernels;
            self.optimizer
                .step(self.gpu, kernels, &self.adam, commands, step, degree);
        }
        StepViews {
            real,
            virtual_view,
            pseudo_view: false,
        }
    }

    /// Returns the Adam step of an iteration whose views have these optical centres.
    pub(super) fn step_uniform(&self, iteration: u32, centers: &[[f64; 3]]) -> StepUniform {
        StepUniform::new(self.config, iteration, self.supervision.extent, centers)
            .within(self.supervision.frozen_beyond())
            .slowed(self.settling.rate(iteration))
    }

    /// Returns the number of (tile, Gaussian) pairs of the last view, for benches.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn n_pairs(&self) -> Result<usize> {
        Ok(read_totals(self.gpu, &self.workspace)?.pairs)
    }

    /// Reads the losses of the iteration just done.
    fn sample(&self, done: u32, views: StepViews) -> Result<LossSample> {
        let StepViews {
            real,
            virtual_view,
            pseudo_view,
        } = views;
        let losses = self.workspace.read_losses(self.gpu)?;
        let w = self.config.loss.ssim_weight;
        let total = |loss: ImageLoss| (1.0 - w) * loss.l1 + w * (1.0 - loss.ssim);
        let part = |slot: usize| ImageLoss {
            l1: losses[slot][0],
            ssim: losses[slot][1],
        };
        let virt = (virtual_view.is_some() || pseudo_view).then(|| part(1));
        let mut loss = self.supervision.real[real].weight * total(part(0));
        let weight = match virtual_view {
            Some(k) => {
                let scale = self.config.loss.virtual_weight_beside(self.real.len());
                self.supervision.virtual_views[k].weight * scale
            }
            None => self.config.partner.weight,
        };
        loss += virt.map_or(0.0, |part| weight * total(part));
        let depths = match &self.depths {
            Some(depths) => {
                let view = &self.supervision.real[real];
                let iteration = done.saturating_sub(1);
                let losses = depths.losses(self.gpu, iteration, view)?;
                loss += losses.map_or(0.0, |losses| depths.total(iteration, &losses));
                losses
            }
            None => None,
        };
        Ok(LossSample {
            iteration: done,
            loss,
            real: part(0),
            virt,
            depths,
        })
    }

    /// Densifies, prunes and resets as the schedule says after `done` iterations.
    fn change(&mut self, done: u32) -> Result<()> {
        let clock = Instant::now();
        let densifies = schedule::densifies(self.config, done);
        if let Some(plan) = self.plan(done, 0)? {
            self.rearrange(&plan, densifies, done)?;
        }
        if schedule::unpools(self.config, done) {
            self.unpool(done)?;
        }
        self.reset(done);
        self.in_partner(|trainer| {
            if let Some(plan) = trainer.plan(done, 1)? {
                trainer.carry_out(&plan, densifies)?;
            }
            trainer.reset(done);
            Ok(())
        })?;
        if schedule::removes_outliers(self.config, done) {
            self.remove_outliers(done)?;
        }
        if partner::prunes(self.config, done) {
            self.prune_apart(done)?;
        }
        if schedule::prunes_floaters(self.config, done) {
            self.prune_floaters(done)?;
        }
        self.seconds.densify += clock.elapsed().as_secs_f64();
        Ok(())
    }

    /// Decides which Gaussians of a set come and go after `done` iterations; `None` where that is not due.
    fn plan(&self, done: u32, set: u64) -> Result<Option<Plan>> {
        let config = self.config;
        if !schedule::densifies(config, done) && !schedule::prunes_by_coverage(config, done) {
            return Ok(None);
        }
        let gathered = self.optimizer.gather(self.gpu)?;
        let surroundings = Surroundings {
            coverage: &self.supervision.coverage,
            extent: self.supervision.extent,
            frozen_beyond: self.supervision.frozen_beyond(),
            set,
        };
        Ok(Some(policy::plan(&gathered, config, &surroundings, done)))
    }

    /// Resets the opacities where that is due after `done` iterations.
    fn reset(&self, done: u32) {
        if schedule::resets_opacity(self.config, done) {
            self.optimizer.reset_opacity(
                self.gpu,
                &self.optimizer_kernels,
                RESET_OPACITY,
                self.supervision.frozen_beyond(),
            );
        }
    }

    /// Carries out a plan after `done` iterations and notes it.
    pub(super) fn rearrange(&mut self, plan: &Plan, densifies: bool, done: u32) -> Result<()> {
        self.carry_out(plan, densifies)?;
        self.plans.push(PlanRecord {
            iteration: done,
            n_gaussians: self.optimizer.model.n,
            counts: plan.counts,
        });
        Ok(())
    }

    /// Carries out a plan.
    pub(super) fn carry_out(&mut self, plan: &Plan, densifies: bool) -> Result<()> {
        self.unbind();
        let kernels = &self.optimizer_kernels;
        self.optimizer
            .rearrange(self.gpu, kernels, plan, densifies)?;
        self.fit_model()
    }
}
