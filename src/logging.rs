//! Messages on stderr: lines for people, or one JSON object a line for programs.
//!
//! | level | fields of the object |
//! |---|---|
//! | `info`, `warning`, `error` | `message` |
//! | `progress` | `stage`, `done`, `total`, `per_second`, `seconds_left`; in training `loss` and `gaussians` |

use std::io::Write;
use std::sync::OnceLock;

use log::{Level, LevelFilter, Log, Metadata, Record};
use serde_json::json;

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

/// The style that [`start`] has set.
pub fn style() -> Style {
    STYLE.get().copied().unwrap_or_default()
}

struct Stderr {
    style: Style,
}

impl Log for Stderr {
    fn enabled(&self, metadata: &Metadata) -> bool {
        metadata.target().starts_with(env!("CARGO_CRATE_NAME"))
    }

    fn log(&self, record: &Record) {
        if self.enabled(record.metadata()) {
            let line = line(self.style, record.level(), &record.args().to_string());
            // Work goes on when nobody can read how it does.
            let _ = writeln!(std::io::stderr(), "{line}");
        }
    }

    fn flush(&self) {}
}

/// A message as a line, without its end.
pub fn line(style: Style, level: Level, message: &str) -> String {
    let name = match level {
        Level::Error => "error",
        Level::Warn => "warning",
        _ => "info",
    };
    match style {
        Style::Json => json!({ "level": name, "message": message }).to_string(),
        Style::Text if level <= Level::Warn => format!("{name}: {message}"),
        Style::Text => message.to_owned(),
    }
}
