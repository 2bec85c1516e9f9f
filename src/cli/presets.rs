//! This is the command `gspotential presets`.

use clap::Args;

use crate::config::{Key, PRESETS, keys, reference, summary};
use crate::error::Result;
use crate::report::{Cell, Column, Table};

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
            let columns = [
                Column::text("preset", "preset"),
                Column::text("what", "what"),
            ];
            let mut presets = Table::new("presets", &columns);
            for (name, _) in PRESETS {
                presets.row([(*name).into(), summary(name).into()]);
            }
            format!("{presets}\n{}", difference_table(&keys()?))
        };
        super::print(&shown)
    }
}

/// Returns a table with a row for every key whose value the presets do not share and a column for
/// every preset.
fn difference_table(keys: &[Key]) -> Table {
    let presets = PRESETS.iter().map(|(name, _)| Column::quantity(name, name));
    let columns: Vec<Column> = std::iter::once(Column::text("key", "key"))
        .chain(presets)
        .collect();
    let mut table = Table::new("differences", &columns);
    for key in keys.iter().filter(|key| key.differs()) {
        let values = key.values.iter().map(|value| value.to_string().into());
        table.row(std::iter::once(Cell::from(&key.key)).chain(values));
    }
    table
}
