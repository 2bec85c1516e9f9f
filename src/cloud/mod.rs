//! The point cloud is held against the photographs here: drawn into cameras ([`splat`]), cleared of
//! points that they contradict ([`carve`]), asked whether it belongs to them ([`agreement`]) and
//! which of its points they see ([`visibility`]).

pub mod agreement;
pub mod carve;
pub mod splat;
pub mod visibility;
