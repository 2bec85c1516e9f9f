//! Loading scenes from disk: every supported variant, every kind of bad input.

pub mod build;
mod cloud;
pub mod fixtures;
mod formats;
mod hostile;
mod images;
mod lens;
mod masks;
mod model;
mod npy;
mod ply;
mod real;
mod split;
mod transforms;
