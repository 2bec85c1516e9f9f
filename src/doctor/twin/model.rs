//! The twins' data: Gaussians, a camera, splats on screen and gradients.

use super::dropout::TwinDropout;
use super::linalg::{Mat3, Vec3, apply, transpose};

/// Gaussians as stored (raw parameters); all vectors have one entry a Gaussian.
#[derive(Clone, Debug)]
pub struct TwinGaussians {
    /// World positions.
    pub means: Vec<Vec3>,
    /// SH coefficients `[k][channel]`, 3DGS order.
    pub sh: Vec<[Vec3; 16]>,
    /// Logits: opacity is their sigmoid.
    pub opacity_logit: Vec<f64>,
    /// Natural logarithms.
    pub scale_log: Vec<Vec3>,
    /// Quaternions, not normalised.
    pub rotation_wxyz: Vec<[f64; 4]>,
    /// Coefficients `k >= (sh_degree + 1)^2` are ignored.
    pub sh_degree: usize,
}

impl TwinGaussians {
    /// Starts a set without Gaussians.
    pub(super) fn empty(sh_degree: usize) -> TwinGaussians {
        TwinGaussians {
            means: Vec::new(),
            sh: Vec::new(),
            opacity_logit: Vec::new(),
            scale_log: Vec::new(),
            rotation_wxyz: Vec::new(),
            sh_degree,
        }
    }

    /// Returns the number of Gaussians.
    pub fn n(&self) -> usize {
        self.means.len()
    }
}

/// A pinhole camera, world-to-camera, +z forward, y down, pixel centres at +0.5.
#[derive(Clone, Debug)]
pub struct TwinCamera {
    /// World-to-camera, row-major, homogeneous.
    pub w2c: [[f64; 4]; 4],
    /// Width of the image, pixels.
    pub width: usize,
    /// Height of the image, pixels.
    pub height: usize,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, pixels from the left edge.
    pub cx: f64,
    /// Principal point, pixels from the top edge.
    pub cy: f64,
    /// Near plane: camera z up to which nothing is drawn.
    pub near: f64,
    /// RGB behind the last Gaussian.
    pub background: Vec3,
    /// Dropout of this view; `None`: nothing is left out.
    pub dropout: Option<TwinDropout>,
}

impl TwinCamera {
    /// Returns `W`, the rotation of `w2c`.
    pub fn rotation(&self) -> Mat3 {
        std::array::from_fn(|i| std::array::from_fn(|j| self.w2c[i][j]))
    }

    /// Takes a point of the world to the camera's axes.
    pub fn to_camera(&self, p: &Vec3) -> Vec3 {
        let q = apply(&self.rotation(), p);
        std::array::from_fn(|i| q[i] + self.w2c[i][3])
    }

    /// Returns the optical centre in the world, `-W^T t`.
    pub fn center(&self) -> Vec3 {
        let t = std::array::from_fn(|i| -self.w2c[i][3]);
        apply(&transpose(&self.rotation()), &t)
    }

    /// Returns the bounds `[[x_min, x_max], [y_min, y_max]]` of `x/z` and `y/z` in the projection's
    /// Jacobian: the image's own range and 15% of its size on either side.
    pub fn tangent_bounds(&self) -> [[f64; 2]; 2] {
        let bounds = |c: f64, f: f64, n: usize| {
            let (n, margin) = (n as f64, 0.15 * n as f64 / f);
            [-c / f - margin, (n - c) / f + margin]
        };
        [
            bounds(self.cx, self.fx, self.width),
            bounds(self.cy, self.fy, self.height),
        ]
    }

    /// Returns the factor of Gaussian `i`'s opacity; 1 without dropout.
    pub fn opacity_factor(&self, i: usize) -> f64 {
        self.dropout
            .as_ref()
            .map_or(1.0, |dropout| dropout.factor(i))
    }

    /// Returns the same view at another size: intrinsics scale with it.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let sx = width as f64 / self.width as f64;
        let sy = height as f64 / self.height as f64;
        let f32_exact = |x: f64| f64::from(x as f32);
        Self {
            width,
            height,
            fx: f32_exact(self.fx * sx),
            fy: f32_exact(self.fy * sy),
            cx: f32_exact(self.cx * sx),
            cy: f32_exact(self.cy * sy),
            ..self.clone()
        }
    }
}

/// A projected Gaussian. If it is not `valid`, everything but `depth` is 0.
#[derive(Clone, Copy, Debug, Default)]
pub struct TwinSplat {
    /// In front of the near plane and not dropped.
    pub valid: bool,
    /// Pixels.
    pub mean2d: [f64; 2],
    /// Camera z.
    pub depth: f64,
    /// `A, B, C` of `q = A dx^2 + 2 B dx dy + C dy^2`.
    pub conic: [f64; 3],
    /// `xx, xy, yy`, pixels squared, with the dilation.
    pub cov2d: [f64; 3],
    /// Clamped at 0 from below.
    pub rgb: Vec3,
    /// With the dropout's factor.
    pub opacity: f64,
}

/// Gradient to a splat: `u, v, A, B, C, r, g, b, opacity`; `B` stands for both off-diagonals.
pub type SplatGradient = [f64; 9];

/// Gradients to the raw parameters, and to the splats on the way.
#[derive(Clone, Debug)]
pub struct TwinGradients {
    /// To the world positions.
    pub means: Vec<Vec3>,
    /// To the SH coefficients; 0 above the degree.
    pub sh: Vec<[Vec3; 16]>,
    /// To the opacity logits.
    pub opacity_logit: Vec<f64>,
    /// To the natural logarithms of the scales.
    pub scale_log: Vec<Vec3>,
    /// To the quaternions as stored, through their normalisation.
    pub rotation_wxyz: Vec<[f64; 4]>,
    /// To the splats on the way.
    pub splats: Vec<SplatGradient>,
}

impl TwinGradients {
    /// Returns the raw-parameter classes by name, flattened: what a comparison goes over.
    pub fn classes(&self) -> [(&'static str, Vec<f64>); 5] {
        [
            ("means", self.means.as_flattened().to_vec()),
            ("sh", self.sh.as_flattened().as_flattened().to_vec()),
            ("opacity_logit", self.opacity_logit.clone()),
            ("scale_log", self.scale_log.as_flattened().to_vec()),
            ("rotation_wxyz", self.rotation_wxyz.as_flattened().to_vec()),
        ]
    }
}
