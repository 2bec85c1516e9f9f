//! The point cloud is held against the photographs here: drawn into cameras ([`splat`]), cleared of
//! points that they contradict ([`carve`]), asked whether it belongs to them ([`agreement`]), which of
//! its points they see ([`visibility`]), what of them is far ([`far`]) and what the photographs show in
//! its place ([`warp`]), and how far a cut-out subject reaches ([`outline`]); or it is made of the masks alone ([`hull`]).

pub mod agreement;
pub mod carve;
pub mod far;
pub mod hull;
pub mod outline;
pub mod splat;
pub mod visibility;
pub mod warp;
