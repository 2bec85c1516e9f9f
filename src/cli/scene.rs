//! This is the command `gspotential scene`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};

use crate::config::{Config, PRESETS};
use crate::error::{Error, Result};
use crate::pipeline::{self, PriorOptions};
use crate::scene::{LoadOptions, SceneSource};

const EXAMPLES: &str = "\
Examples:
  gspotential scene garden/ --weights model.safetensors --out scenes/garden
  gspotential scene a.jpg b.jpg c.jpg --weights model.safetensors --out scenes/three
  gspotential scene --cameras scenes/colmap --weights model.safetensors --out dense.ply
  gspotential train --scene scenes/colmap --cloud dense.ply

Weights: model.safetensors of depth-anything/DA3-SMALL (137 MB) or depth-anything/DA3-BASE
(541 MB) from huggingface.co, both under Apache-2.0. Larger models run, too; their weights are
not for commercial use (CC BY-NC 4.0).";

/// Make a scene folder from photographs alone: cameras and a cloud, by Depth Anything 3's network
///
/// No GPU is needed. The photographs' order is kept; a folder's are taken by name.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, group = ArgGroup::new("from").required(true))]
pub(crate) struct SceneArgs {
    /// Photographs, or a folder of them
    #[arg(value_name = "PHOTOGRAPH|DIR", group = "from")]
    photographs: Vec<PathBuf>,

    /// Make a dense cloud for the training views of this scene instead, whose cameras are known
    #[arg(long, value_name = "SCENE", group = "from", conflicts_with_all = ["photographs", "exif_focal"])]
    cameras: Option<SceneSource>,

    /// The network's weights, model.safetensors as downloaded
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,

    /// Folder for the scene, or with --cameras the .ply file for the cloud
    #[arg(long, value_name = "DIR|FILE.ply")]
    out: PathBuf,

    /// Longer side of what the network sees, pixels
    #[arg(long, value_name = "PX", default_value_t = 504,
          value_parser = clap::value_parser!(u32).range(28..=4096))]
    size: u32,

    /// Share of each view's pixels that become points, the surest
    #[arg(long, value_name = "SHARE", default_value_t = 0.6)]
    confidence: f64,

    /// Thin the cloud evenly to N points
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    max_points: usize,

    /// Leave cameras and depths as the network has them, without refining them on the photographs
    #[arg(long, conflicts_with = "cameras")]
    no_adjust: bool,

    /// Take cameras from the network's rays instead of its camera decoder: slower, and by its
    /// authors more accurate
    #[arg(long, conflicts_with = "cameras")]
    ray_cameras: bool,

    /// Take focal lengths from the photographs' EXIF where it has them
    #[arg(long)]
    exif_focal: bool,

    /// With --cameras: replace the file that --out names
    #[arg(long, requires = "cameras")]
    overwrite: bool,
}

impl SceneArgs {
    pub(crate) fn run(self) -> Result<()> {
        if !(self.confidence > 0.0 && self.confidence <= 1.0) {
            return Err(Error::usage(format!(
                "--confidence is {}, but must be above 0 and at most 1",
                self.confidence
            )));
        }
        if self.max_points == 0 {
            return Err(Error::usage("--max-points 0 leaves no cloud"));
        }
        let options = PriorOptions {
            weights: self.weights,
            size: self.size,
            share: self.confidence,
            adjust: !self.no_adjust,
            ray_cameras: self.ray_cameras,
            exif_focal: self.exif_focal,
            max_points: self.max_points,
        };
        let Some(source) = self.cameras else {
            return pipeline::scene_of_photographs(&self.photographs, &options, &self.out);
        };
        super::check_output(&self.out, self.overwrite)?;
        let load = LoadOptions {
            n_test: 0,
            needs_cloud: false,
            ..LoadOptions::new(&Config::preset(PRESETS[0].0)?)
        };
        pipeline::cloud_of_scene(&source.resolved()?, &load, &options, &self.out)
    }
}
