//! This module takes the time of a sample of a run's iterations.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::error::Result;
use crate::gpu::{Gpu, KernelTime, Profile};
use crate::run::{Sample, StepProfile};

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
