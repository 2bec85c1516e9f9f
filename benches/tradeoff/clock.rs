//! Time that other programs on the machine do not add to, as far as that can be had.

use std::time::Instant;

use gspotential::error::Result;
use gspotential::gpu::{Commands, Gpu, Profile};

/// Seconds that all threads of this process have run for, where the system tells (Linux).
fn cpu_seconds() -> Option<f64> {
    let mut nanoseconds = 0;
    for task in std::fs::read_dir("/proc/self/task").ok()? {
        // A thread may end between the listing and the reading.
        let Ok(text) = std::fs::read_to_string(task.ok()?.path().join("schedstat")) else {
            continue;
        };
        nanoseconds += text.split_whitespace().next()?.parse::<u64>().ok()?;
    }
    Some(nanoseconds as f64 * 1e-9)
}

/// What a time is.
pub(crate) fn unit() -> &'static str {
    match cpu_seconds() {
        Some(_) => "CPU time of the process",
        None => "wall-clock time",
    }
}

/// Seconds of `work` on the CPU.
pub(crate) fn of_cpu<T>(work: impl FnOnce() -> Result<T>) -> Result<f64> {
    let (start, cpu) = (Instant::now(), cpu_seconds());
    work()?;
    Ok(match (cpu, cpu_seconds()) {
        (Some(before), Some(after)) => after - before,
        _ => start.elapsed().as_secs_f64(),
    })
}

/// Seconds of a submission: on a software adapter [`of_cpu`], otherwise by timestamps.
#[allow(
    dead_code,
    reason = "the bench of growth times the GPU, that of the trade-offs does not"
)]
pub(crate) fn of_gpu(
    gpu: &Gpu,
    profile: &mut Option<Profile>,
    record: impl FnOnce(&mut Commands<'_>),
) -> Result<f64> {
    let on_cpu = gpu.info.device_type == wgpu::DeviceType::Cpu;
    let profile = if on_cpu { &mut None } else { profile };
    let seconds = of_cpu(|| {
        let mut commands = Commands::profiled(gpu, profile.as_mut());
        record(&mut commands);
        commands.submit();
        gpu.wait()
    })?;
    match profile {
        Some(profile) => Ok(profile.take(gpu)?.values().map(|k| k.seconds).sum()),
        None => Ok(seconds),
    }
}
