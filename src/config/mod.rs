//! The configuration has its keys, the presets, overrides and checks here.
//!
//! Every key is declared once, in `schema.rs`: its type, default, range, unit and meaning. The
//! defaults are the preset `paper`. Another preset is a JSON file in `configs/` that states what it
//! changes; so is a user's config file, which names under `"preset"` what it changes.

mod declare;
mod floaters;
mod generator;
mod need;
mod overlay;
mod partner;
mod prior;
mod reference;
mod schema;
mod unpool;
mod validate;

pub use declare::{Allowed, Interval, Rule};
pub use floaters::FloatersConfig;
pub use generator::GeneratorConfig;
pub use need::NeedConfig;
pub use overlay::{Difference, PRESETS};
pub use partner::PartnerConfig;
pub use prior::{NormalAxes, PriorConfig, PriorDepths, PriorLoss, PriorSource, RenderedDepth};
pub use reference::{Key, keys, reference, summary};
pub use schema::*;
pub use unpool::UnpoolConfig;
