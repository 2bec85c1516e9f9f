//! The terminal shows the log ([`logging`]) and progress ([`progress`]).

pub mod logging;
pub mod progress;
