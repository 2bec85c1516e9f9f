//! This is the command `gspotential render`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};

use crate::error::Result;
use crate::pipeline::{
    self, CameraSource, ImageFiles, RenderFormat, RenderJob, RenderTarget, ViewSelection,
};
use crate::report::FilmTarget;
use crate::run::RunDir;
use crate::scene::SceneSource;

const EXAMPLES: &str = "\
Examples:
  gspotential render runs/garden --views virtual --out views
  gspotential render --model runs/garden/point_cloud.ply --scene scenes/garden --out views
  gspotential render --model runs/garden/point_cloud.ply --cameras runs/garden/cameras.json \\
      --views virtual --format exr --out views
  gspotential render --model runs/garden/point_cloud.ply --scene scenes/garden --orbit 120 --out turn
  gspotential render --model runs/garden/point_cloud.ply --cameras runs/garden/cameras.json \\
      --path 240 --y4m - | ffmpeg -i - -pix_fmt yuv420p -colorspace bt709 -color_primaries bt709 \\
      -color_trc iec61966-2-1 garden.mp4

A film has 24 frames a second in 4:2:0, BT.709's matrix, limited range. YUV4MPEG2 cannot name the
matrix, so the encoder is told, as above. An odd width or height loses its last column or row.
--path goes through the views in the order of --views or of the file, and stops at both ends; a
file of your own cameras, in the layout of a run's cameras.json, lays any path.

views.json beside the images lists their cameras in that layout, and of each image the photograph
that is nearest. Images that another program has made of them, a network that repairs renders say,
are trained on with `train --virtual-images DIR` if they keep their names and sizes.";

/// Render a trained scene to image files or a film
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, group = ArgGroup::new("where").required(true),
          group = ArgGroup::new("what").required(true))]
pub(crate) struct RenderArgs {
    /// Take the model and the cameras of this run
    #[arg(value_name = "RUN", group = "where", conflicts_with = "model")]
    of_run: Option<PathBuf>,

    /// Gaussians in the 3DGS PLY layout
    #[arg(long, value_name = "FILE.ply", required_unless_present = "of_run")]
    model: Option<PathBuf>,

    /// Take the cameras of this scene folder, or of `builtin[:WIDTH]` or `builtin:object[:WIDTH]`
    #[arg(long, value_name = "DIR", group = "where")]
    scene: Option<SceneSource>,

    /// Take the cameras of this file, as training writes it
    #[arg(long, value_name = "cameras.json", group = "where")]
    cameras: Option<PathBuf>,

    /// Views to render: `train`, `test` or `virtual`, or names separated by commas
    /// [default: a scene's test views, every camera of a file; for --path the training views of a
    /// scene or a run]
    #[arg(long, value_name = "WHICH")]
    views: Option<String>,

    /// Render N views around the scene instead, and with --out orbit.png, which is animated
    #[arg(long, value_name = "N", conflicts_with_all = ["views", "path"],
          value_parser = clap::value_parser!(u32).range(2..=10_000))]
    orbit: Option<u32>,

    /// Render N views on a smooth path through the views instead
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    path: Option<u32>,

    /// Folder for the images; files of the same names are replaced
    #[arg(long, value_name = "DIR", group = "what")]
    out: Option<PathBuf>,

    /// Write the views as one film, uncompressed for an encoder, to this file or with `-` to stdout
    #[arg(long, value_name = "FILE.y4m|-", group = "what", conflicts_with_all = ["format", "depth", "alpha"])]
    y4m: Option<PathBuf>,

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
        let run = self.of_run.map(|root| RunDir::open(&root)).transpose()?;
        let cameras = match (self.scene, self.cameras, &run) {
            (Some(scene), _, _) => CameraSource::Scene(scene.resolved()?),
            (None, None, Some(run)) => CameraSource::File(run.cameras()),
            (None, file, _) => CameraSource::File(file.unwrap_or_default()),
        };
        let target = match self.y4m {
            Some(path) => RenderTarget::Film(FilmTarget::new(&path)),
            None => RenderTarget::Images(ImageFiles {
                folder: self.out.unwrap_or_default(),
                format: self.format,
                depth: self.depth,
                alpha: self.alpha,
            }),
        };
        let job = RenderJob {
            model: match run {
                Some(run) => run.point_cloud(),
                None => self.model.unwrap_or_default(),
            },
            cameras,
            views: match self.orbit {
                Some(n) => Some(ViewSelection::Orbit(n)),
                None => self.views.map(|which| selection(&which)),
            },
            path: self.path,
            target,
        };
        let n = pipeline::render(&job)?;
        match &job.target {
            RenderTarget::Images(files) => {
                log::info!("wrote {n} images to {}", files.folder.display());
            }
            RenderTarget::Film(FilmTarget::File(path)) => {
                log::info!("wrote {n} frames to {}", path.display());
            }
            RenderTarget::Film(FilmTarget::Stdout) => log::info!("wrote {n} frames"),
        }
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
