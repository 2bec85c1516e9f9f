//! The point cloud against the photographs: drawn into cameras ([`splat`]), cleared of points that
//! they contradict ([`carve`]), and asked which of its points they see ([`visibility`]).

pub mod carve;
pub mod splat;
pub mod visibility;
