//! The `gspotential` command: parse, dispatch, exit code.

use std::process::ExitCode;

use clap::Parser;
use gspotential::cli::Cli;

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
