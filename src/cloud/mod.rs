//! The point cloud is held against the photographs here: drawn into cameras ([`splat`]), cleared of
//! points that they contradict ([`carve`]), asked whether it belongs to them ([`agreement`]), which of
//! its points they see ([`visibility`]), and what the photographs show in its place ([`warp`]).

pub mod agreement;
pub mod carve;
pub mod splat;
pub mod visibility;
pub mod warp;
