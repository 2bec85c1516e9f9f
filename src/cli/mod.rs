//! The commands live here. Logs go to stderr, tables to stdout.

mod budget;
mod completions;
mod doctor;
mod dry_run;
mod eval;
mod export;
mod field;
mod machine;
mod man;
mod measure;
mod presets;
mod render;
mod scene;
mod study;
mod train;
mod view;

use std::io::Write;
use std::path::Path;

use clap::{Parser, Subcommand};

use crate::error::{Error, Result};
use crate::version::WITH_COMMIT;

const EXAMPLES: &str = "\
Examples:
  gspotential train                                    the built-in scene
  gspotential scene photographs/ --weights model.safetensors --out scenes/garden
  gspotential train --scene scenes/garden --out runs/garden
  gspotential view runs/garden                         turn it in the browser
  gspotential field --scene scenes/garden              where photographs are missing
  gspotential eval runs/garden
  gspotential render --model runs/garden/point_cloud.ply --cameras runs/garden/cameras.json --out views
  gspotential doctor                                   is this machine's adapter right?

Exit codes: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C or SIGTERM.";

/// Trains a 3D Gaussian Splatting scene from a few posed photographs and a point cloud, guided
/// by a camera potential field.
#[derive(Debug, Parser)]
#[command(version = WITH_COMMIT, after_help = EXAMPLES, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,

    #[command(flatten)]
    machine: machine::Machine,
}

#[derive(Debug, Subcommand)]
enum Command {
    Scene(scene::SceneArgs),
    Train(Box<train::TrainArgs>),
    View(view::ViewArgs),
    Eval(eval::EvalArgs),
    Field(field::FieldArgs),
    Render(render::RenderArgs),
    Study(study::StudyArgs),
    Doctor(doctor::DoctorArgs),
    Export(export::ExportArgs),
    Presets(presets::PresetsArgs),
    ListAdapters(machine::AdaptersArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
}

impl Cli {
    /// Runs the command that was given.
    pub fn run(self) -> Result<()> {
        self.machine.prepare()?;
        match self.command {
            Command::Scene(args) => args.run(),
            Command::Train(args) => args.run(),
            Command::View(args) => args.run(),
            Command::Eval(args) => args.run(),
            Command::Field(args) => args.run(),
            Command::Render(args) => args.run(),
            Command::Study(args) => args.run(),
            Command::Doctor(args) => args.run(),
            Command::Export(args) => args.run(),
            Command::Presets(args) => args.run(),
            Command::ListAdapters(args) => args.run(),
            Command::Completions(args) => args.run(),
            Command::Man(args) => args.run(),
        }
    }
}

/// Prints to stdout. A reader that has gone, as `head` does, is no failure.
fn print(text: &str) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush())
    {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::new(format!("cannot write: {e}")).at("stdout"))
        }
        _ => Ok(()),
    }
}

/// Refuses an output file that may not be written, before anything takes time.
fn check_output(path: &Path, overwrite: bool) -> Result<()> {
    if path.is_dir() {
        return Err(Error::usage("is a folder").at_path(path));
    }
    if path.exists() && !overwrite {
        return Err(Error::new("is there already")
            .at_path(path)
            .way_out("name another file, or replace it with --overwrite"));
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    match folder {
        Some(folder) if !folder.is_dir() => {
            Err(Error::new("its folder is not there").at_path(path))
        }
        _ => Ok(()),
    }
}
