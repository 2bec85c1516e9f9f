//! Loading scenes from disk: every supported variant, every kind of bad input.

pub(crate) mod build;
mod cloud;
mod fitted;
pub(crate) mod fixtures;
mod formats;
mod hostile;
mod images;
mod jpeg;
mod lens;
mod lookup;
mod masks;
mod model;
mod npy;
mod ply;
mod priors;
mod real;
mod split;
mod transforms;
mod window;
