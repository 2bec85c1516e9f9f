//! This is the command `gspotential presets`.

use clap::Args;

use crate::config::{Key, PRESETS, keys, reference, summary};
use crate::error::Result;
use crate::terminal::Table;

const EXAMPLES: &str = "\
Examples:
  gspotential presets
  gspotential presets --keys > keys.md";

/// List the presets and where they differ, or every config key
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct PresetsArgs {
    /// List every key with its value in each preset and what it means
    #[arg(long)]
    keys: bool,
}

impl PresetsArgs {
    pub(crate) fn run(self) -> Result<()> {
        let shown = if self.keys {
            reference()?
        } else {
            let mut presets = Table::with_text(2, &["preset", "what"]);
            for (name, _) in PRESETS {
                presets.row(&[(*name).to_owned(), summary(name).to_owned()]);
            }
            format!("{presets}\n{}", difference_table(&keys()?))
        };
        super::print(&shown)
    }
}

/// Returns a table with a row for every key whose value the presets do not share and a column for
/// every preset.
fn difference_table(keys: &[Key]) -> Table {
    let names = PRESETS.iter().map(|(name, _)| *name);
    let header: Vec<&str> = std::iter::once("key").chain(names).collect();
    let mut table = Table::new(&header);
    for key in keys.iter().filter(|key| key.differs()) {
        let values = key.values.iter().map(ToString::to_string);
        let row: Vec<String> = std::iter::once(key.key.clone()).chain(values).collect();
        table.row(&row);
    }
    table
}
