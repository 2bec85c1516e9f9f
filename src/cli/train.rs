//! This is the command `gspotential train`.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use clap::Args;

use super::budget::{Budget, Decibels};
use super::dry_run;
use super::measure::MeasureArgs;
use crate::config::{Config, PRESETS};
use crate::error::{Error, Result};
use crate::live::Live;
use crate::pipeline::{self, GoOn, PriorOptions, Resumed, TrainJob, profile_tables};
use crate::report::evaluation_table;
use crate::run::{Evaluation, RunDir, VirtualImages};
use crate::scene::{CloudSource, SceneSource};

const EXAMPLES: &str = "\
Examples:
  gspotential train
  gspotential train --scene scenes/garden --max-size 320 --iterations 1000
  gspotential train --scene scenes/garden --preset 3dgs --out runs/baseline
  gspotential train --set views.count=64 --set loss.ssim_weight=0.3
  gspotential train --virtual-images repaired          images made of those that `render` wrote
  gspotential train --resume runs/garden
  gspotential train --watch                            and look on in the browser

A config file is a JSON object that states what it changes, as in
  {\"preset\": \"paper\", \"iterations\": 3000, \"views\": {\"count\": 64}}
The config.json of any run is one, too, and lists every key. Later wins: preset, file, --set,
then the options of their own (--iterations, --gaussians, --max-size, --max-points, --seed).";

/// Train a scene and evaluate it at its test views
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct TrainArgs {
    /// Scene folder, as COLMAP, VGGT, MASt3R, InstantSplat, GaussianObject, nerfstudio or
    /// instant-ngp write it, or `builtin[:WIDTH]` for the scene that the program makes itself, or
    /// `builtin:object[:WIDTH]` for its object with masks
    #[arg(long, value_name = "DIR", default_value = "builtin")]
    scene: SceneSource,

    /// Make the scene from the photographs in this folder first, as `gspotential scene` does; it
    /// becomes the folder DIR-scene beside them
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scene", "cloud", "dry_run"])]
    photographs: Option<PathBuf>,

    /// Weights of the network that finds their cameras; `gspotential scene --help` says which
    #[arg(long, value_name = "FILE", requires = "photographs")]
    weights: Option<PathBuf>,

    /// Run directory to write [default: runs/<scene>-<preset>-seed<seed>]
    #[arg(long, value_name = "RUN")]
    out: Option<PathBuf>,

    /// Preset to start from: `gspotential`, our best, `paper`, the paper's method, `3dgs`, its
    /// baseline, or another that `gspotential presets` lists [default: gspotential]
    #[arg(long, value_name = "NAME", conflicts_with = "config")]
    preset: Option<String>,

    /// Config file to start from
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// Change one config value; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,

    /// Train for N iterations; the default ends when views that it holds out have stopped rising: 700 at most, 175 a photograph where they are more than four
    #[arg(long, value_name = "N")]
    iterations: Option<u32>,

    /// Start from N Gaussians of the cloud and prune none for contributing little; the default decides
    #[arg(long, value_name = "N", conflicts_with = "max_points")]
    gaussians: Option<usize>,

    /// Keep within a size or a time, or both if given twice, as in 20MB or 3min: what contributes least goes until the
    /// file fits; training has as many iterations as the first ones say there is time for
    #[arg(long, value_name = "BUDGET")]
    budget: Vec<Budget>,

    /// Let pruning cost at most DB dB of the views that decide, and end when half as many iterations more would bring them
    /// less [preset: 0.05dB]
    #[arg(long, value_name = "DB")]
    tolerance: Option<Decibels>,

    /// Scale images down until their longer side is PX pixels [preset: 1600 wide]
    #[arg(long, value_name = "PX")]
    max_size: Option<u32>,

    /// Thin the point cloud evenly to N points [default: one for four training pixels; literal presets: one for each]
    #[arg(long, value_name = "N")]
    max_points: Option<usize>,

    /// Refine the poses of the training cameras with the Gaussians; cameras.json has them then
    #[arg(long)]
    refine_poses: bool,

    /// Seed of every random choice [preset: 0]
    #[arg(long, value_name = "S")]
    seed: Option<u64>,

    /// Training views by name [default: split.json, or 4 views uniformly]
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    train_views: Option<Vec<String>>,

    /// Test views by name [default: split.json, or up to 60 of the others uniformly]
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    test_views: Option<Vec<String>>,

    /// Another cloud than the scene's own: a file in the scene folder or elsewhere, `random`
    /// points, `views:N` for one of the first N views (of the built-in scene, or as `scene` makes them), or
    /// `exact` for the built-in scene's without errors
    #[arg(long, value_name = "FILE")]
    cloud: Option<CloudSource>,

    /// Images that virtual views show in place of the cloud, under the names that `render` gave them; a view without an
    /// image keeps what it has, and a camera of views.json beside them that the run lacks becomes one more view
    #[arg(long, value_name = "DIR")]
    virtual_images: Option<PathBuf>,

    /// Multiply the weight of those views by W
    #[arg(
        long,
        value_name = "W",
        requires = "virtual_images",
        default_value_t = 1.0
    )]
    virtual_images_weight: f64,

    /// Measure at the test views every N iterations, too, for the curve in metrics.json; training
    /// itself stays as it is, bit for bit
    #[arg(long, value_name = "N")]
    eval_every: Option<NonZeroU32>,

    /// Iterations between two checkpoints [default: by time, about a minute]
    #[arg(long, value_name = "N")]
    checkpoint_every: Option<NonZeroU32>,

    /// Replace the run that --out holds
    #[arg(long)]
    overwrite: bool,

    /// Go on with a run that was stopped, with everything as it was started; how it is measured
    /// may be said again
    #[arg(long, value_name = "RUN", conflicts_with_all = [
        "scene", "photographs", "weights", "out", "preset", "config", "settings", "iterations", "gaussians", "budget", "tolerance", "max_size", "max_points",
        "seed", "refine_poses", "train_views", "test_views", "cloud", "virtual_images", "eval_every", "overwrite",
        "dry_run",
    ])]
    resume: Option<PathBuf>,

    /// Load the scene, take the first iterations, print what the run would take, and write nothing
    #[arg(long)]
    dry_run: bool,

    /// Take the time of every stage and, in every 50th iteration, of every GPU kernel: two tables,
    /// and RUN/profile.json; what is trained stays as it is, bit for bit
    #[arg(long, conflicts_with = "dry_run")]
    profile: bool,

    /// Show the training as it runs in the browser, at an address of this machine that is printed first: progress,
    /// curves, the scene to turn, views beside photographs; on a PORT of 127.0.0.1, or any that is free. What is
    /// trained stays as it is, bit for bit
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "0",
          conflicts_with = "dry_run")]
    watch: Option<u16>,

    #[command(flatten)]
    measure: MeasureArgs,
}

