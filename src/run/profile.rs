//! This module has what `profile.json` holds.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Seconds;
use crate::gpu::KernelTime;

/// The time that a run's parts took, `profile.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunProfile {
    /// The GPU adapter's name, driver and backend.
    pub adapter: String,
    /// Wall-clock seconds of each stage.
    pub seconds: Seconds,
    /// The time that an iteration takes.
    pub step: StepProfile,
}

/// The time that an iteration of training takes: means over a sample of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepProfile {
    /// Iterations that were run.
    pub iterations: u32,
    /// Those of `iterations` that were timed kernel by kernel.
    pub timed: u32,
    /// Wall-clock seconds an iteration, over all of them, without checkpoints.
    pub wall_s: f64,
    /// The slowest first; empty where the adapter has no timestamps.
    pub kernels: Vec<KernelProfile>,
}

/// One kernel's part of an iteration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KernelProfile {
    /// Name of its entry point.
    pub kernel: String,
    /// Seconds an iteration, over all its dispatches.
    pub seconds: f64,
    /// Dispatches an iteration.
    pub dispatches: f64,
}

/// The iterations of a run that were timed.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Number of timed iterations.
    pub timed: u32,
    /// Number of iterations.
    pub iterations: u32,
    /// Mean wall-clock seconds of an iteration.
    pub wall_s: f64,
}

impl StepProfile {
    /// Makes the means; `times` are sums over the timed iterations.
    pub fn new(times: &BTreeMap<&'static str, KernelTime>, sample: Sample) -> StepProfile {
        let Sample {
            timed,
            iterations,
            wall_s,
        } = sample;
        let n = f64::from(timed.max(1));
        let mut kernels: Vec<KernelProfile> = times
            .iter()
            .map(|(name, time)| KernelProfile {
                kernel: (*name).to_owned(),
                seconds: time.seconds / n,
                dispatches: f64::from(time.dispatches) / n,
            })
            .collect();
        kernels.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
        StepProfile {
            iterations,
            timed,
            wall_s,
            kernels,
        }
    }

    /// Returns the seconds of all kernels.
    pub fn kernel_s(&self) -> f64 {
        self.kernels.iter().map(|k| k.seconds).sum()
    }
}
