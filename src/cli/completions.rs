//! This is the command `gspotential completions`.

use clap::{Args, CommandFactory};
use clap_complete::{Shell, generate};

use super::Cli;
use crate::error::Result;

const EXAMPLES: &str = "\
Examples:
  gspotential completions bash > ~/.local/share/bash-completion/completions/gspotential
  gspotential completions fish > ~/.config/fish/completions/gspotential.fish";

/// Print a shell's completion script
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CompletionsArgs {
    /// Shell that is to complete
    shell: Shell,
}

impl CompletionsArgs {
    pub(crate) fn run(self) -> Result<()> {
        let mut script = Vec::new();
        generate(
            self.shell,
            &mut Cli::command(),
            env!("CARGO_PKG_NAME"),
            &mut script,
        );
        super::print(&String::from_utf8_lossy(&script))
    }
}
