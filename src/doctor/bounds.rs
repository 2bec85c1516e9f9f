//! The bounds of a view's comparisons.

/// Largest errors that pass.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Relative L2 of each number of the splats.
    pub projection: f64,
    /// Largest difference of an image off fragile pixels.
    pub image: f64,
    /// Relative L2 of each class of gradients.
    pub gradient: f64,
}
