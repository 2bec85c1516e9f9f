//! `gspotential eval`

use std::path::PathBuf;

use clap::Args;

use crate::error::Result;
use crate::pipeline;
use crate::report::evaluation_table;
use crate::run::RunDir;

const EXAMPLES: &str = "\
Examples:
  gspotential eval runs/garden
  gspotential eval runs/* > tables.md
  gspotential eval runs/garden-* --html garden.html

PSNR and SSIM are 3DGS's, on renders rounded to 8 bit. n/a: not measured.";

/// Render the test views of runs and print their errors as Markdown tables
///
/// Each run's figures go to its eval.json, too, the renders to its test/, and all of it
/// to its report.html.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct EvalArgs {
    /// Run directories that `gspotential train` wrote
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,

    /// Write one page that compares the runs, too
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl EvalArgs {
    pub fn run(self) -> Result<()> {
        // All are opened before the first is rendered: a slip in the last name shows at once.
        let runs = self
            .runs
            .iter()
            .map(|root| RunDir::open(root))
            .collect::<Result<Vec<_>>>()?;
        for run in &runs {
            let evaluation = pipeline::evaluate(run)?;
            super::print(&format!("{}\n", evaluation_table(&run.name(), &evaluation)))?;
        }
        if let Some(path) = &self.html {
            pipeline::compare(&runs, path)?;
            log::info!("wrote {}", path.display());
        }
        Ok(())
    }
}
