//! The adapter's properties, and its limits beside what the kernels need.

use serde::Serialize;

use crate::gpu::Gpu;
use crate::gpu::constants::LOSS_GROUP;
use crate::render::most_gaussians;

/// Most storage buffers that a kernel binds, no more than WebGPU promises everywhere.
pub const STORAGE_BUFFERS: u32 = 8;
/// Most uniform buffers that a kernel binds.
pub const UNIFORM_BUFFERS: u32 = 2;
/// Most bytes that a workgroup shares (`ssim_workgroup`).
pub const WORKGROUP_BYTES: u32 = 16240;

/// The adapter and its limits.
#[derive(Clone, Debug, Serialize)]
pub struct Adapter {
    /// Name, as the driver gives it.
    pub name: String,
    /// The driver's name and version.
    pub driver: String,
    /// Graphics API, as wgpu names it: `vulkan`, `metal`, `dx12`.
    pub backend: String,
    /// Kind of device, as wgpu names it: `DiscreteGpu`, `IntegratedGpu`, `Cpu`.
    pub kind: String,
    /// Limits that a kernel could exceed.
    pub limits: Vec<Limit>,
    /// Largest buffer that a kernel can bind, bytes.
    pub max_binding_bytes: u64,
    /// Largest buffer, bytes.
    pub max_buffer_bytes: u64,
    /// Gaussians of SH degree 3 that a binding holds.
    pub most_gaussians: usize,
    /// (tile, Gaussian) pairs of a view that a binding holds.
    pub most_pairs: u64,
    /// Whether there are timestamps; without them times are wall-clock time.
    pub timestamps: bool,
    /// Threads of the smallest and of the largest subgroup; `None` without subgroups. Not used.
    pub subgroups: Option<[u32; 2]>,
    /// Whether shaders can use half floats; not used.
    pub half_floats: bool,
}

/// A limit that a kernel could exceed.
#[derive(Clone, Debug, Serialize)]
pub struct Limit {
    /// Quantity that is limited, with its unit, as the report writes it.
    pub name: &'static str,
    /// The adapter's limit.
    pub adapter: u32,
    /// The most that a kernel needs.
    pub needed: u32,
}

impl Limit {
    /// Returns whether every kernel keeps within the limit.
    pub fn holds(&self) -> bool {
        self.adapter >= self.needed
    }
}

impl Adapter {
    /// Reads properties and limits of an opened adapter.
    pub fn of(gpu: &Gpu) -> Adapter {
        let (info, limits) = (&gpu.info, &gpu.adapter_limits);
        let limit = |name, adapter, needed| Limit {
            name,
            adapter,
            needed,
        };
        let has = |feature| gpu.features.contains(feature);
        let sizes = [info.subgroup_min_size, info.subgroup_max_size];
        Adapter {
            name: info.name.clone(),
            driver: [info.driver.as_str(), &info.driver_info]
                .join(" ")
                .trim()
                .to_owned(),
            backend: info.backend.to_string(),
            kind: format!("{:?}", info.device_type),
            limits: vec![
                limit(
                    "threads a workgroup",
                    limits
                        .max_compute_invocations_per_workgroup
                        .min(limits.max_compute_workgroup_size_x),
                    LOSS_GROUP,
                ),
                limit(
                    "workgroup memory, bytes",
                    limits.max_compute_workgroup_storage_size,
                    WORKGROUP_BYTES,
                ),
                limit(
                    "storage buffers a kernel",
                    limits.max_storage_buffers_per_shader_stage,
                    STORAGE_BUFFERS,
                ),
                limit(
                    "uniform buffers a kernel",
                    limits.max_uniform_buffers_per_shader_stage,
                    UNIFORM_BUFFERS,
                ),
                limit(
                    "workgroups a dimension",
                    limits.max_compute_workgroups_per_dimension,
                    1,
                ),
            ],
            max_binding_bytes: gpu.max_binding(),
            max_buffer_bytes: limits.max_buffer_size,
            most_gaussians: most_gaussians(gpu, 3),
            most_pairs: gpu.max_binding() / 16,
            timestamps: has(wgpu::Features::TIMESTAMP_QUERY),
            subgroups: has(wgpu::Features::SUBGROUP).then_some(sizes),
            half_floats: has(wgpu::Features::SHADER_F16),
        }
    }
}
