//! What a training tells as it goes, and what it leaves.

use serde::{Deserialize, Serialize};

use super::trainer::Trainer;
use crate::camera::Camera;
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::{Gpu, Profile};
use crate::render::Model;
use crate::run::{LossSample, PlanCounts};

/// Told of the training as it goes; nothing that it does changes what is trained.
pub trait Observer {
    /// After every look at the losses.
    fn look(&mut self, sample: &LossSample, n_gaussians: usize);

    /// Whether the iteration that makes `done` is to be timed.
    fn times(&self, _done: u32) -> bool {
        false
    }

    /// What times it by kernel, if anything.
    fn profile(&mut self) -> Option<&mut Profile> {
        None
    }

    /// After such an iteration, once it is done on the GPU. One that has to be repeated is told of
    /// when it is done.
    ///
    /// # Errors
    /// End the training.
    fn timed(&mut self, _gpu: &Gpu) -> Result<()> {
        Ok(())
    }

    /// Whether [`Observer::inspect`] is to be called after `done` iterations (0: at the start).
    fn inspects(&self, _done: u32) -> bool {
        false
    }

    /// Shown the Gaussians after `done` iterations, before densification, pruning and opacity
    /// reset that may follow (as 3DGS reports).
    ///
    /// # Errors
    /// End the training.
    fn inspect(&mut self, _done: u32, _model: &Model) -> Result<()> {
        Ok(())
    }

    /// Whether [`Observer::keep`] is to be called after `done` iterations.
    fn keeps(&self, _done: u32) -> bool {
        false
    }

    /// Shown the run between two iterations.
    ///
    /// # Errors
    /// End the training.
    fn keep(&mut self, _trainer: &Trainer<'_>) -> Result<()> {
        Ok(())
    }
}

/// Nobody is told.
impl Observer for () {
    fn look(&mut self, _: &LossSample, _: usize) {}
}

/// A change of the set of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlanRecord {
    /// Number of finished iterations.
    pub iteration: u32,
    /// Gaussians after it.
    pub n_gaussians: usize,
    pub counts: PlanCounts,
}

/// What a training run leaves.
pub struct Trained {
    /// Canonical frame.
    pub gaussians: Gaussians,
    /// The training cameras, refined where the config asks for it; canonical frame.
    pub cameras: Vec<Camera>,
    pub samples: Vec<LossSample>,
    pub plans: Vec<PlanRecord>,
}