impl TrainArgs {
    pub(crate) fn run(mut self) -> Result<()> {
        let checkpoint_every = self.checkpoint_every.map(NonZeroU32::get);
        if let Some(root) = &self.resume {
            let watch = self.watch.map(Live::serve).transpose()?;
            let how = GoOn {
                checkpoint_every,
                profile: self.profile,
                watch,
            };
            return match TrainJob::resume(root, how, &self.measure.options()?)? {
                Resumed {
                    run,
                    evaluation: Some(evaluation),
                } => report(&run, &evaluation, self.profile),
                Resumed {
                    run,
                    evaluation: None,
                } => {
                    let root = run.root().display();
                    log::info!("{root} is finished; nothing is left to do");
                    Ok(())
                }
            };
        }
        let config = self.resolved_config()?;
        check_names("--train-views", self.train_views.as_deref())?;
        check_names("--test-views", self.test_views.as_deref())?;
        let watch = self.watch.map(Live::serve).transpose()?;
        if let Some(photographs) = &self.photographs {
            self.scene = SceneSource::Folder(make_scene(photographs, self.weights.clone())?);
        }
        let job = TrainJob::new(self.scene.clone(), config)?;
        let job = TrainJob {
            cloud: match self.cloud {
                Some(cloud) => Some(cloud.resolved(&job.source)?),
                None => None,
            },
            virtual_images: virtual_images(self.virtual_images, self.virtual_images_weight)?,
            train_views: self.train_views,
            test_views: self.test_views,
            eval_every: self.eval_every.map(NonZeroU32::get),
            checkpoint_every,
            profile: self.profile,
            watch,
            ..job
        };
        let out = self
            .out
            .unwrap_or_else(|| RunDir::default_path(&job.source.name(), &job.config));
        if self.dry_run {
            RunDir::check(&out, self.overwrite)?;
            return super::print(&dry_run::text(&pipeline::dry_run(&job)?));
        }
        let (run, evaluation) = job.run(&out, self.overwrite, &self.measure.options()?)?;
        report(&run, &evaluation, self.profile)
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
        if let Some(iterations) = self.iterations {
            config.iterations = iterations;
            config.need.ends = false;
        }
        if let Some(n) = self.gaussians {
            config.scene.max_points = Some(n);
            config.need.prune = false;
        }
        for budget in &self.budget {
            match *budget {
                Budget::Megabytes(most) => config.need.max_mb = Some(most),
                Budget::Seconds(most) => config.need.max_s = Some(most),
            }
        }
        if let Some(Decibels(db)) = self.tolerance {
            config.need.tolerance_db = db;
            config.need.least_gain_db = db;
        }
        config.seed = self.seed.unwrap_or(config.seed);
        config.scene.max_size_px = self.max_size.or(config.scene.max_size_px);
        config.scene.max_points = self.max_points.or(config.scene.max_points);
        config.poses.refine |= self.refine_poses;
        config.validate()?;
        Ok(config)
    }
}

