//! The configuration: its schema, the presets, overrides and validation.
//!
//! A preset is a JSON file in `configs/` that states every value; a user's config file states
//! what it changes and, under `"preset"`, what it changes it from.

mod overlay;
mod validate;

pub use overlay::PRESETS;

use serde::{Deserialize, Serialize};

/// Everything that decides a training run. Lengths are relative to the sphere radius `R`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The preset this config started from.
    pub preset: String,
    /// Seeds every random choice.
    pub seed: u64,
    /// Training iterations; each renders one real and, with virtual views, one virtual view.
    pub iterations: u32,
    pub scene: SceneConfig,
    pub field: FieldConfig,
    pub views: ViewsConfig,
    pub splat: SplatConfig,
    pub model: ModelConfig,
    pub shell: ShellConfig,
    pub loss: LossConfig,
    pub dropout: DropoutConfig,
    pub optimizer: OptimizerConfig,
    pub densify: DensifyConfig,
    pub coverage: CoverageConfig,
}

/// What is loaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneConfig {
    /// Images wider than this are scaled down to it.
    pub max_width_px: u32,
    /// Bounds the longer side instead, where given.
    pub max_size_px: Option<u32>,
    /// Without a split file: number of training views, uniformly over the sorted names.
    pub n_train: usize,
    /// Without a split file: at most this many of the other views for testing, uniformly.
    pub n_test: usize,
    /// The cloud is thinned to this many points before it becomes Gaussians, where given;
    /// otherwise to the number of training pixels.
    pub max_points: Option<usize>,
}

/// The camera potential field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// `sigma` of the sech kernel; arcsech(0.01) = 5.298292365610484.
    pub sigma: f64,
    /// `lambda`, weight of `U_conf` in `U_total`.
    pub lambda: f64,
    /// Candidate directions on the Fibonacci sphere.
    pub n_candidates: usize,
}

/// Virtual views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewsConfig {
    /// `K`, number of virtual views; 0 trains without them.
    pub count: usize,
    /// `epsilon` of the sampling weight `1 / (U_total + epsilon)`.
    pub epsilon: f64,
}

/// Point splatting of the cloud into the virtual views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplatConfig {
    /// Side of a splatted point's square, pixels.
    pub size_px: u32,
    /// Side of the connectivity filter's window, pixels, odd.
    pub filter_window_px: u32,
    /// Pixels with fewer valid neighbours in the window are removed; 0 switches the filter off.
    pub filter_min_neighbors: u32,
}

/// The Gaussians at the start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Highest spherical-harmonics degree, 0 to 3.
    pub sh_degree: u32,
    /// The active degree rises by one every so many iterations.
    pub sh_interval: u32,
    pub initial_opacity: f64,
    /// Upper bound of the initial scale (3-nearest-neighbour distance) as a multiple of the
    /// median over the cloud: isolated points would fog whole views.
    pub max_initial_scale_ratio: f64,
    /// That bound holds in training, too.
    pub bound_scales: bool,
    /// Near plane, in `R`.
    pub near: f64,
    /// Background colour of renders, RGB in [0, 1].
    pub background: [f64; 3],
}

/// The far shell: large Gaussians on a sphere beyond the scene, a background that lives in the
/// file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShellConfig {
    /// Number of Gaussians, some hundreds: the more, the finer; 0: no shell.
    pub count: usize,
    /// Distance from the focus, in `R`; more where the cloud reaches farther.
    pub radius: f64,
}

/// The image losses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossConfig {
    /// `L = (1 - w) L1 + w (1 - SSIM)`.
    pub ssim_weight: f64,
    /// Multiplies `alpha_k` of every virtual view.
    pub virtual_weight: f64,
    /// `alpha_k = 1 / (1 + U_conf)`; otherwise 1.
    pub confidence_weighting: bool,
    /// Weight of a virtual view's pixels that no point covers, against 1 of those that one does;
    /// their colour is filled in from around. Rounded to a multiple of 1/255; 0: ignored, as the
    /// paper does.
    pub fill_weight: f64,
}

/// Dropout of Gaussians in training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DropoutConfig {
    /// Probability at the end; it rises linearly from 0. In every iteration each Gaussian is left
    /// out of both views' renders with this probability, and the opacity of the others is
    /// divided by one less it (DropGaussian, Park et al. 2025). The file needs no correction.
    pub rate_end: f64,
}

/// Adam with 3DGS's learning rates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OptimizerConfig {
    /// Position learning rate at the start and the end, times the camera extent.
    pub mean_lr_start: f64,
    pub mean_lr_end: f64,
    /// Degree 0; higher degrees take a twentieth.
    pub sh_lr: f64,
    pub opacity_lr: f64,
    pub scale_lr: f64,
    pub rotation_lr: f64,
    pub beta1: f64,
    pub beta2: f64,
    pub epsilon: f64,
}

/// 3DGS's densification and pruning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensifyConfig {
    pub enabled: bool,
    /// First and last iteration, and the step between.
    pub start: u32,
    pub end: u32,
    pub interval: u32,
    /// Mean norm of the position gradient on screen (normalised device coordinates) above which
    /// a Gaussian is cloned or split. Coverage-aware densification replaces it.
    pub gradient_threshold: f64,
    /// Split above this scale, clone below, in camera extents.
    pub split_scale: f64,
    pub min_opacity: f64,
    /// Prune above this scale, in camera extents, once opacities have been reset.
    pub max_scale: f64,
    /// Prune Gaussians that were wider than this on a training image, as a share of its longer
    /// side, once opacities have been reset.
    pub max_screen: f64,
    /// Opacities are reset every so many iterations, and never after `opacity_reset_end`.
    pub opacity_reset_interval: u32,
    pub opacity_reset_end: u32,
    /// No growth beyond this number of Gaussians.
    pub max_gaussians: usize,
}

/// Coverage-aware pruning and densification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoverageConfig {
    /// `Q_i`-guided anisotropy pruning.
    pub prune: bool,
    /// `Q_i`-guided densification threshold.
    pub densify: bool,
    /// First iteration and step of the pruning.
    pub start: u32,
    pub interval: u32,
    pub tau_min: f64,
    pub tau_max: f64,
    pub delta_min: f64,
    pub delta_max: f64,
    /// `epsilon` of the anisotropy, in `R`.
    pub anisotropy_epsilon: f64,
    /// At most this share of the Gaussians is pruned in one step, the worst first.
    pub max_pruned_share: f64,
}
