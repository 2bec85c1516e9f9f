//! Training: one real and one virtual view an iteration, Adam, densification.
//!
//! [`schedule`] says what an iteration does, [`optimizer`] steps the parameters on the GPU,
//! [`policy`] decides on the CPU which Gaussians come and go, [`trainer`] runs the loop; [`shell`]
//! is a background of Gaussians beyond the scene.

pub mod optimizer;
pub mod policy;
pub mod schedule;
pub mod shell;
pub mod trainer;

pub use trainer::{Observer, PlanRecord, Supervision, Trained, Trainer, TrainingView, train};
