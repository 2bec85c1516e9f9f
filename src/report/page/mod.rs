//! `report.html` shows a run, or several, as one file that needs no server and no network.
//!
//! What the pages say is read from the run directory; markup is escaped by `maud`, what the
//! scripts read by [`json`].

mod comparison;
mod curves;
mod data;
mod live_page;
mod packed;
mod picture;
mod run_page;

pub use comparison::{SceneRuns, write_comparison};
pub use live_page::{Course, LivePage, live_asset, live_gaussians, live_photograph};
pub use run_page::write_run_page;

use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde::Serialize;

use crate::error::{Error, Result};
use crate::report::Table;

const STYLE: &str = include_str!("style.css");

/// Whatever a page shows is within it, and nothing that a name smuggles in is fetched.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// Returns a whole page; `scripts` run in order, after the body is there.
fn document(title: &str, body: Markup, scripts: &[&str]) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                main { (body) }
                @for script in scripts {
                    script { (PreEscaped(*script)) }
                }
            }
        }
    }
    .into_string()
}

/// Writes `value` for a script of type `application/json`. Within such an element only `<` could
/// end it or open another, and JSON has it in strings alone.
fn json(value: &impl Serialize) -> Result<PreEscaped<String>> {
    let text = serde_json::to_string(value).map_err(|e| Error::new(e.to_string()))?;
    Ok(PreEscaped(text.replace('<', "\\u003c")))
}

/// Returns a table as HTML; cells in Markdown's bold are bold.
fn table(table: &Table) -> Markup {
    let cell = |text: &String| {
        let bold = text.strip_prefix("**").and_then(|t| t.strip_suffix("**"));
        html! { @match bold { Some(text) => strong { (text) }, None => (text) } }
    };
    html! {
        div.wide { table {
            @for (i, row) in table.shown().iter().enumerate() {
                tr { @for text in row {
                    @if i == 0 { th { (text) } } @else { td { (cell(text)) } }
                } }
            }
        } }
    }
}
