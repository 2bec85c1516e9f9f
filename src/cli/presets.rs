//! `gspotential presets`

use clap::Args;

use crate::config::{Key, PRESETS, keys, summary};
use crate::error::Result;
use crate::report::Table;

const EXAMPLES: &str = "\
Examples:
  gspotential presets
  gspotential presets --keys > keys.md";

/// List the presets and where they differ, or every config key
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct PresetsArgs {
    /// List every key with its value in each preset and what it means
    #[arg(long)]
    keys: bool,
}

impl PresetsArgs {
    pub fn run(self) -> Result<()> {
        let keys = keys()?;
        let shown = if self.keys {
            key_table(&keys, true).to_string()
        } else {
            let mut presets = Table::new(&["preset", "what"]);
            for (name, _) in PRESETS {
                presets.row(&[(*name).to_owned(), summary(name).to_owned()]);
            }
            let differing: Vec<Key> = keys.into_iter().filter(Key::differs).collect();
            format!("{presets}\n{}", key_table(&differing, false))
        };
        super::print(&shown)
    }
}

fn key_table(keys: &[Key], documented: bool) -> Table {
    let mut header = vec!["key"];
    header.extend(PRESETS.iter().map(|(name, _)| *name));
    header.extend(documented.then_some("what"));
    let mut table = Table::new(&header);
    for key in keys {
        let mut row = vec![key.key.clone()];
        row.extend(key.values.iter().map(ToString::to_string));
        row.extend(documented.then(|| key.doc.clone()));
        table.row(&row);
    }
    table
}
