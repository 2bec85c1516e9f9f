//! The camera potential field: pseudo-focus, sphere, information and confidence potentials.

mod focus;
mod potential;

pub use focus::Focus;
pub use potential::{Coverage, Field, angle, fibonacci_sphere};
