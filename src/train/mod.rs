//! Training takes one real and one virtual view an iteration, with Adam and densification.
//!
//! [`schedule`] says what an iteration does, [`optimizer`] steps the parameters on the GPU,
//! [`policy`] decides on the CPU which Gaussians come and go, [`trainer`] runs the loop and tells
//! an [`observer`], and [`checkpoint`] takes it apart and puts it together again between two
//! iterations. [`supervision`] is what they learn from, [`capacity`] says what that takes, [`shell`]
//! is a background of Gaussians beyond the scene, [`pose_adam`] moves cameras, where they are
//! refined, `depths` holds training views to depths and normals, [`guide`] chooses whom dropout leaves out, a [`partner`] is a second set of Gaussians, [`unpool`] fills gaps between large ones, [`floaters`] go, a [`generator`] makes the Gaussians, and what the scene needs is
//! decided by virtual views that nothing is learned from ([`SignalPoint`]): [`length`] says when training ends,
//! [`trim`] which Gaussians it can do without, `lower` which SH degrees.

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
