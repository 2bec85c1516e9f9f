//! This is the command `gspotential view`.

use std::path::PathBuf;

use clap::Args;

use crate::error::Result;
use crate::pipeline;

const EXAMPLES: &str = "\
Examples:
  gspotential view runs/garden
  gspotential view garden/point_cloud.ply --port 8080

The page is served to this machine alone, at the address that is printed, until Ctrl-C. On a machine elsewhere:
`ssh -L 8080:127.0.0.1:8080 HOST` brings port 8080 here, and the address opens as it is.
`train --watch` shows a training as it runs in the same way.";

/// Show a finished run, or a model, in the browser: the scene to turn, views beside photographs
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ViewArgs {
    /// Run directory, or Gaussians in the 3DGS PLY layout
    #[arg(value_name = "RUN|FILE.ply")]
    model: PathBuf,

    /// Port of 127.0.0.1 to serve it on; 0: any that is free
    #[arg(long, value_name = "PORT", default_value_t = 0)]
    port: u16,
}

impl ViewArgs {
    pub(crate) fn run(self) -> Result<()> {
        let _page = pipeline::view(&self.model, self.port)?;
        loop {
            std::thread::park();
        }
    }
}
