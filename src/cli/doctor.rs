//! This is the command `gspotential doctor`.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::doctor::examine;
use crate::doctor::timing::ROUNDS;
use crate::error::{Error, Result};
use crate::files::{create_dir, write_file};
use crate::gpu::Gpu;
use crate::gpu::shader;

const EXAMPLES: &str = "\
Examples:
  gspotential doctor
  gspotential doctor --json doctor.json > doctor.md
  gspotential doctor --wgsl shaders-of-this-version

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

    /// Write every shader as the driver gets it to this folder, for bug reports and other tools, and
    /// examine nothing: no adapter is needed
    #[arg(long, value_name = "DIR", conflicts_with = "json")]
    wgsl: Option<PathBuf>,

    /// Rounds of which the fastest counts; one is enough where times do not matter
    #[arg(long, value_name = "N", default_value_t = ROUNDS, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: u32,

    /// Replace the file of --json, or those in the folder of --wgsl
    #[arg(long)]
    overwrite: bool,
}

impl DoctorArgs {
    pub(crate) fn run(self) -> Result<()> {
        if let Some(folder) = &self.wgsl {
            return write_shaders(folder, self.overwrite);
        }
        if let Some(path) = &self.json {
            super::check_output(path, self.overwrite)?;
        }
        let gpu = Gpu::open()?;
        log::info!("adapter: {}", gpu.describe());
        let report = examine(gpu, self.rounds)?;
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

/// Writes every shader to `folder`, all of them or none where one is there already.
fn write_shaders(folder: &Path, overwrite: bool) -> Result<()> {
    let programs = shader::programs();
    let path_of = |name: &str| folder.join(format!("{name}.wgsl"));
    if folder.is_dir() {
        for (name, _) in &programs {
            super::check_output(&path_of(name), overwrite)?;
        }
    }
    create_dir(folder)?;
    for (name, source) in &programs {
        write_file(&path_of(name), source.as_bytes())?;
    }
    log::info!("{} shaders in {}", programs.len(), folder.display());
    Ok(())
}
