//! This is the command `gspotential eval`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::measure::MeasureArgs;
use crate::error::{Error, Result};
use crate::eval::{Alignment, EvalOptions};
use crate::files::write_file;
use crate::pipeline;
use crate::report::{
    ComparedRun, Comparison, check_protocols, evaluation_table, runs_csv, runs_json,
};
use crate::run::RunDir;
use crate::scene::SceneSource;

const EXAMPLES: &str = "\
Examples:
  gspotential eval runs/garden
  gspotential eval runs/* --lpips-weights lpips_vgg.safetensors --csv runs.csv > table.md
  gspotential eval runs/garden-* --html garden.html
  gspotential eval runs/garden --align fit
  gspotential eval runs/garden --scene /mnt/elsewhere/garden

A run is rendered and measured unless its eval.json is that of its model, config and scene as they
are, of this version, and has what is asked for. PSNR and SSIM are 3DGS's. n/a: not measured.

LPIPS needs the weights of its net, a file that is made once, with PyTorch:
  python -c \"import lpips, safetensors.torch as s; s.save_file({k: v.clone() for k, v in
    lpips.LPIPS(net='vgg').state_dict().items()}, 'lpips_vgg.safetensors')\"";

/// Measure runs at their test views and print a Markdown table
///
/// The table of one run has every test view; that of several compares their means by scene and
/// method. Each run's figures go to its eval.json, too, the renders to its test/, and all of it to
/// its report.html.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct EvalArgs {
    /// Run directories that `gspotential train` wrote
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,

    /// The folder to which the runs' scene has moved since it was trained on
    ///
    /// It is checked to be the same scene: names, sizes, lenses and poses of the views, and the
    /// cloud.
    #[arg(long, value_name = "DIR")]
    scene: Option<PathBuf>,

    #[command(flatten)]
    measure: MeasureArgs,

    /// How the test cameras come into the model's frame
    #[arg(long, value_name = "HOW", value_enum, default_value_t = Alignment::Shared)]
    align: Alignment,

    /// Measure again even what is up to date
    #[arg(long)]
    again: bool,

    /// Write everything that is known of the runs as JSON, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Write a line a run as CSV, too
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,

    /// Write one page that compares the runs, with their renders, too
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,

    /// Replace the files of --json, --csv and --html
    #[arg(long)]
    overwrite: bool,
}

impl EvalArgs {
    pub(crate) fn run(self) -> Result<()> {
        // Whatever can be refused is, before the first run is rendered.
        let runs = self.open_runs()?;
        self.check_outputs()?;
        let options = EvalOptions {
            align: self.align,
            ..self.measure.options()?
        };
        let mut compared = Vec::with_capacity(runs.len());
        for run in &runs {
            let evaluation = match self.at_hand(run, &options)? {
                Some(evaluation) => evaluation,
                None => {
                    log::info!("measuring {}", run.root().display());
                    pipeline::evaluate(run, &options)?
                }
            };
            compared.push(ComparedRun::new(run, evaluation)?);
        }
        let table = match compared.as_slice() {
            [only] => evaluation_table(only.name(), &only.evaluation),
            several => Comparison::new(several)?.to_string(),
        };
        super::print(&table)?;
        if let Some(path) = &self.json {
            write_file(path, &runs_json(&compared)?)?;
        }
        if let Some(path) = &self.csv {
            write_file(path, &runs_csv(&compared)?)?;
        }
        if let Some(path) = &self.html {
            pipeline::compare(&runs.iter().collect::<Vec<_>>(), path)?;
            log::info!("wrote {}", path.display());
        }
        Ok(())
    }

    fn at_hand(
        &self,
        run: &RunDir,
        options: &EvalOptions,
    ) -> Result<Option<crate::run::Evaluation>> {
        // Its page is made with the renders.
        if self.again || !run.report().is_file() {
            return Ok(None);
        }
        pipeline::evaluation_at_hand(run, options)
    }

    fn open_runs(&self) -> Result<Vec<RunDir>> {
        let mut runs = Vec::with_capacity(self.runs.len());
        let mut protocols = Vec::with_capacity(self.runs.len());
        let mut seen = Vec::with_capacity(self.runs.len());
        let scene = self.scene.as_deref().map(moved_scene).transpose()?;
        for root in &self.runs {
            let mut run = RunDir::open(root)?;
            if let Some(dir) = &scene {
                run = run.with_scene_in(dir);
            }
            let full = root.canonicalize().unwrap_or_else(|_| root.clone());
            if seen.contains(&full) {
                return Err(Error::usage("is named twice").at_path(root));
            }
            seen.push(full);
            let of_scene = run.metrics()?.scene.pose_protocol;
            protocols.push((run.name(), self.align.protocol(of_scene)));
            runs.push(run);
        }
        check_protocols(protocols.iter().map(|(name, p)| (name.as_str(), *p)))?;
        Ok(runs)
    }

    fn check_outputs(&self) -> Result<()> {
        let outputs = [
            ("--json", &self.json),
            ("--csv", &self.csv),
            ("--html", &self.html),
        ];
        for (i, (option, path)) in outputs.iter().enumerate() {
            let Some(path) = path else { continue };
            let mut before = outputs[..i].iter();
            if let Some((other, _)) = before.find(|(_, p)| p.as_deref() == Some(path.as_path())) {
                return Err(Error::usage(format!(
                    "{other} and {option} name the same file"
                )));
            }
            super::check_output(path, self.overwrite)?;
        }
        Ok(())
    }
}

/// Returns the absolute folder that `--scene` names.
fn moved_scene(dir: &Path) -> Result<PathBuf> {
    match SceneSource::Folder(dir.to_owned()).resolved()? {
        SceneSource::Folder(dir) => Ok(dir),
        SceneSource::Builtin { .. } | SceneSource::Object { .. } => {
            Err(Error::usage("the built-in scene is everywhere"))
        }
    }
}
