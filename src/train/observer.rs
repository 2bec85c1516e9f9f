//! An observer is told of a training run as it goes.

use super::record::{LossSample, SignalPoint};
use super::state::State;
use crate::error::Result;
use crate::gpu::{Gpu, Profile};
use crate::render::Model;

/// An observer is told of the training as it goes; nothing that it does changes what is trained.
pub trait Observer {
    /// Is called before the first iteration, and whenever it has been decided anew how many there are.
    fn ends(&mut self, _iterations: u32) {}

    /// Is called after every look at the losses.
    fn look(&mut self, sample: &LossSample, n_gaussians: usize);

    /// Is told what the held-out views say, whenever they have been measured.
    fn measured(&mut self, _point: &SignalPoint) {}

    /// Says whether the iteration that makes `done` is to be timed.
    fn times(&self, _done: u32) -> bool {
        false
    }

    /// Returns what times the iteration by kernel, if anything does.
    fn profile(&mut self) -> Option<&mut Profile> {
        None
    }

    /// Is called after an iteration that is timed, once it is done on the GPU. One that has to be
    /// repeated counts when the repetition is done.
    ///
    /// # Errors
    /// End the training.
    fn timed(&mut self, _gpu: &Gpu) -> Result<()> {
        Ok(())
    }

    /// Says whether [`Observer::inspect`] is to be called after `done` iterations (0: at the
    /// start).
    fn inspects(&self, _done: u32) -> bool {
        false
    }

    /// Is shown the Gaussians after `done` iterations, before densification, pruning and opacity
    /// reset that may follow (as 3DGS reports).
    ///
    /// # Errors
    /// End the training.
    fn inspect(&mut self, _done: u32, _model: &Model) -> Result<()> {
        Ok(())
    }

    /// Says whether [`Observer::keep`] is to be called after `done` iterations.
    fn keeps(&self, _done: u32) -> bool {
        false
    }

    /// Shows the run between two iterations: its state, and the optimizer's buffers as bytes in a
    /// row, each portion read from the GPU when it is asked for.
    ///
    /// # Errors
    /// End the training.
    fn keep(
        &mut self,
        _state: &State,
        _buffers: &mut dyn Iterator<Item = Result<Vec<u8>>>,
    ) -> Result<()> {
        Ok(())
    }
}

/// Nobody is told.
impl Observer for () {
    fn look(&mut self, _: &LossSample, _: usize) {}
}
