//! Typed access to GPU buffers.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::Pod;

use super::Gpu;
use super::device::mebibytes;
use crate::error::{Error, Result};

/// Bytes that are read back at once. A whole block of a large model would take as much memory
/// beside it, asked of the system for the first time.
pub const PORTION: usize = 4 << 20;

/// Parts of a buffer that are bound as uniforms begin at multiples of so many bytes: WebGPU's default.
pub const UNIFORM_ALIGNMENT: u64 = 256;

/// Description of buffers that need not exist yet: their name, and the bytes of an entry. One
/// description makes the buffers and says what they will take.
#[derive(Clone, Copy, Debug)]
pub struct BufferKind {
    name: &'static str,
    entry_bytes: usize,
    is_uniform: bool,
}

impl BufferKind {
    /// Describes storage buffers of `T`s.
    pub const fn storage<T>(name: &'static str) -> BufferKind {
        BufferKind {
            name,
            entry_bytes: size_of::<T>(),
            is_uniform: false,
        }
    }

    /// Describes uniform buffers of one `T`.
    pub const fn uniform<T>(name: &'static str) -> BufferKind {
        BufferKind {
            name,
            entry_bytes: size_of::<T>(),
            is_uniform: true,
        }
    }

    /// Returns the name, which is that of the variable in the shaders.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Returns true for uniform buffers, false for storage buffers.
    pub fn is_uniform(&self) -> bool {
        self.is_uniform
    }

    /// Allocates a buffer for `len` entries, all zero. Storage buffers have room for one entry and
    /// 16 bytes at least, so that they can be bound.
    ///
    /// # Errors
    /// The buffer takes more bytes than the adapter can bind at once, or memory runs out: names the
    /// numbers.
    pub fn allocate(&self, gpu: &Gpu, len: usize) -> Result<Buffer> {
        let (label, size) = (self.name, self.entry_bytes);
        if self.is_uniform {
            let usage = wgpu::BufferUsages::UNIFORM;
            return Ok(Buffer::create(gpu, label, self.bytes(len), usage));
        }
        let bytes = (len as u64).checked_mul(size as u64);
        if bytes.is_none_or(|bytes| bytes > gpu.max_binding()) {
            return Err(Error::new(format!(
                "buffer `{label}` needs {len} x {size} bytes, the adapter binds at most {}",
                gpu.max_binding()
            ))
            .at(&gpu.info.name)
            .way_out("use fewer Gaussians (`--max-points`) or smaller images (`--max-size`)"));
        }
        let usage = wgpu::BufferUsages::STORAGE;
        Buffer::create(gpu, label, self.bytes(len), usage).held(gpu, label)
    }

    /// Returns the bytes of a buffer for `len` entries, did the adapter hold them.
    pub fn bytes(&self, len: usize) -> u64 {
        let bytes = (len as u64).saturating_mul(self.entry_bytes as u64);
        match self.is_uniform {
            true => bytes,
            // Kernels that read entries of this size bind no less than one.
            false => least(bytes.max(self.entry_bytes as u64)),
        }
    }
}

/// A storage or uniform buffer, zero at first; its bytes count towards [`Gpu::peak_bytes`]. It may be a part of
/// another one, which then counts them.
pub struct Buffer {
    pub(super) raw: wgpu::Buffer,
    /// First byte in `raw`.
    first: u64,
    bytes: u64,
    /// The counter of these bytes; `None` for a part.
    allocated: Option<Arc<AtomicU64>>,
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if let Some(allocated) = &self.allocated {
            allocated.fetch_sub(self.bytes, Ordering::Relaxed);
        }
    }
}

impl Buffer {
    /// Allocates a storage buffer for `len` values of `T`; at least 16 bytes, so that it can be
    /// bound.
    ///
    /// # Errors
    /// As [`BufferKind::allocate`].
    pub fn storage<T: Pod>(gpu: &Gpu, label: &'static str, len: usize) -> Result<Buffer> {
        BufferKind::storage::<T>(label).allocate(gpu, len)
    }

    /// Allocates a storage buffer that holds `data`.
    ///
    /// # Errors
    /// As [`BufferKind::allocate`].
    pub fn storage_from<T: Pod>(gpu: &Gpu, label: &'static str, data: &[T]) -> Result<Buffer> {
        let buffer = Self::storage::<T>(gpu, label, data.len())?;
        buffer.write(gpu, data);
        Ok(buffer)
    }

    /// Allocates a uniform buffer for one `T`.
    pub fn uniform<T: Pod>(gpu: &Gpu, label: &str) -> Buffer {
        Self::create(
            gpu,
            label,
            size_of::<T>() as u64,
            wgpu::BufferUsages::UNIFORM,
        )
    }

    /// Allocates a buffer of `bytes` bytes whose parts are uniforms.
    pub fn uniforms(gpu: &Gpu, bytes: u64) -> Buffer {
        Self::create(gpu, "uniforms", bytes, wgpu::BufferUsages::UNIFORM)
    }

    /// Allocates a uniform buffer that holds `value`.
    pub fn uniform_from<T: Pod>(gpu: &Gpu, label: &str, value: &T) -> Buffer {
        let buffer = Self::uniform::<T>(gpu, label);
        buffer.write(gpu, std::slice::from_ref(value));
        buffer
    }

