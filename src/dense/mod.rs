//! Cameras are refined here, and one cloud is made from the depth maps of several views.

mod adjust;
mod cloud;
mod depth;
mod edges;
mod luma;
mod normals;

pub use adjust::{Adjusted, adjust};
pub use cloud::{Cloud, CloudOptions, cloud};
pub use depth::{DepthMap, scale_of_cameras, scale_to_points};
pub use normals::normals;