fn report(run: &RunDir, evaluation: &Evaluation, profile: bool) -> Result<()> {
    super::print(&evaluation_table(&run.name(), evaluation))?;
    if profile {
        super::print(&format!("\n{}", profile_tables(&run.profile()?)))?;
    }
    log::info!("wrote {}", run.root().display());
    Ok(())
}

/// Makes a scene of the photographs in a folder, beside it, and returns the scene's folder.
fn make_scene(photographs: &Path, weights: Option<PathBuf>) -> Result<PathBuf> {
    let folder = photographs.canonicalize().map_err(|e| {
        Error::new(format!("cannot open the photographs: {e}")).at_path(photographs)
    })?;
    let name = folder
        .file_name()
        .map_or_else(Default::default, |name| name.to_os_string());
    let mut scene_name = name;
    scene_name.push("-scene");
    let scene = folder.with_file_name(scene_name);
    if scene.exists() {
        return Err(Error::new("is there already")
            .at_path(&scene)
            .way_out(format!(
                "train on it with --scene {}, or remove it",
                scene.display()
            )));
    }
    let options = PriorOptions {
        weights,
        ..PriorOptions::default()
    };
    pipeline::scene_of_photographs(&[folder], &options, &scene)?;
    Ok(scene)
}

/// Returns the images that virtual views show, their folder made absolute.
fn virtual_images(folder: Option<PathBuf>, weight: f64) -> Result<Option<VirtualImages>> {
    let Some(folder) = folder else {
        return Ok(None);
    };
    if !(weight.is_finite() && weight > 0.0) {
        return Err(Error::usage(format!(
            "--virtual-images-weight is {weight}, but must be above 0"
        )));
    }
    let absolute = folder.canonicalize().map_err(|e| {
        Error::new(format!("cannot open the images of virtual views: {e}")).at_path(&folder)
    })?;
    if !absolute.is_dir() {
        return Err(Error::usage("is not a folder").at_path(&folder));
    }
    Ok(Some(VirtualImages {
        folder: absolute.display().to_string(),
        weight,
    }))
}

fn check_names(option: &str, names: Option<&[String]>) -> Result<()> {
    let names = names.unwrap_or_default();
    for (i, name) in names.iter().enumerate() {
        if name.is_empty() {
            return Err(Error::usage(format!("{option} holds an empty name"))
                .way_out("separate the names by single commas"));
        }
        if names[..i].contains(name) {
            return Err(Error::usage(format!("{option} names `{name}` twice")));
        }
    }
    Ok(())
}
