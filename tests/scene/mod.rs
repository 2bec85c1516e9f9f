//! Loading scenes from disk: every supported variant, every kind of bad input.

pub mod build;
mod cloud;
mod images;
mod masks;
mod model;
mod ply;
mod real;
mod split;
