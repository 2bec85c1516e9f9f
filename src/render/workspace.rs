//! The buffers of one view in flight.

use bytemuck::Pod;

use super::buffers::{BUFFERS, N_SLOTS, Places, n_depth_passes};
use super::capacity::{Capacity, check_loops};
use super::model::Model;
use super::targets::padded;
use super::uniforms::{BinUniform, RadixUniform, SliceUniform, ViewUniform};
use crate::error::Result;
use crate::gpu::constants::LIST_SLICE;
use crate::gpu::{Buffer, Commands, Gpu, shader_count};

/// The buffers of one view in flight, shared by a step's views, one after the other.
pub struct Workspace {
    /// The room that the buffers have.
    pub capacity: Capacity,
    /// Whether the buffers of the backward are there.
    pub(super) trains: bool,
    /// The copies of each of [`BUFFERS`], in its order; uniforms are parts of `uniforms`.
    buffers: Vec<Vec<Buffer>>,
    uniforms: Buffer,
    /// Bytes of `uniforms` that one view of a step has for its own.
    bytes_a_view: u64,
}

/// The uniforms of one view of a step, put together on the host and written at once.
pub(super) struct ViewBlock<'a> {
    space: &'a Workspace,
    slot: usize,
    bytes: Vec<u8>,
}

impl ViewBlock<'_> {
    /// Puts the uniforms of this name that the view has.
    pub(super) fn put<T: Pod>(&mut self, name: &str, values: &[T]) {
        let all = self.space.all(name);
        let own = &all[self.slot * (all.len() / N_SLOTS)..];
        for (place, value) in own.iter().zip(values) {
            let first = (place.first() - self.first()) as usize;
            self.bytes[first..][..size_of::<T>()].copy_from_slice(bytemuck::bytes_of(value));
        }
    }

    /// Queues the write.
    pub(super) fn write(self, gpu: &Gpu) {
        let bytes = self.bytes.len() as u64;
        let place = self.space.uniforms.part(self.first(), bytes);
        place.write(gpu, &self.bytes);
    }

    /// First byte of the view's own.
    fn first(&self) -> u64 {
        self.slot as u64 * self.space.bytes_a_view
    }
}

impl Workspace {
    /// Allocates the buffers, with `training` also those of the backward.
    ///
    /// # Errors
    /// A buffer that the adapter cannot bind, or an image too large for the kernels' loops.
    pub fn new(gpu: &Gpu, capacity: Capacity, training: bool) -> Result<Workspace> {
        check_loops(&capacity)?;
        let places = Places::of(&capacity);
        let uniforms = Buffer::uniforms(gpu, places.total);
        let mut buffers = Vec::with_capacity(BUFFERS.len());
        for (described, firsts) in BUFFERS.iter().zip(&places.firsts) {
            let (len, copies) = described.size(&capacity, training);
            let copies = (0..copies).map(|copy| match firsts.get(copy) {
                Some(first) => Ok(uniforms.part(*first, described.kind.bytes(len))),
                None => described.kind.allocate(gpu, len),
            });
            buffers.push(copies.collect::<Result<Vec<Buffer>>>()?);
        }
        let workspace = Workspace {
            capacity,
            trains: training,
            buffers,
            uniforms,
            bytes_a_view: places.of_view,
        };
        workspace.write_constants(gpu);
        Ok(workspace)
    }

    /// Returns a workspace with room for `needed`: `held` if it is large enough, else one with room
    /// for what both ask for. The memory of `held` is free before more is taken.
    ///
    /// # Errors
    /// As [`Workspace::new`].
    pub fn reserved(
        gpu: &Gpu,
        held: Option<Workspace>,
        needed: Capacity,
        training: bool,
    ) -> Result<Workspace> {
        match held {
            Some(workspace) if workspace.capacity.holds(&needed) => Ok(workspace),
            Some(workspace) => {
                let capacity = workspace.capacity.union(&needed);
                drop(workspace);
                gpu.wait()?;
                Workspace::new(gpu, capacity, training)
            }
            None => Workspace::new(gpu, needed, training),
        }
    }

    /// Writes the uniforms that no view changes.
    fn write_constants(&self, gpu: &Gpu) {
        for (emits, buffer) in (0..).zip(self.all("mode")) {
            buffer.write(gpu, &[BinUniform { emits, pad: [0; 3] }]);
        }
        for (i, buffer) in self.all("slice").iter().enumerate() {
            let first = shader_count(i) * LIST_SLICE;
            buffer.write(gpu, &[SliceUniform { first, pad: [0; 3] }]);
        }
        for (i, buffer) in (0..).zip(self.all("pair_passes")) {
            let pass = RadixUniform {
                n: shader_count(self.capacity.pairs),
                pairs: 1,
                shift: i * self.capacity.rasterizer.radix().bits,
                counts_next: 0,
            };
            buffer.write(gpu, &[pass]);
        }
    }

