//! This module has the keys of the depths and normals that training views are held to.

use super::declare::{any, at_least, choice, positive, section, within};

/// The most that a `u32` holds.
const U32: f64 = u32::MAX as f64;

section! {
    /// Depths and normals that the training views are held to beside their photographs.
    struct PriorConfig {
        /// Source of these depths and normals.
        source: PriorSource = PriorSource::None, any();
        /// What the files' depths are.
        depths: PriorDepths = PriorDepths::Metric, any();
        /// Depth of one level of a PNG, in the scene's unit.
        png_step: f64 = 0.001, positive();
        /// Axes of the files' normals.
        normal_axes: NormalAxes = NormalAxes::Opencv, any();
        /// The depth of a pixel that is compared.
        rendered: RenderedDepth = RenderedDepth::Expected, any();
        /// Compares inverse depths, as files of `inverse` depths always are.
        inverse: bool = false, any();
        /// The loss of depths over an image.
        loss: PriorLoss = PriorLoss::Pearson, any();
        /// Weight of that loss, against 1 of the photograph's.
        weight: f64 = 0.05, at_least(0.0);
        /// Weight of 1 less Pearson's correlation over square patches, in the mean.
        patch_weight: f64 = 0.0, at_least(0.0);
        /// Side of the patches; rounded up to a multiple of 4.
        patch_px: u32 = 128, within(8.0, 1024.0);
        /// Weight of 1 less the cosine to the normal, in the mean over pixels.
        normal_weight: f64 = 0.0, at_least(0.0);
        /// These losses end with this iteration.
        end: u32 = 1_000_000, within(1.0, U32).unit("iterations");
        /// Weight of the loss over the image from then on; 0: there is none.
        end_weight: f64 = 0.0, at_least(0.0);
    }
}

choice! {
    /// Source of depths and normals.
    enum PriorSource {
        /// There are none.
        None = "none",
        /// The nearest point of the cloud in every pixel that is covered and no edge; normals follow from
        /// neighbouring depths.
        Cloud = "cloud",
        /// Files of the photographs' names in the scene's folders `depths/`, `confidences/`, which need not
        /// be there, and, with a `normal_weight`, `normals/`: `.npy`, `.exr` or `.png`.
        Files = "files",
    }
}

choice! {
    /// What a file's depths are; those not above 0 are none.
    enum PriorDepths {
        /// Depths along the camera's axis, in the scene's unit.
        Metric = "metric",
        /// Such depths but for scale and shift.
        Relative = "relative",
        /// Inverse depths but for scale and shift: the nearer, the larger.
        Inverse = "inverse",
    }
}

choice! {
    /// Axes of normals in a camera.
    enum NormalAxes {
        /// x to the right, y down, z into the scene.
        Opencv = "opencv",
        /// x to the right, y up, z to the viewer.
        Opengl = "opengl",
    }
}

choice! {
    /// The depth of a pixel, of the means of the Gaussians that it shows.
    enum RenderedDepth {
        /// The mean, by what each contributes.
        Expected = "expected",
        /// That of the Gaussian with which half of the light is taken.
        Median = "median",
        /// That of the Gaussian that contributes most.
        Mode = "mode",
    }
}

choice! {
    /// A loss of depths.
    enum PriorLoss {
        /// 1 less Pearson's correlation.
        Pearson = "pearson",
        /// Mean distance, in `R`, from the prior after its best scale and shift by least squares.
        ScaleShift = "scale_shift",
        /// Mean distance from metric depths, in `R`.
        L1 = "l1",
    }
}

impl PriorConfig {
    /// Says whether training views are held to anything.
    pub fn is_on(&self) -> bool {
        let weights = [self.weight, self.patch_weight, self.normal_weight];
        self.source != PriorSource::None && weights.iter().any(|weight| *weight > 0.0)
    }

    /// Says whether depths have a weight.
    pub fn has_depths(&self) -> bool {
        self.weight > 0.0 || self.patch_weight > 0.0
    }

    /// Says whether normals have a weight.
    pub fn has_normals(&self) -> bool {
        self.normal_weight > 0.0
    }

    /// Says whether depths are compared inversely.
    pub fn compares_inverse(&self) -> bool {
        self.inverse || (self.source == PriorSource::Files && self.depths == PriorDepths::Inverse)
    }
}
