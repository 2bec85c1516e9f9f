//! An observer that keeps the state of a training on the way, and what tells two trainings apart.

use gspotential::error::Result;
use gspotential::train::{LossSample, Observer, State, Trained};

/// Keeps the state after some iterations.
pub(crate) struct Keep {
    at: u32,
    pub(crate) kept: Option<(State, Vec<Vec<u8>>)>,
    /// How many iterations there were to be, whenever that was decided.
    pub(crate) lengths: Vec<u32>,
}

impl Keep {
    pub(crate) fn at(at: u32) -> Keep {
        Keep {
            at,
            kept: None,
            lengths: Vec::new(),
        }
    }
}

impl Observer for Keep {
    fn ends(&mut self, iterations: u32) {
        self.lengths.push(iterations);
    }

    fn look(&mut self, _: &LossSample, _: usize) {}

    fn keeps(&self, done: u32) -> bool {
        done == self.at
    }

    fn keep(
        &mut self,
        state: &State,
        buffers: &mut dyn Iterator<Item = Result<Vec<u8>>>,
    ) -> Result<()> {
        self.kept = Some((state.clone(), buffers.collect::<Result<_>>()?));
        Ok(())
    }
}

/// Whether two trainings ended in the same, to the bit.
pub(crate) fn same(one: &Trained, other: &Trained) -> bool {
    one.gaussians == other.gaussians
        && one.samples == other.samples
        && one.plans == other.plans
        && one.signal == other.signal
        && one.trims == other.trims
        && one.iterations == other.iterations
}