    /// Returns all buffers of a name.
    ///
    /// # Panics
    /// If [`BUFFERS`] has no such name: a fault in this program.
    pub(super) fn all(&self, name: &str) -> &[Buffer] {
        let found = BUFFERS.iter().position(|b| b.kind.name() == name);
        &self.buffers[found.unwrap_or_else(|| panic!("no buffer `{name}`"))]
    }

    /// Returns the buffer of this name, the first if each of a step's views has one.
    ///
    /// # Panics
    /// If there is none: a fault in this program.
    pub fn buffer(&self, name: &str) -> &Buffer {
        self.of_slot(name, 0)
    }

    /// Returns the buffer of this name that belongs to one of a step's views.
    ///
    /// # Panics
    /// If there is none: a fault in this program.
    pub fn of_slot(&self, name: &str, slot: usize) -> &Buffer {
        let found = self.all(name).get(slot);
        found.unwrap_or_else(|| panic!("no buffer `{name}` {slot}"))
    }

    /// Returns the `Radix` uniforms of the passes of a slot's depth sort.
    pub(super) fn depth_passes(&self, slot: usize) -> &[Buffer] {
        let n = n_depth_passes(&self.capacity);
        &self.all("depth_passes")[slot * n..][..n]
    }

    /// Begins the uniforms of a view of a step.
    pub(super) fn view_block(&self, slot: usize) -> ViewBlock<'_> {
        ViewBlock {
            space: self,
            slot,
            bytes: vec![0; self.bytes_a_view as usize],
        }
    }

    /// Sets the target image of a slot's render of `view`: RGBA8, `[height][width]`. Nothing is
    /// done in a workspace that does not train.
    pub fn set_goal(&self, gpu: &Gpu, slot: usize, view: &ViewUniform, goal: &[u32]) {
        if !self.trains {
            return;
        }
        self.of_slot("goal", slot).write(gpu, &padded(view, goal));
    }

    /// Records that a slot's target image is one that is on the GPU already.
    pub fn copy_goal(&self, commands: &mut Commands<'_>, slot: usize, target: &Buffer) {
        if self.trains {
            commands.copy(target, self.of_slot("goal", slot));
        }
    }

    /// Waits for the GPU and returns mean L1 and mean SSIM of each of two slots; nothing in a
    /// workspace that does not train. A slot without a view in the last step holds what was there
    /// before.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read_losses(&self, gpu: &Gpu) -> Result<Vec<[f64; 2]>> {
        if !self.trains {
            return Ok(Vec::new());
        }
        let losses: Vec<[f32; 2]> = self.buffer("losses").read(gpu, 2)?;
        Ok(losses.into_iter().map(|pair| pair.map(f64::from)).collect())
    }

    /// Returns the two halves of the sort by tile.
    pub(super) fn pair_halves(&self) -> [&Buffer; 2] {
        [self.buffer("pairs"), self.buffer("pairs_swap")]
    }

    /// Returns the buffer of (tile, pair), sorted by tile, front to back within one.
    pub fn tile_pairs(&self) -> &Buffer {
        self.pair_halves()[self.all("pair_passes").len() % 2]
    }

    /// Returns (Gaussian, pair) in the same order, in the half that the sort has left.
    pub(super) fn tile_splats(&self) -> &Buffer {
        self.pair_halves()[1 - self.all("pair_passes").len() % 2]
    }

    /// Returns every storage buffer, the uniforms of a slot and the blocks of `model`, under their
    /// names in the shaders.
    pub fn names<'a>(&'a self, model: &'a Model, slot: usize) -> Vec<(&'static str, &'a Buffer)> {
        let mut names = vec![
            ("view", self.of_slot("view", slot)),
            ("loss", self.of_slot("loss", slot)),
            ("tile_pairs", self.tile_pairs()),
            ("tile_splats", self.tile_splats()),
        ];
        names.extend(model.names());
        for (described, copies) in BUFFERS.iter().zip(&self.buffers) {
            let own = copies.get(slot).or(copies.first());
            if let (Some(buffer), false) = (own, described.kind.is_uniform()) {
                names.push((described.kind.name(), buffer));
            }
        }
        names
    }
}
