//! Kernels: a compute pipeline whose bind group layout is read off the shader by naga, so that no
//! second list of bindings exists, and the commands that dispatch them.

use super::constants::WORKGROUP;
use super::{Buffer, Gpu, Profile};

/// One entry point of one stage.
pub struct Kernel {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// (name, binding) of every variable that the entry point uses.
    bindings: Vec<(String, u32)>,
}

impl Kernel {
    /// Checks a stage and compiles its one kernel: [`Stage::new`] and [`Stage::kernel`] in a row.
    ///
    /// # Panics
    /// If the shader does not validate: a fault in this program; the message is naga's.
    pub fn from_source(gpu: &Gpu, stage: &str, entry: &'static str, source: String) -> Kernel {
        Stage::new(gpu, stage, source).kernel(gpu, entry)
    }

    /// Binds buffers by the names of the shader's variables; names that this entry point does not
    /// use are passed over, so that a stage's entry points can share one list.
    ///
    /// # Panics
    /// If a variable is left without a buffer: a fault in this program.
    pub fn bind(&self, gpu: &Gpu, buffers: &[(&str, &Buffer)]) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry<'_>> = self
            .bindings
            .iter()
            .map(|(name, binding)| {
                let buffer = buffers.iter().find(|(n, _)| n == name);
                let (_, buffer) =
                    buffer.unwrap_or_else(|| panic!("{}: nothing bound to `{name}`", self.name));
                wgpu::BindGroupEntry {
                    binding: *binding,
                    resource: buffer.raw.as_entire_binding(),
                }
            })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.name),
            layout: &self.layout,
            entries: &entries,
        })
    }
}

/// A stage's source, checked once for all its entry points.
pub struct Stage {
    name: String,
    module: naga::Module,
    info: naga::valid::ModuleInfo,
    shader: wgpu::ShaderModule,
}

impl Stage {
    /// Checks a complete WGSL `source`; `name` is for messages.
    ///
    /// # Panics
    /// If the shader does not validate: a fault in this program; the message is naga's.
    pub fn new(gpu: &Gpu, name: &str, source: String) -> Stage {
        let module = naga::front::wgsl::parse_str(&source)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&source, name)));
        let flags = naga::valid::ValidationFlags::all();
        let capabilities = naga::valid::Capabilities::empty();
        let info = naga::valid::Validator::new(flags, capabilities)
            .validate(&module)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&source, name)));
        let shader = gpu
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
        Stage {
            name: name.to_owned(),
            module,
            info,
            shader,
        }
    }

    /// Compiles entry point `entry`.
    ///
    /// # Panics
    /// If there is none of that name: a fault in this program.
    pub fn kernel(&self, gpu: &Gpu, entry: &'static str) -> Kernel {
        let Stage {
            name: stage,
            module,
            info,
            shader,
        } = self;
        let point = module
            .entry_points
            .iter()
            .position(|point| point.name == entry)
            .unwrap_or_else(|| panic!("{stage}: no entry point named {entry}"));
        let uses = info.get_entry_point(point);

        let mut bindings = Vec::new();
        let mut entries = Vec::new();
        for (handle, variable) in module.global_variables.iter() {
            let Some(binding) = &variable.binding else {
                continue;
            };
            if uses[handle].is_empty() {
                continue;
            }
            let ty = match variable.space {
                naga::AddressSpace::Uniform => wgpu::BufferBindingType::Uniform,
                naga::AddressSpace::Storage { access } => wgpu::BufferBindingType::Storage {
                    read_only: !access.contains(naga::StorageAccess::STORE),
                },
                other => panic!("{stage}: binding in unexpected address space {other:?}"),
            };
            entries.push(wgpu::BindGroupLayoutEntry {
                binding: binding.binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            });
            bindings.push((variable.name.clone().unwrap_or_default(), binding.binding));
        }
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(entry),
                entries: &entries,
            });
        let pipeline_layout = gpu
            .device
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(entry),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
        let pipeline = gpu
            .device
            .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&pipeline_layout),
                module: shader,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                cache: None,
            });
        Kernel {
            name: entry,
            pipeline,
            layout,
            bindings,
        }
    }
}

/// Calls `make` with the SH degrees 0 to 3, side by side.
pub fn by_degree<T: Send>(make: impl Fn(u32) -> T + Sync) -> [T; 4] {
    let ((zero, one), (two, three)) = rayon::join(
        || rayon::join(|| make(0), || make(1)),
        || rayon::join(|| make(2), || make(3)),
    );
    [zero, one, two, three]
}

/// Commands recorded for one submission.
pub struct Commands<'a> {
    gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
    profile: Option<&'a mut Profile>,
}

impl<'a> Commands<'a> {
    /// Starts an empty list of commands, without timestamps.
    pub fn new(gpu: &'a Gpu) -> Commands<'a> {
        Self::profiled(gpu, None)
    }

    /// Starts an empty list of commands; given a profile, takes the time of every dispatch.
    pub fn profiled(gpu: &'a Gpu, profile: Option<&'a mut Profile>) -> Commands<'a> {
        let encoder = gpu.device.create_command_encoder(&Default::default());
        Commands {
            gpu,
            encoder,
            profile,
        }
    }

    /// Dispatches at least `n_threads` threads, folded into two dimensions.
    pub fn dispatch(&mut self, kernel: &Kernel, group: &wgpu::BindGroup, n_threads: u64) {
        let n_groups = n_threads.div_ceil(u64::from(WORKGROUP));
        if n_groups == 0 {
            return;
        }
        let (x, y) = fold(
            n_groups,
            self.gpu.limits.max_compute_workgroups_per_dimension,
        );
        let mut pass = self
            .encoder
            .begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(kernel.name),
                timestamp_writes: self.profile.as_mut().and_then(|p| p.next(kernel.name)),
            });
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(x, y, 1);
    }

    /// Sets a whole buffer to zero.
    pub fn clear(&mut self, buffer: &Buffer) {
        self.encoder.clear_buffer(&buffer.raw, 0, None);
    }

    /// Submits the commands, without a wait. Given a profile, also reads its timestamps out on the
    /// GPU.
    pub fn submit(mut self) {
        if let Some(profile) = &self.profile {
            profile.resolve(&mut self.encoder);
        }
        self.gpu.queue.submit([self.encoder.finish()]);
    }
}

/// Returns `n` workgroups, at least 1, as columns and rows of which neither exceeds `limit`; fewer
/// of them are idle than there are rows.
pub fn fold(n: u64, limit: u32) -> (u32, u32) {
    let rows = n.div_ceil(u64::from(limit));
    let columns = n.div_ceil(rows);
    (columns as u32, rows as u32)
}
