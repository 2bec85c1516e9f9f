//! This module holds the options that every command takes: the adapter, threads, and how it speaks.

use clap::Args;

use crate::error::{Error, Result};
use crate::gpu;
use crate::report::{Column, Table};
use crate::terminal::logging::{self, Style};

#[derive(Debug, Args)]
#[command(next_help_heading = "Machine")]
pub(crate) struct Machine {
    /// GPU adapter, by a part of its name [default: the fastest kind]
    #[arg(long, value_name = "NAME", global = true)]
    adapter: Option<String>,

    /// CPU threads [default: one a core]; results do not depend on it
    #[arg(long, value_name = "N", global = true,
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,

    /// Only warnings and errors on stderr
    #[arg(long, short, global = true)]
    quiet: bool,

    /// How messages and progress are written to stderr; `json` is one object a line
    #[arg(long, value_name = "STYLE", value_enum, default_value_t = Style::Text, global = true)]
    log: Style,
}

impl Machine {
    /// Sets up the process; before anything else.
    ///
    /// # Errors
    /// Threads that the system does not give.
    pub(crate) fn prepare(&self) -> Result<()> {
        logging::start(self.log, self.quiet);
        if let Some(name) = &self.adapter {
            gpu::prefer_adapter(name);
        }
        match self.threads {
            None => Ok(()),
            Some(n) => rayon::ThreadPoolBuilder::new()
                .num_threads(n.into())
                .build_global()
                .map_err(|e| Error::new(format!("cannot start {n} threads: {e}"))),
        }
    }
}

/// List the GPU adapters, the one that is taken unless --adapter names another first
#[derive(Debug, Args)]
pub(crate) struct AdaptersArgs {}

impl AdaptersArgs {
    pub(crate) fn run(self) -> Result<()> {
        let columns = [
            Column::text("adapter", "adapter"),
            Column::text("driver", "driver"),
            Column::text("backend", "backend"),
            Column::text("kind", "kind"),
            Column::number("largest_binding_mib", "largest binding MiB", 0),
        ];
        let mut table = Table::new("adapters", &columns);
        for adapter in gpu::adapters()? {
            let (info, limits) = (adapter.get_info(), adapter.limits());
            table.row([
                info.name.into(),
                info.driver_info.into(),
                info.backend.to_string().into(),
                format!("{:?}", info.device_type).into(),
                (limits.max_storage_buffer_binding_size >> 20).into(),
            ]);
        }
        super::print(&table.to_string())
    }
}
