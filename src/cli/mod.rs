//! The commands. Logs go to stderr, tables to stdout.

mod eval;
mod measure;
mod render;
mod train;

use std::io::Write;

use clap::{Parser, Subcommand};

use crate::error::{Error, Result};

const EXAMPLES: &str = "\
Examples:
  gspotential train                                    the built-in scene
  gspotential train --scene scenes/garden --out runs/garden
  gspotential eval runs/garden
  gspotential render --model runs/garden/point_cloud.ply --cameras runs/garden/cameras.json --out views

Exit codes: 0 done, 1 failed, 2 wrong usage.";

/// Trains a 3D Gaussian Splatting scene from a few posed photographs and a point cloud, guided
/// by a camera potential field.
#[derive(Debug, Parser)]
#[command(version, after_help = EXAMPLES, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Train(train::TrainArgs),
    Eval(eval::EvalArgs),
    Render(render::RenderArgs),
}

impl Cli {
    /// Runs the command that was given.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Train(args) => args.run(),
            Command::Eval(args) => args.run(),
            Command::Render(args) => args.run(),
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
