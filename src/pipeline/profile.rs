//! This module says where a run's time goes: it times a sample of the iterations, and makes tables.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::error::Result;
use crate::gpu::{Gpu, KernelTime, Profile};
use crate::report::{Column, Table};
use crate::run::{RunProfile, Sample, Seconds, StepProfile};

/// Iterations between two that are timed: waiting for one in so many costs next to nothing.
const INTERVAL: u32 = 50;

/// Times the first iteration, in which drivers still compile, as a whole, and by kernel every
/// [`INTERVAL`]-th and the last one.
pub(super) struct Sampler {
    /// `None` if the adapter has no timestamps.
    profile: Option<Profile>,
    begin: Instant,
    /// Iterations that were done before.
    before: u32,
    iterations: u32,
    times: BTreeMap<&'static str, KernelTime>,
    timed: u32,
    first_s: Option<f64>,
}

impl Sampler {
    /// Starts to sample a run of `iterations` iterations that begins after `before` of them, now.
    pub(super) fn new(gpu: &Gpu, before: u32, iterations: u32) -> Sampler {
        Sampler {
            profile: Profile::new(gpu),
            begin: Instant::now(),
            before,
            iterations,
            times: BTreeMap::new(),
            timed: 0,
            first_s: None,
        }
    }

    /// Learns that the run has been decided to have so many iterations.
    pub(super) fn ends(&mut self, iterations: u32) {
        self.iterations = iterations;
    }

    pub(super) fn is_due(&self, done: u32) -> bool {
        self.first_s.is_none() || done.is_multiple_of(INTERVAL) || done == self.iterations
    }

    pub(super) fn profile(&mut self) -> Option<&mut Profile> {
        let profile = self.profile.as_mut()?;
        // An iteration that has to be repeated gives no sample.
        profile.clear();
        Some(profile)
    }

    /// Takes the time of the iteration just done.
    ///
    /// # Errors
    /// A GPU fault.
    pub(super) fn take(&mut self, gpu: &Gpu) -> Result<()> {
        if self.first_s.is_none() {
            self.first_s = Some(self.begin.elapsed().as_secs_f64());
            return Ok(());
        }
        let Some(profile) = &mut self.profile else {
            return Ok(());
        };
        for (kernel, time) in profile.take(gpu)? {
            let sum = self.times.entry(kernel).or_default();
            sum.seconds += time.seconds;
            sum.dispatches += time.dispatches;
        }
        self.timed += 1;
        Ok(())
    }

    /// Returns the wall-clock seconds of the first iteration.
    pub(super) fn first_s(&self) -> Option<f64> {
        self.first_s
    }

    /// Returns what was measured; all iterations together took `train_s`.
    pub(super) fn finish(&self, train_s: f64) -> StepProfile {
        let iterations = self.iterations - self.before;
        let wall_s = train_s / f64::from(iterations.max(1));
        let sample = Sample {
            timed: self.timed,
            iterations,
            wall_s,
        };
        StepProfile::new(&self.times, sample)
    }
}

/// Returns both tables of a run's profile, in Markdown.
pub fn profile_tables(profile: &RunProfile) -> String {
    let step = &profile.step;
    let kernels = if step.kernels.is_empty() {
        "No GPU times by kernel: the adapter has no timestamp queries, or there was no iteration after \
         the first\n"
            .to_owned()
    } else {
        format!(
            "GPU time by kernel, mean of {} of {} iterations, by timestamps\n\n{}",
            step.timed,
            step.iterations,
            kernel_table(step)
        )
    };
    let stages = stage_table(&profile.seconds);
    format!(
        "{kernels}\nWall-clock time by stage; those with a dash are parts of training\n\n{stages}"
    )
}

/// Returns an iteration's time by kernel as a table.
pub fn kernel_table(step: &StepProfile) -> Table {
    let columns = [
        Column::text("kernel", "kernel"),
        Column::number("step_ms", "ms a step", 3),
        Column::quantity("share", "share"),
        Column::number("dispatches", "dispatches", 1),
    ];
    let mut table = Table::new("kernels", &columns);
    let total = step.kernel_s();
    let ms = |seconds: f64| (1e3 * seconds).into();
    for kernel in &step.kernels {
        table.row([
            (&kernel.kernel).into(),
            ms(kernel.seconds),
            format!("{:.1} %", 100.0 * kernel.seconds / total).into(),
            kernel.dispatches.into(),
        ]);
    }
    let n: f64 = step.kernels.iter().map(|kernel| kernel.dispatches).sum();
    table.row(["all kernels".into(), ms(total), "100 %".into(), n.into()]);
    table.row(["an iteration, wall clock".into(), ms(step.wall_s)]);
    table
}

fn stage_table(seconds: &Seconds) -> Table {
    let columns = [
        Column::text("stage", "stage"),
        Column::number("seconds", "seconds", 3),
    ];
    let mut table = Table::new("stage-seconds", &columns);
    for (stage, s) in [
        ("adapter", seconds.open),
        ("loading", seconds.load),
        ("focus and field", seconds.field),
        ("carving", seconds.carve),
        ("virtual cameras", seconds.sample),
        ("splatting", seconds.splat),
        ("first Gaussians", seconds.gaussians),
        ("files and checksums", seconds.files),
        ("pipelines", seconds.compile),
        ("buffers and upload", seconds.upload),
        (
            "**from the command to the first iteration**",
            seconds.to_first_iteration,
        ),
        ("training", seconds.train),
        ("- the first iteration", seconds.first_iteration),
        ("- densification, pruning, resets", seconds.densify),
        ("- views held out", seconds.signal),
        ("- checkpoints", seconds.checkpoints),
        ("writing the model", seconds.write),
        ("evaluation", seconds.eval),
        ("report", seconds.report),
    ] {
        if s.is_some() {
            table.row([stage.into(), s.into()]);
        }
    }
    table
}
