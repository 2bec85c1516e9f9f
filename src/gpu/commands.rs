//! Commands for the GPU, recorded one by one and submitted together.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::{Buffer, Gpu, Kernel, Profile};

/// One thing that the GPU is to do.
enum Command {
    Dispatch {
        kernel: Kernel,
        group: wgpu::BindGroup,
        /// Workgroups across and down.
        grid: (u32, u32),
    },
    Clear(Buffer),
    Copy {
        from: Buffer,
        to: Buffer,
    },
}

/// Commands recorded for one submission.
pub struct Commands<'a> {
    gpu: &'a Gpu,
    commands: Vec<Command>,
    profile: Option<&'a mut Profile>,
}

impl<'a> Commands<'a> {
    /// Starts an empty list of commands, without timestamps.
    pub fn new(gpu: &'a Gpu) -> Commands<'a> {
        Self::profiled(gpu, None)
    }

    /// Starts an empty list of commands; given a profile, takes the time of every dispatch.
    pub fn profiled(gpu: &'a Gpu, profile: Option<&'a mut Profile>) -> Commands<'a> {
        Commands {
            gpu,
            commands: Vec::new(),
            profile,
        }
    }

    /// Dispatches at least `n_threads` threads, folded into two dimensions.
    pub fn dispatch(&mut self, kernel: &Kernel, group: &wgpu::BindGroup, n_threads: u64) {
        let n_groups = n_threads.div_ceil(u64::from(kernel.workgroup()));
        if n_groups == 0 {
            return;
        }
        let limit = self.gpu.limits.max_compute_workgroups_per_dimension;
        self.commands.push(Command::Dispatch {
            kernel: kernel.clone(),
            group: group.clone(),
            grid: fold(n_groups, limit),
        });
    }

    /// Sets a whole buffer to zero.
    pub fn clear(&mut self, buffer: &Buffer) {
        self.commands.push(Command::Clear(buffer.whole()));
    }

    /// Copies all of `from` to the start of `to`, which is as large or larger.
    pub fn copy(&mut self, from: &Buffer, to: &Buffer) {
        self.commands.push(Command::Copy {
            from: from.whole(),
            to: to.whole(),
        });
    }

    /// Compiles the pipelines that are dispatched and not there yet, side by side.
    pub fn compile(&self) {
        let mut missing: Vec<&Kernel> = Vec::new();
        for command in &self.commands {
            if let Command::Dispatch { kernel, .. } = command
                && !kernel.is_compiled()
                && !missing.iter().any(|other| other.is(kernel))
            {
                missing.push(kernel);
            }
        }
        missing.par_iter().for_each(|kernel| {
            kernel.pipeline(self.gpu);
        });
    }

    /// Submits the commands, without a wait. Given a profile, also reads its timestamps out on the
    /// GPU.
    pub fn submit(self) {
        self.compile();
        let Commands {
            gpu,
            commands,
            mut profile,
        } = self;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let most = match profile {
            // Timestamps stand at a pass's ends.
            Some(_) => 1,
            None => usize::MAX,
        };
        let mut rest = commands.as_slice();
        while let Some(command) = rest.first() {
            let n = match command {
                Command::Dispatch { .. } => {
                    let n = leading_dispatches(rest).min(most);
                    encode_pass(gpu, &mut encoder, &rest[..n], profile.as_deref_mut());
                    n
                }
                Command::Clear(buffer) => {
                    buffer.encode_clear(&mut encoder);
                    1
                }
                Command::Copy { from, to } => {
                    from.encode_copy(&mut encoder, to);
                    1
                }
            };
            rest = &rest[n..];
        }
        if let Some(profile) = &profile {
            profile.resolve(&mut encoder);
        }
        gpu.queue.submit([encoder.finish()]);
    }
}

/// Compiles a kernel and dispatches it once, without a wait, over zeros: some drivers make machine code when a kernel first
/// runs. The kernel may not run long with counts of 0.
pub fn try_out(gpu: &Gpu, kernel: &Kernel) {
    let mut commands = Commands::new(gpu);
    commands.dispatch(kernel, &kernel.bind_zeros(gpu), 1);
    commands.submit();
}

/// Returns how many dispatches `commands` begin with.
fn leading_dispatches(commands: &[Command]) -> usize {
    let is_other = |command: &Command| !matches!(command, Command::Dispatch { .. });
    commands.iter().position(is_other).unwrap_or(commands.len())
}

/// Encodes dispatches as one pass, timed where there is a profile.
fn encode_pass(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    dispatches: &[Command],
    profile: Option<&mut Profile>,
) {
    let label = dispatches
        .iter()
        .find_map(Command::kernel)
        .map(Kernel::name);
    let times = profile.zip(label).and_then(|(p, name)| p.next(name));
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label,
        timestamp_writes: times,
    });
    for command in dispatches {
        if let Command::Dispatch {
            kernel,
            group,
            grid: (x, y),
        } = command
        {
            pass.set_pipeline(kernel.pipeline(gpu));
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(*x, *y, 1);
        }
    }
    gpu.asked.pass(dispatches.len());
}

impl Command {
    fn kernel(&self) -> Option<&Kernel> {
        match self {
            Command::Dispatch { kernel, .. } => Some(kernel),
            Command::Clear(_) | Command::Copy { .. } => None,
        }
    }
}

/// Returns `n` workgroups, at least 1, as columns and rows of which neither exceeds `limit`; fewer
/// of them are idle than there are rows.
pub fn fold(n: u64, limit: u32) -> (u32, u32) {
    let rows = n.div_ceil(u64::from(limit));
    let columns = n.div_ceil(rows);
    (columns as u32, rows as u32)
}

/// What the host has asked of the GPU, counted.
#[derive(Default)]
pub(super) struct Asked {
    passes: AtomicU64,
    dispatches: AtomicU64,
    writes: AtomicU64,
}

/// Numbers of what the host has asked of the GPU so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Requests {
    /// Compute passes.
    pub passes: u64,
    /// Dispatches in them.
    pub dispatches: u64,
    /// Writes to buffers.
    pub writes: u64,
}

impl Asked {
    fn pass(&self, dispatches: usize) {
        self.passes.fetch_add(1, Ordering::Relaxed);
        self.dispatches
            .fetch_add(dispatches as u64, Ordering::Relaxed);
    }

    pub(super) fn write(&self) {
        self.writes.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn so_far(&self) -> Requests {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        Requests {
            passes: read(&self.passes),
            dispatches: read(&self.dispatches),
            writes: read(&self.writes),
        }
    }
}
