//! This module keeps target images on the GPU, so that a step neither unpacks nor uploads them.

use std::borrow::Cow;

use super::uniforms::ViewUniform;
use crate::error::Result;
use crate::gpu::{Buffer, BufferKind, Gpu};

/// MiB of target images that stay on a GPU unless the config says how many: 280 of 1600x1067 fit.
const TARGETS_MIB: u32 = 2048;

/// Four texels a vector, rows as in a plane of `rendered`, without the rows of padding.
const TARGET: BufferKind = BufferKind::storage::<[u32; 4]>("target");

/// Target images on the GPU, of as many views as there is room for.
#[derive(Default)]
pub struct Targets {
    kept: Vec<Buffer>,
}

impl Targets {
    /// Returns the bytes that may be taken: what the config asks for, in MiB, or else what suits the
    /// adapter. A driver that runs on a CPU has the packed images in the same memory, and renders much
    /// longer than it unpacks.
    pub fn budget(asked_mib: Option<u32>, gpu: &Gpu) -> u64 {
        let by_rule = match gpu.info.device_type {
            wgpu::DeviceType::Cpu => 0,
            _ => TARGETS_MIB,
        };
        u64::from(asked_mib.unwrap_or(by_rule)) << 20
    }

    /// Returns the bytes that [`Targets::upload`] will take.
    pub fn bytes(views: &[ViewUniform], budget: u64) -> u64 {
        views[..n_kept(views, budget)].iter().map(bytes).sum()
    }

    /// Uploads the first of `views` until `budget` bytes are taken; `texels` unpacks the target image
    /// of one, RGBA8, `[height][width]`.
    ///
    /// # Errors
    /// An image is larger than the adapter can bind, or memory runs out.
    pub fn upload(
        gpu: &Gpu,
        views: &[ViewUniform],
        budget: u64,
        mut texels: impl FnMut(usize, &mut Vec<u32>),
    ) -> Result<Targets> {
        let mut image = Vec::new();
        let mut targets = Targets::default();
        for (k, view) in views[..n_kept(views, budget)].iter().enumerate() {
            texels(k, &mut image);
            let target = TARGET.allocate(gpu, n_vectors(view))?;
            target.write(gpu, &padded(view, &image));
            targets.kept.push(target);
            // What is written waits in the host's memory until something is submitted.
            gpu.queue.submit([]);
            gpu.wait()?;
        }
        Ok(targets)
    }

    /// Returns the image of view `k`, if it is one of those that are kept.
    pub fn get(&self, k: usize) -> Option<&Buffer> {
        self.kept.get(k)
    }
}

/// Returns how many of `views`, from the first on, have room in `budget` bytes.
fn n_kept(views: &[ViewUniform], budget: u64) -> usize {
    let mut left = budget;
    let fits = |view: &&ViewUniform| match left.checked_sub(bytes(view)) {
        Some(rest) => {
            left = rest;
            true
        }
        None => false,
    };
    views.iter().take_while(fits).count()
}

fn bytes(view: &ViewUniform) -> u64 {
    TARGET.bytes(n_vectors(view))
}

fn n_vectors(view: &ViewUniform) -> usize {
    view.padded_size().0 * view.size[1] as usize
}

/// Returns an image with its rows padded to whole vectors.
pub(super) fn padded<'a>(view: &ViewUniform, texels: &'a [u32]) -> Cow<'a, [u32]> {
    let width = view.size[0] as usize;
    let padded_width = 4 * view.padded_size().0;
    if width == padded_width {
        return Cow::Borrowed(texels);
    }
    let mut rows = vec![0; texels.len() / width * padded_width];
    let to = rows.chunks_exact_mut(padded_width);
    for (to, from) in to.zip(texels.chunks_exact(width)) {
        to[..width].copy_from_slice(from);
    }
    Cow::Owned(rows)
}
