//! Kernels: a compute pipeline whose bind group layout is read off the shader by naga, so that no
//! second list of bindings exists.
//!
//! A stage is checked when one of its kernels is first bound, and a pipeline is compiled when commands first
//! dispatch it: a run compiles those that it uses.

use std::sync::{Arc, OnceLock};

use super::{Buffer, Gpu};

/// One entry point of one stage. Copies share its pipeline.
#[derive(Clone)]
pub struct Kernel(Arc<Parts>);

struct Parts {
    name: &'static str,
    stage: Arc<Stage>,
    layout: OnceLock<Layout>,
    pipeline: OnceLock<wgpu::ComputePipeline>,
}

struct Layout {
    group: wgpu::BindGroupLayout,
    /// Every variable that the entry point uses.
    bindings: Vec<Binding>,
}

struct Binding {
    name: String,
    number: u32,
    is_uniform: bool,
}

/// Bytes of a buffer of zeros; no uniform has more.
const ZERO_BYTES: u64 = 4096;

impl Kernel {
    /// Makes the one kernel of a stage: [`Stage::new`] and [`Stage::kernel`] in a row.
    pub fn from_source(stage: &str, entry: &'static str, source: String) -> Kernel {
        Stage::new(stage, source).kernel(entry)
    }

    /// Returns the name of the entry point.
    pub(super) fn name(&self) -> &'static str {
        self.0.name
    }

    /// Returns the threads of a workgroup, as the shader says.
    pub(super) fn workgroup(&self) -> u32 {
        let Parts { name, stage, .. } = &*self.0;
        stage.point(name).1.workgroup_size.iter().product()
    }

    /// Says whether `other` is a copy of it.
    pub(super) fn is(&self, other: &Kernel) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// Says whether its pipeline is there.
    pub fn is_compiled(&self) -> bool {
        self.0.pipeline.get().is_some()
    }

    /// Returns the pipeline, which the first call compiles.
    pub(super) fn pipeline(&self, gpu: &Gpu) -> &wgpu::ComputePipeline {
        let Parts {
            name: entry,
            stage,
            pipeline,
            ..
        } = &*self.0;
        pipeline.get_or_init(|| {
            let layout = gpu
                .device
                .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some(entry),
                    bind_group_layouts: &[Some(&self.layout(gpu).group)],
                    immediate_size: 0,
                });
            gpu.device
                .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry),
                    layout: Some(&layout),
                    module: stage.shader(gpu),
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    cache: None,
                })
        })
    }

    /// Binds buffers by the names of the shader's variables; names that this entry point does not
    /// use are passed over, so that a stage's entry points can share one list.
    ///
    /// # Panics
    /// If a variable is left without a buffer, the shader does not validate, or it lacks the entry point: a
    /// fault in this program; naga's message says what.
    pub fn bind(&self, gpu: &Gpu, buffers: &[(&str, &Buffer)]) -> wgpu::BindGroup {
        let Layout { group, bindings } = self.layout(gpu);
        let entries: Vec<wgpu::BindGroupEntry<'_>> = bindings
            .iter()
            .map(|Binding { name, number, .. }| {
                let buffer = buffers.iter().find(|(n, _)| n == name);
                let (_, buffer) =
                    buffer.unwrap_or_else(|| panic!("{}: nothing bound to `{name}`", self.0.name));
                wgpu::BindGroupEntry {
                    binding: *number,
                    resource: buffer.binding(),
                }
            })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.0.name),
            layout: group,
            entries: &entries,
        })
    }

    /// Binds buffers of its own that hold zeros.
    pub(super) fn bind_zeros(&self, gpu: &Gpu) -> wgpu::BindGroup {
        let bindings = &self.layout(gpu).bindings;
        let zeros: Vec<(&str, Buffer)> = bindings
            .iter()
            .map(
                |Binding {
                     name, is_uniform, ..
                 }| {
                    let buffer = match is_uniform {
                        true => Buffer::uniforms(gpu, ZERO_BYTES),
                        false => Buffer::zeros(gpu, ZERO_BYTES),
                    };
                    (name.as_str(), buffer)
                },
            )
            .collect();
        let named: Vec<(&str, &Buffer)> = zeros.iter().map(|(name, b)| (*name, b)).collect();
        self.bind(gpu, &named)
    }

    fn layout(&self, gpu: &Gpu) -> &Layout {
        let parts = &self.0;
        let make = || parts.stage.layout(gpu, parts.name);
        parts.layout.get_or_init(make)
    }
}

/// A stage's source, checked once for all its entry points.
pub struct Stage {
    name: String,
    source: String,
    checked: OnceLock<(naga::Module, naga::valid::ModuleInfo)>,
    shader: OnceLock<wgpu::ShaderModule>,
}

impl Stage {
    /// Takes a complete WGSL `source`; `name` is for messages.
    pub fn new(name: &str, source: String) -> Arc<Stage> {
        Arc::new(Stage {
            name: name.to_owned(),
            source,
            checked: OnceLock::new(),
            shader: OnceLock::new(),
        })
    }

    /// Makes the kernel of entry point `entry`.
    pub fn kernel(self: &Arc<Stage>, entry: &'static str) -> Kernel {
        Kernel(Arc::new(Parts {
            name: entry,
            stage: Arc::clone(self),
            layout: OnceLock::new(),
            pipeline: OnceLock::new(),
        }))
    }

    fn checked(&self) -> &(naga::Module, naga::valid::ModuleInfo) {
        let Stage { name, source, .. } = self;
        self.checked.get_or_init(|| {
            let module = naga::front::wgsl::parse_str(source)
                .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(source, name)));
            let flags = naga::valid::ValidationFlags::all();
            let capabilities = naga::valid::Capabilities::empty();
            let info = naga::valid::Validator::new(flags, capabilities)
                .validate(&module)
                .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(source, name)));
            (module, info)
        })
    }

    /// Returns the place of an entry point among those of the stage, and the point.
    fn point(&self, entry: &str) -> (usize, &naga::EntryPoint) {
        let points = self.checked().0.entry_points.iter();
        points
            .enumerate()
            .find(|(_, point)| point.name == entry)
            .unwrap_or_else(|| panic!("{}: no entry point named {entry}", self.name))
    }

    fn shader(&self, gpu: &Gpu) -> &wgpu::ShaderModule {
        self.shader.get_or_init(|| {
            gpu.device
                .create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(&self.name),
                    source: wgpu::ShaderSource::Wgsl(self.source.as_str().into()),
                })
        })
    }

    fn layout(&self, gpu: &Gpu, entry: &str) -> Layout {
        let (stage, (module, info)) = (&self.name, self.checked());
        let (point, _) = self.point(entry);
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
            bindings.push(Binding {
                name: variable.name.clone().unwrap_or_default(),
                number: binding.binding,
                is_uniform: variable.space == naga::AddressSpace::Uniform,
            });
        }
        let group = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(entry),
                entries: &entries,
            });
        Layout { group, bindings }
    }
}

/// Calls `make` with the SH degrees 0 to 3.
pub fn by_degree<T>(make: impl Fn(u32) -> T) -> [T; 4] {
    [0, 1, 2, 3].map(make)
}
