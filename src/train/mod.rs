//! Training takes one real and one virtual view an iteration, with Adam and densification.
//!
//! | what | where |
//! |---|---|
//! | what is learned from | [`supervision`], [`DepthTarget`], [`Goal`] |
//! | the loop, what it notes, and who looks on | [`trainer`], [`LossSample`], [`observer`] |
//! | what an iteration does, by its number and the seed | [`schedule`] |
//! | steps of the parameters and of poses | [`optimizer`], [`pose_adam`] |
//! | which Gaussians come and go | [`policy`], [`unpool`], [`floaters`], [`outliers`] |
//! | what the scene needs, by views that nothing is learned from | `signal`, [`length`], [`trim`], `lower` |
//! | parts that presets switch on | [`shell`], [`guide`], [`partner`], [`generator`], `depths` |
//! | memory before it is taken; a run taken apart and put together | [`capacity`], [`checkpoint`] |

pub mod capacity;
pub mod checkpoint;
mod contribution;
mod depth_target;
mod depths;
mod dropout;
pub mod floaters;
mod generating;
pub mod generator;
mod goal;
pub mod guide;
pub mod length;
mod lower;
pub mod observer;
pub mod optimizer;
pub mod outliers;
pub mod partner;
mod partnered;
pub mod policy;
pub mod pose_adam;
mod poses;
mod record;
mod refine;
mod room;
pub mod schedule;
pub mod shell;
mod signal;
mod state;
pub mod supervision;
mod targets;
pub mod trainer;
pub mod trim;
pub mod unpool;

pub use capacity::TrainingBytes;
pub use checkpoint::fingerprint;
pub use depth_target::DepthTarget;
pub use depths::DepthLosses;
pub use generator::generator_bytes;
pub use goal::Goal;
pub use observer::Observer;
pub use pose_adam::PoseAdam;
pub use record::{
    ImageLoss, LossSample, Lowering, PlanCounts, PlanRecord, SignalPoint, Trained, Trim,
};
pub use refine::{RefinedPose, pose_rates};
pub use shell::Shell;
pub use state::State;
pub use supervision::{Supervision, TrainingView};
pub use trainer::{Trainer, TrainerSeconds, train};
