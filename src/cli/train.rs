//! `gspotential train`

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;

use super::measure::MeasureArgs;
use crate::config::{Config, PRESETS};
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::pipeline;
use crate::report::evaluation_table;
use crate::run::RunDir;
use crate::scene::{LoadOptions, Scene, SceneSource};

/// A single training view has no pseudo-focus to put virtual views around.
const MIN_TRAIN_VIEWS: usize = 2;

const EXAMPLES: &str = "\
Examples:
  gspotential train
  gspotential train --scene scenes/garden --max-size 320 --iterations 1000
  gspotential train --scene scenes/garden --preset 3dgs --out runs/baseline
  gspotential train --set views.count=64 --set loss.ssim_weight=0.3

A config file is a JSON object that states what it changes, as in
  {\"preset\": \"paper\", \"iterations\": 3000, \"views\": {\"count\": 64}}
The config.json of any run is one, too, and lists every key. Later wins: preset, file, --set,
then the options of their own (--iterations, --max-size, --max-points, --seed).";

/// Train a scene and evaluate it at its test views
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct TrainArgs {
    /// Scene folder with images/ and sparse/0/, or `builtin[:WIDTH]` for the scene that the
    /// program makes itself
    #[arg(long, value_name = "DIR", default_value = "builtin")]
    scene: SceneSource,

    /// Run directory to write [default: runs/<scene>-<preset>-seed<seed>]
    #[arg(long, value_name = "RUN")]
    out: Option<PathBuf>,

    /// Preset to start from: `paper`, the method, or `3dgs`, its baseline without virtual views
    /// and coverage rules [default: paper]
    #[arg(long, value_name = "NAME", conflicts_with = "config")]
    preset: Option<String>,

    /// Config file to start from
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// Change one config value; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,

    /// Training iterations [preset: 10000]
    #[arg(long, value_name = "N")]
    iterations: Option<u32>,

    /// Scale images down until their longer side is PX pixels [preset: 1600 wide]
    #[arg(long, value_name = "PX")]
    max_size: Option<u32>,

    /// Thin the point cloud evenly to N points [preset: as many as training pixels]
    #[arg(long, value_name = "N")]
    max_points: Option<usize>,

    /// Seed of every random choice [preset: 0]
    #[arg(long, value_name = "S")]
    seed: Option<u64>,

    /// Training views by name [default: split.json, or 4 views uniformly]
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    train_views: Option<Vec<String>>,

    /// Replace the run that --out holds
    #[arg(long)]
    overwrite: bool,

    #[command(flatten)]
    measure: MeasureArgs,
}

impl TrainArgs {
    pub fn run(self) -> Result<()> {
        let config = self.resolved_config()?;
        check_names(self.train_views.as_deref())?;
        let max_px = config
            .scene
            .max_size_px
            .unwrap_or(config.scene.max_width_px);
        let source = self.scene.clone().resolved()?.at_most(max_px);
        let out = self
            .out
            .unwrap_or_else(|| RunDir::default_path(&source.name(), &config));
        RunDir::check(&out, self.overwrite)?;
        // Before anything takes time or is written: a machine without an adapter is told at once,
        // and the same command works once it has one.
        let options = self.measure.options()?;
        let gpu = Gpu::open()?;
        eprintln!("adapter: {}", gpu.describe());

        let start = Instant::now();
        let scene = pipeline::load_scene(&source, &load_options(&config, self.train_views))?;
        let load_s = start.elapsed().as_secs_f64();
        check_scene(&scene, &config)?;
        options.check(&scene.test)?;
        for warning in &scene.warnings {
            eprintln!("warning: {warning}");
        }

        let run = RunDir::create(&out, &config, self.overwrite)?;
        let evaluation = pipeline::train(&gpu, &scene, &source, &config, load_s, &options, &run)?;
        super::print(&evaluation_table(&run.name(), &evaluation))?;
        eprintln!("wrote {}", run.root().display());
        Ok(())
    }

    fn resolved_config(&self) -> Result<Config> {
        let mut config = match (&self.config, &self.preset) {
            (Some(path), _) => Config::from_file(path)?,
            (None, Some(name)) => Config::preset(name)?,
            (None, None) => Config::preset(PRESETS[0].0)?,
        };
        for setting in &self.settings {
            config = config
                .set(setting)
                .map_err(|e| e.at(format!("--set {setting}")))?;
        }
        config.iterations = self.iterations.unwrap_or(config.iterations);
        config.seed = self.seed.unwrap_or(config.seed);
        config.scene.max_size_px = self.max_size.or(config.scene.max_size_px);
        config.scene.max_points = self.max_points.or(config.scene.max_points);
        config.validate()?;
        Ok(config)
    }
}

fn load_options(config: &Config, train_views: Option<Vec<String>>) -> LoadOptions {
    LoadOptions {
        max_width: config.scene.max_width_px,
        max_size: config.scene.max_size_px,
        train_views,
        n_train: config.scene.n_train,
        n_test: config.scene.n_test,
    }
}

fn check_names(train_views: Option<&[String]>) -> Result<()> {
    let names = train_views.unwrap_or_default();
    for (i, name) in names.iter().enumerate() {
        if name.is_empty() {
            return Err(Error::usage("--train-views holds an empty name")
                .way_out("separate the names by single commas"));
        }
        if names[..i].contains(name) {
            return Err(Error::usage(format!("--train-views names `{name}` twice")));
        }
    }
    Ok(())
}

fn check_scene(scene: &Scene, config: &Config) -> Result<()> {
    if config.views.count > 0 && scene.train.len() < MIN_TRAIN_VIEWS {
        return Err(Error::new(format!(
            "virtual views need {MIN_TRAIN_VIEWS} training views, there are {}",
            scene.train.len()
        ))
        .at(format!("scene `{}`", scene.name))
        .way_out("name more with --train-views, or train with --preset 3dgs"));
    }
    Ok(())
}
