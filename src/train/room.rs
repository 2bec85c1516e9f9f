//! This module makes room on the GPU for what training holds: its buffers grow with the pairs of a view
//! and with the model.

use super::trainer::Trainer;
use crate::error::Result;
use crate::render::{Bound, Capacity, Workspace, read_totals};

impl Trainer<'_> {
    /// Returns the number of (tile, Gaussian) pairs that the buffers have room for. A step that has
    /// more is repeated with larger buffers.
    pub fn pair_capacity(&self) -> usize {
        self.workspace.capacity.pairs
    }

    /// Makes room for half as many pairs again as `pairs`.
    ///
    /// # Errors
    /// A request that the adapter cannot hold.
    pub fn reserve_pairs(&mut self, pairs: usize) -> Result<()> {
        self.grow(self.workspace.capacity.with_pairs(self.gpu, pairs))
    }

    /// Grows the buffers if the pairs of a step or a tile's list did not fit, and returns that
    /// step's iteration (from 0): nothing has changed since, so that it and those after it are to
    /// be taken again.
    ///
    /// # Errors
    /// More pairs than the adapter can bind, or a GPU fault.
    pub fn make_room(&mut self) -> Result<Option<u32>> {
        let totals = read_totals(self.gpu, &self.workspace)?;
        if self.partner.is_some() {
            return self.make_room_for_both(&totals);
        }
        let Some(room) = totals.room(self.gpu)? else {
            return Ok(None);
        };
        self.grow(room)?;
        Ok(Some(totals.overflow_step - 1))
    }

    /// Follows a model that has changed.
    pub(super) fn fit_model(&mut self) -> Result<()> {
        if self.optimizer.model.stride > self.workspace.capacity.stride {
            return self.grow(self.workspace.capacity);
        }
        self.rebind()
    }

    /// Makes room for the model and for `capacity`.
    pub(super) fn grow(&mut self, mut capacity: Capacity) -> Result<()> {
        capacity.stride = capacity.stride.max(self.optimizer.model.stride);
        // The old buffers are free before the new ones are made.
        self.unbind();
        self.workspace = Workspace::new(self.gpu, Capacity::default(), true)?;
        self.gpu.wait()?;
        self.workspace = Workspace::new(self.gpu, capacity, true)?;
        self.rebind()
    }

    /// Drops the bind groups, which keep their buffers' memory.
    pub(super) fn unbind(&mut self) {
        self.bound = Bound::default();
        self.adam.clear();
        if let Some(refinement) = &mut self.refinement {
            refinement.gradient = None;
        }
        if let Some(partner) = &mut self.partner {
            partner.exchange = None;
        }
        if let Some(depths) = &mut self.depths {
            depths.pass = None;
        }
    }

    fn rebind(&mut self) -> Result<()> {
        self.bound = Bound::new(
            self.gpu,
            self.kernels,
            &self.workspace,
            &self.optimizer.model,
        );
        self.adam = self
            .optimizer
            .bind(self.gpu, &self.optimizer_kernels, &self.workspace);
        if let Some(refinement) = &mut self.refinement {
            refinement.rebind(self.gpu, &self.workspace, &self.optimizer.model)?;
        }
        self.rebind_exchange();
        if let Some(depths) = &mut self.depths {
            let of = (&self.workspace, &self.optimizer.model);
            depths.rebind(self.gpu, of, &self.real)?;
        }
        Ok(())
    }
}
