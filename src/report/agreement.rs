//! This module writes the agreement of cloud and training views as a table.

use crate::cloud::agreement::{Agreement, Colors};
use crate::terminal::Table;

/// Returns in Markdown which share of the cloud each training view sees and how far its colours are
/// the photograph's.
pub fn agreement_table(agreement: &Agreement) -> String {
    let mut table = Table::new(&[
        "training view",
        "points in front",
        "in the image",
        "colours",
        "by chance",
        "the cloud",
    ]);
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let colors = |colors: Option<Colors>, of: fn(Colors) -> f64| {
        colors.map_or_else(|| "-".to_owned(), |c| format!("{:.2}", of(c)))
    };
    for view in &agreement.views {
        table.row(&[
            view.name.escape_debug().to_string(),
            percent(view.in_front),
            percent(view.in_image),
            colors(view.colors, |c| c.agreement),
            colors(view.colors, |c| c.chance),
            view.verdict.name().to_owned(),
        ]);
    }
    format!(
        "{table}\nColours: correlation of the nearest points' with the photograph's; by chance: what nine in ten \
         shifts of the photograph stay below.\n"
    )
}
