//! This is the command `gspotential render`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};

use crate::error::Result;
use crate::pipeline::{self, CameraSource, RenderFormat, RenderJob, ViewSelection};
use crate::scene::SceneSource;

const EXAMPLES: &str = "\
Examples:
  gspotential render --model runs/garden/point_cloud.ply --scene scenes/garden --out views
  gspotential render --model runs/garden/point_cloud.ply --cameras runs/garden/cameras.json \\
      --views virtual --format exr --out views
  gspotential render --model runs/garden/point_cloud.ply --scene scenes/garden --orbit 120 --out turn";

/// Render a trained scene to image files
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, group = ArgGroup::new("where").required(true))]
pub(crate) struct RenderArgs {
    /// Gaussians in the 3DGS PLY layout
    #[arg(long, value_name = "FILE.ply")]
    model: PathBuf,

    /// Take the cameras of this scene folder, or of `builtin[:WIDTH]`
    #[arg(long, value_name = "DIR", group = "where")]
    scene: Option<SceneSource>,

    /// Take the cameras of this file, as training writes it
    #[arg(long, value_name = "cameras.json", group = "where")]
    cameras: Option<PathBuf>,

    /// Views to render: `train` or `test` (with --scene), `virtual`, or names separated by commas
    /// [default: a scene's test views, every camera of a file]
    #[arg(long, value_name = "WHICH")]
    views: Option<String>,

    /// Render N views around the scene instead, and orbit.png, which is animated
    #[arg(long, value_name = "N", conflicts_with = "views",
          value_parser = clap::value_parser!(u32).range(2..=10_000))]
    orbit: Option<u32>,

    /// Folder for the images; files of the same names are replaced
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// File format of the images
    #[arg(long, value_enum, default_value_t = RenderFormat::Png)]
    format: RenderFormat,

    /// Write `NAME_depth.exr`, too: expected depth in the scene's unit, 0 where nothing is
    #[arg(long)]
    depth: bool,

    /// Write `NAME_alpha.png`, too: opacity, 16 bit
    #[arg(long)]
    alpha: bool,
}

impl RenderArgs {
    pub(crate) fn run(self) -> Result<()> {
        let cameras = match (self.scene, self.cameras) {
            (Some(scene), _) => CameraSource::Scene(scene.resolved()?),
            (None, file) => CameraSource::File(file.unwrap_or_default()),
        };
        let job = RenderJob {
            model: self.model,
            cameras,
            views: match self.orbit {
                Some(n) => Some(ViewSelection::Orbit(n)),
                None => self.views.map(|which| selection(&which)),
            },
            out: self.out,
            format: self.format,
            depth: self.depth,
            alpha: self.alpha,
        };
        let n_images = pipeline::render(&job)?;
        log::info!("wrote {n_images} images to {}", job.out.display());
        Ok(())
    }
}

fn selection(which: &str) -> ViewSelection {
    match which {
        "train" => ViewSelection::Train,
        "test" => ViewSelection::Test,
        "virtual" => ViewSelection::Virtual,
        names => ViewSelection::Names(names.split(',').map(str::to_owned).collect()),
    }
}
