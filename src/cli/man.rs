//! This is the command `gspotential man`.

use std::path::PathBuf;

use clap::{Args, Command, CommandFactory};
use clap_mangen::Man;

use super::Cli;
use crate::error::{Error, Result};
use crate::files::{create_dir, write_file};

const EXAMPLES: &str = "\
Examples:
  gspotential man ~/.local/share/man/man1              then `man gspotential-train` shows it";

/// Write the manual's pages
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ManArgs {
    /// Folder for the pages, one a command; files of the same names are replaced
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl ManArgs {
    pub(crate) fn run(self) -> Result<()> {
        let mut root = Cli::command().disable_help_subcommand(true);
        root.build();
        create_dir(&self.folder)?;
        let pages = std::iter::once(&root).chain(root.get_subcommands());
        let mut n = 0;
        for command in pages {
            self.write(command)?;
            n += 1;
        }
        log::info!("wrote {n} pages to {}", self.folder.display());
        Ok(())
    }

    fn write(&self, command: &Command) -> Result<()> {
        let man = Man::new(command.clone());
        let path = self.folder.join(man.get_filename());
        let mut page = Vec::new();
        man.render(&mut page)
            .map_err(|e| Error::new(format!("cannot be written: {e}")).at_path(&path))?;
        write_file(&path, &page)
    }
}
