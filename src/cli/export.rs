//! This is the command `gspotential export`.

use std::path::PathBuf;

use clap::Args;
use glam::DVec3;

use crate::error::{Error, Result};
use crate::gaussians::ply::{Stored, read_ply};
use crate::gaussians::splat::write_splat;
use crate::gaussians::spz::write_spz;
use crate::run::RunDir;

const EXAMPLES: &str = "\
Examples:
  gspotential export runs/garden --out garden.spz
  gspotential export garden/point_cloud.ply --out garden.splat

A .spz file is about a tenth of the PLY, with all SH degrees in 8 bits a value. A .splat file has
32 bytes a Gaussian and the colours of degree 0. The point_cloud.ply of a run is the full model,
which 3DGS viewers open as it is.";

/// Write a trained scene as a .spz or .splat file for viewers on the web
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ExportArgs {
    /// Run directory, or Gaussians in the 3DGS PLY layout
    #[arg(value_name = "RUN|FILE.ply")]
    model: PathBuf,

    /// File to write; one of the same name is replaced
    #[arg(long, value_name = "FILE.spz|FILE.splat")]
    out: PathBuf,
}

impl ExportArgs {
    pub(crate) fn run(self) -> Result<()> {
        let write = match self.out.extension().and_then(|ext| ext.to_str()) {
            Some("spz") => write_spz,
            Some("splat") => write_splat,
            _ => {
                return Err(Error::usage("the formats to export are .spz and .splat")
                    .at_path(&self.out)
                    .way_out("name a file that ends in one of them"));
            }
        };
        let model = if self.model.is_dir() {
            RunDir::open(&self.model)?.point_cloud()
        } else {
            self.model
        };
        let Stored { gaussians, offset } = read_ply(&model)?;
        if gaussians.heaviest(1).is_empty() {
            return Err(Error::new(format!(
                "none of the {} Gaussians is ever drawn, so there is nothing to export",
                gaussians.len()
            ))
            .at_path(&model)
            .way_out("train the scene again, or name another model"));
        }
        let mut warnings = Vec::new();
        let n = write(&self.out, &gaussians, &mut warnings)?;
        for warning in &warnings {
            log::warn!("{}: {warning}", self.out.display());
        }
        if offset != DVec3::ZERO {
            log::warn!(
                "positions are without the model's offset {} {} {}, which the format has no place for",
                offset.x,
                offset.y,
                offset.z
            );
        }
        log::info!("wrote {n} Gaussians to {}", self.out.display());
        if n < gaussians.len() {
            log::info!("{} others are never drawn", gaussians.len() - n);
        }
        Ok(())
    }
}