    /// Allocates a storage buffer of `bytes` zero bytes, few enough to be bound anywhere.
    pub(super) fn zeros(gpu: &Gpu, bytes: u64) -> Buffer {
        Self::create(gpu, "zeros", bytes, wgpu::BufferUsages::STORAGE)
    }

    /// Allocates a buffer of `bytes` bytes that queries resolve into.
    pub(super) fn query_resolve(gpu: &Gpu, bytes: u64) -> Buffer {
        Self::create(gpu, "timestamps", bytes, wgpu::BufferUsages::QUERY_RESOLVE)
    }

    /// Allocates a buffer of `bytes` bytes that the host reads.
    fn readback(gpu: &Gpu, bytes: u64) -> Result<Buffer> {
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        Self::counted(gpu, "readback", bytes, usage).held(gpu, "readback")
    }

    /// Returns the buffer if there was memory for it. It is checked at once, because an unusable
    /// buffer brings other faults that hide this one.
    fn held(self, gpu: &Gpu, label: &str) -> Result<Buffer> {
        gpu.check_memory()
            .map_err(|e| e.at(format!("buffer `{label}` of {}", mebibytes(self.bytes))))?;
        Ok(self)
    }

    fn create(gpu: &Gpu, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Buffer {
        let copied = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        Self::counted(gpu, label, bytes, usage | copied)
    }

    fn counted(gpu: &Gpu, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Buffer {
        let raw = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes,
            usage,
            mapped_at_creation: false,
        });
        gpu.count(bytes);
        Buffer {
            raw,
            first: 0,
            bytes,
            allocated: Some(Arc::clone(&gpu.allocated)),
        }
    }

    /// Returns the part of `bytes` bytes from byte `first` on, a multiple of [`UNIFORM_ALIGNMENT`] for
    /// uniforms.
    pub fn part(&self, first: u64, bytes: u64) -> Buffer {
        Buffer {
            raw: self.raw.clone(),
            first: self.first + first,
            bytes,
            allocated: None,
        }
    }

    /// Returns all of it as a part, which does not count its bytes again.
    pub(super) fn whole(&self) -> Buffer {
        self.part(0, self.bytes)
    }

    /// Returns what bind groups take.
    pub(super) fn binding(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.raw,
            offset: self.first,
            size: wgpu::BufferSize::new(self.bytes),
        })
    }

    pub(super) fn encode_clear(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.clear_buffer(&self.raw, self.first, Some(self.bytes));
    }

    pub(super) fn encode_copy(&self, encoder: &mut wgpu::CommandEncoder, to: &Buffer) {
        encoder.copy_buffer_to_buffer(&self.raw, self.first, &to.raw, to.first, self.bytes);
    }

    /// Returns the first byte in the buffer that it is a part of; 0 for one of its own.
    pub fn first(&self) -> u64 {
        self.first
    }

    /// Returns the size, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Queues a write of `data` to the buffer's start, before the next submission.
    pub fn write<T: Pod>(&self, gpu: &Gpu, data: &[T]) {
        gpu.asked.write();
        let data = bytemuck::cast_slice(data);
        gpu.queue.write_buffer(&self.raw, self.first, data);
    }

    /// Waits for the GPU and reads the first `len` values of `T`.
    ///
    /// # Errors
    /// A GPU fault, or no memory to read into.
    pub fn read<T: Pod>(&self, gpu: &Gpu, len: usize) -> Result<Vec<T>> {
        let mut values = vec![T::zeroed(); len];
        self.read_into(gpu, 0, bytemuck::cast_slice_mut(&mut values))?;
        Ok(values)
    }

    /// Waits for the GPU and reads the bytes from byte `first` on, a multiple of 4, that fill
    /// `out`.
    ///
    /// # Errors
    /// A GPU fault, or no memory to read into.
    pub fn read_into(&self, gpu: &Gpu, first: u64, out: &mut [u8]) -> Result<()> {
        if out.is_empty() {
            return Ok(());
        }
        let unreadable = |e: &dyn std::fmt::Display| {
            Error::new(format!("cannot read a buffer back: {e}")).at(&gpu.info.name)
        };
        let staging = Self::readback(gpu, Self::readback_bytes(out.len() as u64))?;
        let staging = &staging.raw;
        let mut first = self.first + first;
        for portion in out.chunks_mut(PORTION) {
            let bytes = (portion.len() as u64).next_multiple_of(4);
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&self.raw, first, staging, 0, bytes);
            gpu.queue.submit([encoder.finish()]);
            let (sender, receiver) = std::sync::mpsc::channel();
            staging.map_async(wgpu::MapMode::Read, ..bytes, move |mapped| {
                // The receiver lives until this has been called, or the wait below has failed.
                let _ = sender.send(mapped);
            });
            gpu.wait()?;
            receiver
                .recv()
                .map_err(|e| unreadable(&e))?
                .map_err(|e| unreadable(&e))?;
            let view = staging
                .get_mapped_range(..bytes)
                .map_err(|e| unreadable(&e))?;
            portion.copy_from_slice(&view[..portion.len()]);
            drop(view);
            staging.unmap();
            first += bytes;
        }
        Ok(())
    }

    /// Returns the bytes that are held beside a buffer while `bytes` bytes of it are read.
    pub fn readback_bytes(bytes: u64) -> u64 {
        bytes.next_multiple_of(4).min(PORTION as u64)
    }
}

/// Returns what a buffer of `bytes` bytes takes at least, to be bound and copied.
fn least(bytes: u64) -> u64 {
    bytes.max(16).next_multiple_of(4)
}
