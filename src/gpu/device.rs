//! Adapter, device and queue, and what the driver reports of them.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use super::commands::{Asked, Requests};
use crate::error::{Error, ErrorKind, Result};
use crate::files::peak_host_bytes;

/// An opened adapter. Cheap to share by reference; all buffers and kernels are made through it.
pub struct Gpu {
    /// The wgpu device.
    pub device: wgpu::Device,
    /// Queue of `device`, to which all work is submitted.
    pub queue: wgpu::Queue,
    /// Name, driver, backend and kind of the adapter.
    pub info: wgpu::AdapterInfo,
    /// Limits of `device`.
    pub limits: wgpu::Limits,
    /// Limits of the adapter, most of which the device does without.
    pub adapter_limits: wgpu::Limits,
    /// Features that the adapter offers; only timestamps are used, if it has them.
    pub features: wgpu::Features,
    pub(super) allocated: Arc<AtomicU64>,
    pub(super) peak: AtomicU64,
    pub(super) asked: Asked,
    memory_limit: AtomicU64,
    faults: Arc<Mutex<Faults>>,
    host_bytes_at_start: u64,
}

/// Faults that the driver and the validation have reported outside any call.
#[derive(Default)]
struct Faults {
    /// The first that has not been checked yet.
    first: Option<wgpu::Error>,
    /// Why there is no device any more.
    lost: Option<String>,
}

fn locked(faults: &Mutex<Faults>) -> MutexGuard<'_, Faults> {
    // Whoever panicked while holding it has left it whole.
    faults.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Gpu {
    /// Opens the first of [`adapters`], or of those that [`prefer_adapter`] has named.
    ///
    /// # Errors
    /// No adapter at all (names the package that brings the software driver), none of the
    /// preferred name, or the driver refuses the device.
    pub fn open() -> Result<Gpu> {
        let adapter = choose(adapters()?, PREFERRED.get().map(String::as_str))?;
        let info = adapter.get_info();
        let adapter_limits = adapter.limits();
        let limits = device_limits(&adapter_limits);
        let features = adapter.features();
        let wanted = wgpu::Features::TIMESTAMP_QUERY;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("gspotential"),
            required_features: features & wanted,
            required_limits: limits.clone(),
            ..Default::default()
        }))
        .map_err(|e| Error::new(format!("the driver refused the device: {e}")).at(&info.name))?;
        let faults = Arc::<Mutex<Faults>>::default();
        let sink = Arc::clone(&faults);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            locked(&sink).first.get_or_insert(error);
        }));
        let sink = Arc::clone(&faults);
        device.set_device_lost_callback(move |reason, message| {
            locked(&sink).lost = Some(format!("{reason:?} {message}"));
        });
        Ok(Gpu {
            device,
            queue,
            info,
            limits,
            adapter_limits,
            features,
            allocated: Arc::new(AtomicU64::new(0)),
            peak: AtomicU64::new(0),
            asked: Asked::default(),
            memory_limit: AtomicU64::new(u64::MAX),
            faults,
            host_bytes_at_start: peak_host_bytes().unwrap_or(0),
        })
    }

    /// Returns the peak memory of the process when the adapter was opened, which commands do first,
    /// bytes: that of the program and the driver. 0 if it cannot be told.
    pub fn host_bytes_at_start(&self) -> u64 {
        self.host_bytes_at_start
    }

    /// Returns the adapter's name, its driver's version and the backend, for logs and reports.
    pub fn describe(&self) -> String {
        let wgpu::AdapterInfo {
            name,
            driver_info,
            backend,
            ..
        } = &self.info;
        format!("{name}, {driver_info}, {backend}")
    }

    /// Returns the size of the largest buffer that a kernel can bind, bytes.
    pub fn max_binding(&self) -> u64 {
        binding_limit(&self.limits)
    }

    /// Returns the bytes that this program's buffers hold now.
    pub fn live_bytes(&self) -> u64 {
        self.allocated.load(Ordering::Relaxed)
    }

    /// Returns the most bytes that this program's buffers have held at one time.
    pub fn peak_bytes(&self) -> u64 {
        self.peak.load(Ordering::Relaxed)
    }

    /// Returns how much the host has asked of the GPU so far.
    pub fn requests(&self) -> Requests {
        self.asked.so_far()
    }

    /// Makes memory count as run out once buffers would hold more than `bytes`, reported as the
    /// driver reports it. It is for tests of what follows, which then need not fill the memory.
    pub fn limit_memory(&self, bytes: u64) {
        self.memory_limit.store(bytes, Ordering::Relaxed);
    }

    /// Counts a new buffer of `bytes` bytes.
    pub(super) fn count(&self, bytes: u64) {
        let now = self.allocated.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.peak.fetch_max(now, Ordering::Relaxed);
        if now > self.memory_limit.load(Ordering::Relaxed) {
            let source = "the limit is reached".into();
            let error = wgpu::Error::OutOfMemory { source };
            locked(&self.faults).first.get_or_insert(error);
        }
    }

    /// Waits until all submitted work is done.
    ///
    /// # Errors
    /// What [`Gpu::check`] finds, or a wait that fails.
    pub fn wait(&self) -> Result<()> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled.map(|_| ()).map_err(|e| self.fault(&e.to_string()))
    }

    /// Reports a fault that has come in outside any call.
    ///
    /// # Errors
    /// A lost device ([`ErrorKind::DeviceLost`]), now and ever after; else the first fault that
    /// the driver or the validation has reported since the last check.
    pub fn check(&self) -> Result<()> {
        let mut faults = locked(&self.faults);
        if let Some(reason) = &faults.lost {
            let what = format!("the GPU is lost: {}", one_line(reason));
            return Err(Error::of(ErrorKind::DeviceLost, what).at(&self.info.name));
        }
        match faults.first.take() {
            None => Ok(()),
            Some(wgpu::Error::OutOfMemory { .. }) => Err(self.out_of_memory()),
            Some(error) => Err(self.fault(&error.to_string())),
        }
    }

    /// Does the same as [`Gpu::check`] for memory alone.
    pub(super) fn check_memory(&self) -> Result<()> {
        let mut faults = locked(&self.faults);
        match faults
            .first
            .take_if(|e| matches!(e, wgpu::Error::OutOfMemory { .. }))
        {
            Some(_) => Err(self.out_of_memory()),
            None => Ok(()),
        }
    }

    fn out_of_memory(&self) -> Error {
        let held = self.allocated.load(Ordering::Relaxed);
        Error::new(format!(
            "out of GPU memory with {} in buffers",
            mebibytes(held)
        ))
        .at(&self.info.name)
        .way_out(
            "close what else uses the GPU, or use fewer Gaussians (`--max-points`, \
                 `--set densify.max_gaussians=N`), smaller images (`--max-size`) or no target images \
                 on the GPU (`--set render.targets_mib=0`)",
        )
    }

    fn fault(&self, what: &str) -> Error {
        Error::new(format!("GPU fault: {}", one_line(what))).at(&self.info.name)
    }
}

