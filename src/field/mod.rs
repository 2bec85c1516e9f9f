//! The camera potential field: pseudo-focus, sphere, information and confidence potentials.

mod focus;
pub mod gaps;
mod outlook;
mod potential;

pub use focus::Focus;
pub use outlook::Outlook;
pub use potential::{Coverage, Field, angle, fibonacci_sphere};
