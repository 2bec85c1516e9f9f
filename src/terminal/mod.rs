//! The terminal shows the log ([`logging`]), progress ([`progress`]) and tables.

pub mod logging;
pub mod progress;
pub mod table;

pub use table::Table;
