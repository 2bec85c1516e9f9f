//! Adapter, device and queue.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use crate::error::{Error, Result};

/// An opened adapter. Cheap to share by reference; all buffers and kernels are made through it.
pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub info: wgpu::AdapterInfo,
    pub limits: wgpu::Limits,
    /// What the adapter offers; of it, only timestamps are used, where there are any.
    pub features: wgpu::Features,
    pub(super) allocated: Arc<AtomicU64>,
    pub(super) peak: AtomicU64,
    faults: Arc<Mutex<Option<String>>>,
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
        let limits = adapter.limits();
        let features = adapter.features();
        let wanted = wgpu::Features::TIMESTAMP_QUERY;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("gspotential"),
            required_features: features & wanted,
            required_limits: limits.clone(),
            ..Default::default()
        }))
        .map_err(|e| Error::new(format!("the driver refused the device: {e}")).at(&info.name))?;
        let faults = Arc::new(Mutex::new(None));
        let sink = Arc::clone(&faults);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            if let Ok(mut first) = sink.lock() {
                first.get_or_insert_with(|| error.to_string());
            }
        }));
        Ok(Gpu {
            device,
            queue,
            info,
            limits,
            features,
            allocated: Arc::new(AtomicU64::new(0)),
            peak: AtomicU64::new(0),
            faults,
        })
    }

    /// The adapter's name, driver and kind, for logs and reports.
    pub fn describe(&self) -> String {
        let wgpu::AdapterInfo {
            name,
            driver_info,
            backend,
            ..
        } = &self.info;
        format!("{name}, {driver_info}, {backend}")
    }

    /// Largest buffer that a kernel can bind, bytes.
    pub fn max_binding(&self) -> u64 {
        self.limits
            .max_storage_buffer_binding_size
            .min(self.limits.max_buffer_size)
    }

    /// Most bytes that this program's buffers have held at one time.
    pub fn peak_bytes(&self) -> u64 {
        self.peak.load(Ordering::Relaxed)
    }

    /// Waits until all submitted work is done.
    ///
    /// # Errors
    /// The first fault that the driver or the validation has reported since the last check.
    pub fn wait(&self) -> Result<()> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled.map(|_| ()).map_err(|e| self.fault(&e.to_string()))
    }

    /// Reports a fault that has come in outside any call, such as memory running out.
    pub fn check(&self) -> Result<()> {
        let fault = self.faults.lock().ok().and_then(|mut first| first.take());
        match fault {
            Some(what) => Err(self.fault(&what)),
            None => Ok(()),
        }
    }

    fn fault(&self, what: &str) -> Error {
        let line = what.split_whitespace().collect::<Vec<_>>().join(" ");
        Error::new(format!("GPU fault: {line}")).at(&self.info.name)
    }
}

/// A part of the name of the adapter that every [`Gpu::open`] takes.
static PREFERRED: OnceLock<String> = OnceLock::new();

/// Makes [`Gpu::open`] take the first adapter whose name has `name` in it, whatever the case, from
/// now on. A second call changes nothing.
pub fn prefer_adapter(name: &str) {
    PREFERRED.get_or_init(|| name.to_owned());
}

/// All adapters: discrete before integrated before virtual before software.
///
/// # Errors
/// There is none.
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

/// The first adapter, or the first with `wanted` in its name.
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
