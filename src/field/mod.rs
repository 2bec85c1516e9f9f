//! The camera potential field has its pseudo-focus, sphere, information and confidence potentials
//! here.

mod focus;
pub mod gaps;
mod outlook;
mod potential;

pub use focus::Focus;
pub use outlook::Outlook;
pub use potential::{Coverage, Field, angle, fibonacci_sphere};
