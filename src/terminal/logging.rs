//! This module writes messages to stderr: lines for people, or one JSON object a line for programs.
//!
//! | level | fields of the object |
//! |---|---|
//! | `info`, `warning`, `error`, `stopped` | `message` |
//! | `page` | `address` |
//! | `progress` | `stage`, `done`, `total`, `per_second`, `seconds_left`; in training `loss` and `gaussians` |

use std::io::Write;
use std::sync::OnceLock;

use log::{Level, LevelFilter, Log, Metadata, Record};
use serde_json::json;

use crate::error::{Error, ErrorKind};

/// How a message is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Style {
    /// Lines for people; a bar on a terminal.
    #[default]
    Text,
    /// One object a line.
    Json,
}

static STYLE: OnceLock<Style> = OnceLock::new();

/// Sends messages and progress to stderr; `quiet` leaves warnings and errors. What libraries log is
/// dropped. A second call changes nothing.
pub fn start(style: Style, quiet: bool) {
    if STYLE.set(style).is_ok() && log::set_boxed_logger(Box::new(Stderr { style })).is_ok() {
        log::set_max_level(if quiet {
            LevelFilter::Warn
        } else {
            LevelFilter::Info
        });
    }
}

/// Returns the style that [`start`] has set.
pub fn style() -> Style {
    STYLE.get().copied().unwrap_or_default()
}

/// The level of what is no trouble: its lines say nothing of it.
const INFO: &str = "info";

struct Stderr {
    style: Style,
}

impl Log for Stderr {
    fn enabled(&self, metadata: &Metadata) -> bool {
        metadata.target().starts_with(env!("CARGO_CRATE_NAME"))
    }

    fn log(&self, record: &Record) {
        if self.enabled(record.metadata()) {
            let level = match record.level() {
                Level::Error => "error",
                Level::Warn => "warning",
                _ => INFO,
            };
            let line = line(self.style, level, &record.args().to_string());
            // Work goes on when nobody can read how it does.
            let _ = writeln!(std::io::stderr(), "{line}");
        }
    }

    fn flush(&self) {}
}

/// Says why the program ends before its work is done, however quiet it is otherwise.
pub fn end(error: &Error) {
    let name = match error.kind() {
        ErrorKind::Interrupted => "stopped",
        _ => "error",
    };
    // There is nobody left to tell where this fails.
    let _ = writeln!(
        std::io::stderr(),
        "{}",
        line(style(), name, &error.to_string())
    );
}

/// Says at which address a page is, however quiet the program is otherwise: without its address
/// nobody can open it.
pub fn page(address: &str) {
    let line = match style() {
        Style::Json => json!({ "level": "page", "address": address }).to_string(),
        Style::Text => format!("page: {address}"),
    };
    // Work goes on when nobody can read how it does.
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Returns a message of a level as a line, without the line's end.
pub fn line(style: Style, level: &str, message: &str) -> String {
    match style {
        Style::Json => json!({ "level": level, "message": message }).to_string(),
        Style::Text if level == INFO => message.to_owned(),
        Style::Text => format!("{level}: {message}"),
    }
}
