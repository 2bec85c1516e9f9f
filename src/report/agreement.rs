//! This module writes the agreement of cloud and training views as a table.

use super::{Column, Table};
use crate::cloud::agreement::{Agreement, Colors};

/// Returns in Markdown which share of the cloud each training view sees and how far its colours are
/// the photograph's.
pub fn agreement_table(agreement: &Agreement) -> String {
    let columns = [
        Column::text("view", "training view"),
        Column::quantity("in_front", "points in front"),
        Column::quantity("in_image", "in the image"),
        Column::quantity("colours", "colours"),
        Column::quantity("by_chance", "by chance"),
        Column::quantity("verdict", "the cloud"),
    ];
    let mut table = Table::new("agreement", &columns);
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let colors = |colors: Option<Colors>, of: fn(Colors) -> f64| {
        colors.map_or_else(|| "-".to_owned(), |c| format!("{:.2}", of(c)))
    };
    for view in &agreement.views {
        table.row([
            view.name.escape_debug().to_string().into(),
            percent(view.in_front).into(),
            percent(view.in_image).into(),
            colors(view.colors, |c| c.agreement).into(),
            colors(view.colors, |c| c.chance).into(),
            view.verdict.name().into(),
        ]);
    }
    format!(
        "{table}\nColours: correlation of the nearest points' with the photograph's; by chance: what nine in ten \
         shifts of the photograph stay below.\n"
    )
}