/// Returns what a device is asked for: no more than WebGPU's default limits, so that it behaves alike
/// everywhere, but for the sizes of buffers, which the scenes decide.
fn device_limits(adapter: &wgpu::Limits) -> wgpu::Limits {
    wgpu::Limits {
        max_buffer_size: adapter.max_buffer_size,
        max_storage_buffer_binding_size: adapter.max_storage_buffer_binding_size,
        ..wgpu::Limits::default().or_worse_values_from(adapter)
    }
}

/// Returns the size of the largest buffer that a kernel can bind under `limits`, bytes. It is never
/// 2^32 or more, whatever the adapter can do: counts and indices in shaders are `u32`.
pub fn binding_limit(limits: &wgpu::Limits) -> u64 {
    limits
        .max_storage_buffer_binding_size
        .min(limits.max_buffer_size)
        .min(u64::from(u32::MAX).next_multiple_of(16) - 16)
}

/// Converts a count of a buffer's entries to a shader's.
///
/// # Panics
/// If it is 2^32 or more, which no buffer holds ([`binding_limit`]): a fault in this program.
pub fn shader_count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or_else(|_| panic!("{n} entries are in no buffer"))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Writes bytes as `12.3 MiB`.
pub(super) fn mebibytes(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

/// A part of the name of the adapter that every [`Gpu::open`] takes.
static PREFERRED: OnceLock<String> = OnceLock::new();

/// Makes [`Gpu::open`] take the first adapter whose name has `name` in it, whatever the case, from
/// now on. A second call changes nothing.
pub fn prefer_adapter(name: &str) {
    PREFERRED.get_or_init(|| name.to_owned());
}

/// Returns all adapters: discrete before integrated before virtual before software.
///
/// # Errors
/// There is no adapter.
pub fn adapters() -> Result<Vec<wgpu::Adapter>> {
    let mut description = wgpu::InstanceDescriptor::new_without_display_handle();
    description.backends = wgpu::Backends::PRIMARY;
    let instance = wgpu::Instance::new(description);
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
    adapters.sort_by_key(|adapter| rank(adapter.get_info().device_type));
    if adapters.is_empty() {
        return Err(Error::new("no GPU adapter found").way_out(
            "install a Vulkan driver; the software one comes with \
             `apt-get install mesa-vulkan-drivers libvulkan1`",
        ));
    }
    Ok(adapters)
}

/// Returns the first adapter, or the first with `wanted` in its name.
fn choose(adapters: Vec<wgpu::Adapter>, wanted: Option<&str>) -> Result<wgpu::Adapter> {
    let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
    let has = |name: &String, part: &str| name.to_lowercase().contains(&part.to_lowercase());
    let at = wanted.map_or(Some(0), |part| {
        names.iter().position(|name| has(name, part))
    });
    at.and_then(|i| adapters.into_iter().nth(i)).ok_or_else(|| {
        Error::usage(format!(
            "no adapter is named `{}`",
            wanted.unwrap_or_default()
        ))
        .way_out(format!("there are {}", names.join(", ")))
    })
}

fn rank(kind: wgpu::DeviceType) -> u32 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Cpu => 3,
        wgpu::DeviceType::Other => 4,
    }
}
