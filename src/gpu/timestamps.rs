//! GPU time of every dispatch, by timestamp queries.

use std::collections::BTreeMap;

use super::{Buffer, Gpu};
use crate::error::Result;

/// Dispatches that one profile can hold.
const MAX_DISPATCHES: u32 = 1024;

/// GPU time of one kernel's dispatches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KernelTime {
    /// Sum over the dispatches, by timestamps.
    pub seconds: f64,
    /// Dispatches in the sum.
    pub dispatches: u32,
}

/// Collects timestamps around the dispatches of one submission.
pub struct Profile {
    queries: wgpu::QuerySet,
    resolved: Buffer,
    names: Vec<&'static str>,
}

impl Profile {
    /// Makes an empty profile; `None` if the adapter has no timestamps.
    pub fn new(gpu: &Gpu) -> Option<Profile> {
        if !gpu
            .device
            .features()
            .contains(wgpu::Features::TIMESTAMP_QUERY)
        {
            return None;
        }
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("profile"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * MAX_DISPATCHES,
        });
        let resolved = Buffer::query_resolve(gpu, u64::from(2 * MAX_DISPATCHES) * 8);
        Some(Profile {
            queries,
            resolved,
            names: Vec::new(),
        })
    }

    /// Returns the timestamps for the next dispatch; `None` once the profile is full.
    pub(super) fn next(
        &mut self,
        name: &'static str,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let index = self.names.len() as u32;
        if index == MAX_DISPATCHES {
            return None;
        }
        self.names.push(name);
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * index),
            end_of_pass_write_index: Some(2 * index + 1),
        })
    }

    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        let n = 2 * self.names.len() as u32;
        if n > 0 {
            encoder.resolve_query_set(&self.queries, 0..n, &self.resolved.raw, 0);
        }
    }

    /// Forgets what was submitted since the last [`Profile::take`].
    pub fn clear(&mut self) {
        self.names.clear();
    }

    /// Waits for the GPU and returns times by kernel, summed over its dispatches since the last
    /// call. These belong to one submission: a second one would have taken the first one's place.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn take(&mut self, gpu: &Gpu) -> Result<BTreeMap<&'static str, KernelTime>> {
        let times: Vec<u64> = self.resolved.read(gpu, 2 * self.names.len())?;
        let period = f64::from(gpu.queue.get_timestamp_period()) * 1e-9;
        let mut kernels = BTreeMap::<_, KernelTime>::new();
        for (name, pair) in self.names.drain(..).zip(times.chunks_exact(2)) {
            let kernel = kernels.entry(name).or_default();
            kernel.seconds += pair[1].saturating_sub(pair[0]) as f64 * period;
            kernel.dispatches += 1;
        }
        Ok(kernels)
    }
}
