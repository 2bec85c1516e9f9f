//! The keys of the network that makes the Gaussians.

use super::declare::{any, at_least, positive, section, within};

section! {
    /// A network that makes the Gaussians of their first places (SplatFields, Mihajlovic et al. 2024): three convolutional decoders
    /// make planes of fixed noise, and perceptrons make of what a place sees in them where its Gaussian goes, its opacity, scales,
    /// rotation and colour. The network's parameters are trained in place of the Gaussians', on the CPU. The file has the Gaussians.
    struct GeneratorConfig {
        /// Trains the network in place of the Gaussians. Their set stays as it is, without densification, pruning, shell and partner, and
        /// colours have SH degree 0.
        enabled: bool = false, any();
        /// Side of the noise. A plane has eight times as many pixels a side.
        noise_side: u32 = 20, within(2.0, 128.0).unit("pixels");
        /// Learning rate at the start.
        lr_start: f64 = 8e-4, positive();
        /// Learning rate at the end; in between it falls exponentially.
        lr_end: f64 = 1.6e-6, positive();
        /// Weight of the mean distance of the Gaussians from the focus, in `R`.
        norm_weight: f64 = 0.01, at_least(0.0);
    }
}
