//! This is the command `gspotential doctor`.

use std::path::PathBuf;

use clap::Args;

use crate::doctor::examine;
use crate::error::{Error, Result};
use crate::files::write_file;
use crate::gpu::Gpu;

const EXAMPLES: &str = "\
Examples:
  gspotential doctor
  gspotential doctor --json doctor.json > doctor.md

Exit code 1 says that a stage is out of bounds, or that there is no adapter.";

/// Hold every kernel against a double-precision reference on this machine's adapter, and time it
///
/// Prints the adapter's limits and one row a stage: time, throughput, error against the reference
/// and its bound. Then trains a tiny scene twice and says whether both runs are equal to the bit.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DoctorArgs {
    /// Write the report with every single comparison to this file, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Replace the file of --json
    #[arg(long)]
    overwrite: bool,
}

impl DoctorArgs {
    pub(crate) fn run(self) -> Result<()> {
        if let Some(path) = &self.json {
            super::check_output(path, self.overwrite)?;
        }
        let gpu = Gpu::open()?;
        log::info!("adapter: {}", gpu.describe());
        let report = examine(gpu)?;
        super::print(&report.to_string())?;
        if let Some(path) = &self.json {
            let mut json = serde_json::to_vec_pretty(&report)
                .map_err(|e| Error::new(e.to_string()).at_path(path))?;
            json.push(b'\n');
            write_file(path, &json)?;
        }
        report.verdict()
    }
}
