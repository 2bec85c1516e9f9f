//! `gspotential eval`

use std::path::PathBuf;

use clap::Args;

use super::measure::MeasureArgs;
use crate::error::Result;
use crate::pipeline;
use crate::report::evaluation_table;
use crate::run::RunDir;

const EXAMPLES: &str = "\
Examples:
  gspotential eval runs/garden
  gspotential eval runs/* > tables.md

PSNR and SSIM are 3DGS's, on renders rounded to 8 bit. n/a: not measured.";

/// Render the test views of runs and print their errors as Markdown tables
///
/// Each run's figures go to its eval.json, too, and the renders to its test/.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct EvalArgs {
    /// Run directories that `gspotential train` wrote
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,

    #[command(flatten)]
    measure: MeasureArgs,
}

impl EvalArgs {
    pub fn run(self) -> Result<()> {
        // All are opened before the first is rendered: a slip in the last name shows at once.
        let runs = self
            .runs
            .iter()
            .map(|root| RunDir::open(root))
            .collect::<Result<Vec<_>>>()?;
        let options = self.measure.options()?;
        for run in &runs {
            let evaluation = pipeline::evaluate(run, &options)?;
            super::print(&format!("{}\n", evaluation_table(&run.name(), &evaluation)))?;
        }
        Ok(())
    }
}
