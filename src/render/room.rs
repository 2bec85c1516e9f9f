//! Room for a step, and what happens without it: the GPU finds that pairs or a tile's list do not
//! fit, every later stage of this and of the following steps does nothing, and the host makes room
//! and takes the step again.

use super::capacity::{Capacity, most_pairs};
use super::workspace::Workspace;
use crate::error::{Error, Result};
use crate::gpu::constants::{
    LIST_SLICE, N_TOTALS, TOTAL_LONGEST, TOTAL_MAX, TOTAL_OVERFLOW, TOTAL_PAIRS,
};
use crate::gpu::{Gpu, Rasterizer};

/// Counts that the GPU keeps.
#[derive(Clone, Copy, Debug)]
pub struct Totals {
    /// (tile, Gaussian) pairs of the last view.
    pub pairs: usize,
    /// Most pairs of any view since the workspace was made.
    pub max: usize,
    /// The longest list of those that the workspace's slices do not cover; 0: none.
    pub longest: usize,
    /// Number of the first step whose pairs or lists did not fit; 0: none.
    pub overflow_step: u32,
    /// Room that the workspace had.
    capacity: Capacity,
    /// Whether it has room for the pairs' gradients.
    trains: bool,
}

/// Waits for the GPU and reads its counts.
///
/// # Errors
/// A GPU fault.
pub fn read_totals(gpu: &Gpu, workspace: &Workspace) -> Result<Totals> {
    let totals: Vec<u32> = workspace.buffer("totals").read(gpu, N_TOTALS as usize)?;
    let total = |slot: u32| totals[slot as usize] as usize;
    Ok(Totals {
        pairs: total(TOTAL_PAIRS),
        max: total(TOTAL_MAX),
        longest: total(TOTAL_LONGEST),
        overflow_step: totals[TOTAL_OVERFLOW as usize],
        capacity: workspace.capacity,
        trains: workspace.trains,
    })
}

impl Totals {
    /// Returns the room that the step needs, half as much again as it asked for so that the next
    /// ones fit, too; `None` if it had room.
    ///
    /// # Errors
    /// There are more pairs than can be counted or bound, or the driver reports an overflow of what fits.
    pub fn room(&self, gpu: &Gpu) -> Result<Option<Capacity>> {
        if self.overflow_step == 0 {
            return Ok(None);
        }
        match self.wanted(gpu)? {
            room if room == self.capacity => Err(unexplained(gpu)),
            room => Ok(Some(room)),
        }
    }

    /// Returns the room that each of two workspaces needs whose steps go together, at least one of them more than it
    /// has; `None` if both had room.
    ///
    /// # Errors
    /// As [`Totals::room`].
    pub fn rooms(both: [&Totals; 2], gpu: &Gpu) -> Result<Option<[Capacity; 2]>> {
        if both.iter().all(|totals| totals.overflow_step == 0) {
            return Ok(None);
        }
        let rooms = [both[0].wanted(gpu)?, both[1].wanted(gpu)?];
        match rooms == both.map(|totals| totals.capacity) {
            true => Err(unexplained(gpu)),
            false => Ok(Some(rooms)),
        }
    }

    /// Returns the room that the views asked for, where that is more than there is.
    fn wanted(&self, gpu: &Gpu) -> Result<Capacity> {
        let capacity = self.capacity;
        if self.max == u32::MAX as usize {
            return Err(
                Error::new("a view has more than 2^32 (tile, Gaussian) pairs").way_out(
                    "use fewer or smaller Gaussians (`--max-points`) or smaller images (`--max-size`)",
                ),
            );
        }
        // Without gradients, a pair's largest entry is one of the sort.
        let most = most_pairs(gpu) * if self.trains { 1 } else { 2 };
        if self.max > most {
            let larger = match capacity.rasterizer {
                Rasterizer::Thread => "larger tiles (`--set render.rasterizer=workgroup`), ",
                Rasterizer::Workgroup => "",
            };
            let what = format!(
                "a view has {} (tile, Gaussian) pairs, and the adapter binds {most} at once",
                self.max
            );
            return Err(Error::new(what).at(&gpu.info.name).way_out(format!(
                "use {larger}fewer or smaller Gaussians (`--max-points`, `--set densify.max_gaussians=N`) or smaller \
                 images (`--max-size`)"
            )));
        }
        let mut room = capacity;
        if self.max > capacity.pairs {
            room = room.with_pairs(gpu, self.max);
        }
        if (1..=self.max).contains(&self.longest) {
            let slices = (self.longest + self.longest / 2).div_ceil(LIST_SLICE as usize);
            room.slices = room.slices.max(slices);
        }
        Ok(room)
    }
}

fn unexplained(gpu: &Gpu) -> Error {
    let what = "the GPU reports that a step did not fit, and counts that cannot be";
    Error::new(what)
        .at(&gpu.info.name)
        .way_out("run `gspotential doctor`")
}

/// Attempts at most. A view that fits at all has been given the room that it needs by then: the
/// pairs are counted in the first, the lists in the second.
const MOST_ATTEMPTS: usize = 8;

/// Makes `attempt` with room for what is `needed`, and again with more until its pairs and lists
/// fit. An attempt makes the room, submits, and reads the counts.
///
/// # Errors
/// What the attempts and [`Totals::room`] return, or a view that finds no room.
pub fn until_it_fits(
    gpu: &Gpu,
    mut needed: Capacity,
    mut attempt: impl FnMut(Capacity) -> Result<Totals>,
) -> Result<()> {
    for _ in 0..MOST_ATTEMPTS {
        match attempt(needed)?.room(gpu)? {
            None => return Ok(()),
            Some(room) => needed = room,
        }
    }
    let what = format!("a view has not fitted in {MOST_ATTEMPTS} attempts, each with more room");
    Err(Error::new(what)
        .at(&gpu.info.name)
        .way_out("run `gspotential doctor`"))
}

impl Capacity {
    /// Returns the same with room for half as many pairs again as `pairs`, as far as the adapter
    /// goes.
    pub fn with_pairs(self, gpu: &Gpu, pairs: usize) -> Capacity {
        let wanted = (pairs + pairs / 2).min(most_pairs(gpu)).max(pairs);
        Capacity {
            pairs: self.pairs.max(wanted),
            ..self
        }
    }
}
