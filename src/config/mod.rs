//! The configuration: its schema, the presets, overrides and validation.
//!
//! A preset is a JSON file in `configs/` that states every value, or what it changes of another;
//! a user's config file states what it changes and, under `"preset"`, what it changes it from.

mod overlay;
mod reference;
mod validate;

pub use overlay::PRESETS;
pub use reference::{Key, keys, summary};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Everything that decides a training run. Lengths are relative to the sphere radius `R`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The preset this config started from.
    pub preset: String,
    /// Seeds every random choice.
    pub seed: u64,
    /// Training iterations; each renders one real and, with virtual views, one virtual view.
    pub iterations: u32,
    pub scene: SceneConfig,
    pub carve: CarveConfig,
    pub field: FieldConfig,
    pub views: ViewsConfig,
    pub splat: SplatConfig,
    pub model: ModelConfig,
    pub shell: ShellConfig,
    pub loss: LossConfig,
    pub dropout: DropoutConfig,
    pub poses: PosesConfig,
    pub optimizer: OptimizerConfig,
    pub densify: DensifyConfig,
    pub coverage: CoverageConfig,
}

/// What is loaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneConfig {
    /// Images wider than this are scaled down to it.
    pub max_width_px: u32,
    /// Bounds the longer side instead, where given.
    pub max_size_px: Option<u32>,
    /// Without a split file: number of training views, uniformly over the sorted names: both ends
    /// among them, or, where the sequence closes (its last camera is a neighbour of its first), around
    /// the loop.
    pub n_train: usize,
    /// Without a split file: at most this many of the other views for testing, uniformly.
    pub n_test: usize,
    /// The cloud is thinned to this many points before it becomes Gaussians, where given;
    /// otherwise to the number of training pixels.
    pub max_points: Option<usize>,
    /// What training makes of the pixels that a photograph's mask leaves out.
    pub outside_mask: OutsideMask,
}

/// What the pixels are that a mask leaves out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutsideMask {
    /// By an alpha channel `background`, by a file in `masks/` `ignored`.
    Auto,
    /// They do not count: training learns nothing from them.
    Ignored,
    /// They show `model.background`, in test views, too: the subject stands free. Points of the
    /// cloud that a training view has outside its mask go, and there are no far shell and no
    /// filled holes.
    Background,
    /// The photograph's: masks count in evaluation alone.
    Kept,
}

/// Carving: points that the photographs contradict go before anything is made of the cloud.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CarveConfig {
    /// Otherwise the cloud is taken as it is.
    pub enabled: bool,
    /// A point goes where its colour lies further than this, in [0, 1], outside the range of
    /// the photograph's window.
    pub threshold: f64,
    /// Side of the window, pixels, odd.
    pub window_px: u32,
    /// A point is seen through a gap, and not judged, where another close by is nearer by more
    /// than this share of its depth.
    pub depth_tolerance: f64,
    /// Rounds at most; without a point to remove there is none.
    pub max_rounds: u32,
    /// The round that would bring the removed share of the cloud above this does not happen.
    pub max_share: f64,
}

/// The camera potential field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// How a training camera's influence decays with the angle to it.
    pub kernel: Kernel,
    /// Sharpness of the kernel: `sigma` of sech, where arcsech(0.01) = 5.298292365610484 leaves
    /// 1 % at 90 degrees, or `kappa` of von Mises-Fisher, where ln(100) = 4.605 does.
    pub sigma: f64,
    /// `lambda`, weight of `U_conf` in `U_total`.
    pub lambda: f64,
    /// Candidate directions on the Fibonacci sphere.
    pub n_candidates: usize,
}

/// Kernel of the information potential, 1 at its peak; `theta` is the angle to the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kernel {
    /// `sech(sigma (1 - cos theta))`, the paper's.
    Sech,
    /// `exp(sigma (cos theta - 1))`; the paper compares it at `kappa` 3.0 and 4.4.
    VonMisesFisher,
}

/// Virtual views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ViewsConfig {
    /// `K`, number of virtual views; 0 trains without them.
    pub count: usize,
    /// How they are chosen.
    pub strategy: Strategy,
    /// `epsilon` of the sampling weights `1 / (U_total + epsilon)` and `theta_min + epsilon`.
    pub epsilon: f64,
    pub visibility: VisibilityConfig,
}

/// How virtual views are chosen, by the names of the paper's table of sampling strategies. All
/// but interpolation choose among the same candidates on the sphere, without replacement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Strategy {
    /// CPF, the paper's: drawn with weight `1 / (U_total + epsilon)`.
    Potential,
    /// Nearest-angle random: drawn with weight `theta_min + epsilon`, the angle to the nearest
    /// training camera in place of the potential.
    NearestAngle,
    /// Uniform sphere: drawn with equal weights.
    SphereUniform,
    /// Farthest-point sphere: one after another, the candidate farthest from the training
    /// cameras and from those chosen before.
    SphereFarthest,
    /// Uniform interpolation: between two training cameras, any pair and any place between
    /// alike, on an arc around the focus.
    Interpolation,
}

/// The geometry-aware choice of virtual views. Each candidate's weight is multiplied by
/// `s^power`, where `s` is the share of its covered pixels whose point some training camera sees
/// from a direction within `max_angle_deg` of the candidate's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VisibilityConfig {
    /// Otherwise weights are the strategy's own.
    pub enabled: bool,
    /// At the point, between the directions to the candidate and to the training camera.
    pub max_angle_deg: f64,
    /// `power` of the share that multiplies a weight; 0 only drops.
    pub power: f64,
    /// Candidates with a lower share are dropped.
    pub min_share: f64,
    /// A training camera sees a point that lies at most this share of the depth behind the
    /// nearest one in its pixel.
    pub depth_tolerance: f64,
    /// Pixels of the virtual views whose point no training camera sees from within this angle,
    /// whatever `enabled` says, count as holes; null: none does.
    pub mask_angle_deg: Option<f64>,
}

/// Least radius of a disc, pixels: half a pixel's diagonal and a little, so that a disc holds the
/// centre of the pixel that its own centre lies in.
pub const MIN_DISC_RADIUS_PX: f64 = 0.708;

/// Point splatting of the cloud into the virtual views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SplatConfig {
    /// What a point covers.
    pub footprint: Footprint,
    /// Greatest radius of a disc, pixels; the least is 0.708. Nothing to `pixel`.
    pub max_radius_px: f64,
    /// Discs that lie at most this share of the depth behind the nearest one in a pixel blend with
    /// it; those farther back are hidden. Nothing to `pixel`.
    pub depth_tolerance: f64,
    /// Side of the connectivity filter's window, pixels, odd.
    pub filter_window_px: u32,
    /// Pixels with fewer valid neighbours in the window are removed; 0 switches the filter off.
    pub filter_min_neighbors: u32,
    /// Points whose confidence is below this share of the cloud's median are not drawn; 0 draws
    /// all, as do clouds without confidence.
    pub min_confidence: f64,
}

/// What a splatted point covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Footprint {
    /// The pixel that it falls into; points behind a surface show through its gaps.
    Pixel,
    /// A disc as large as its source pixel, with a visibility pass: surface splatting.
    Disc,
}

/// The Gaussians at the start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Highest spherical-harmonics degree, 0 to 3.
    pub sh_degree: u32,
    /// The active degree rises by one every so many iterations.
    pub sh_interval: u32,
    /// Opacity of every Gaussian at the start.
    pub initial_opacity: f64,
    /// Gaussians start with `initial_opacity * min(1, confidence / median confidence)`.
    pub confidence_opacity: bool,
    /// Upper bound of the initial scale (3-nearest-neighbour distance) as a multiple of the
    /// median over the cloud: isolated points would fog whole views. null: no bound, as in 3DGS.
    pub max_initial_scale_ratio: Option<f64>,
    /// Near plane, as a share of the scene's extent: `R`, or twice the median distance of the training
    /// cameras from the focus where that is less, so that a camera far away clips nothing of the others'.
    pub near: f64,
    /// Background colour of renders, RGB in [0, 1].
    pub background: [f64; 3],
}

/// The far shell: large Gaussians on a sphere beyond the scene, a background that lives in the
/// file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShellConfig {
    /// Number of Gaussians, some hundreds: the more, the finer; 0: no shell.
    pub count: usize,
    /// Distance from the focus, in `R`; more where the cloud reaches farther.
    pub radius: f64,
}

/// The image losses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DropoutConfig {
    /// Probability at the start.
    pub rate_start: f64,
    /// Probability at the end, to which it goes linearly. In every iteration each Gaussian is left
    /// out of both views' renders with this probability, and the opacity of the others is
    /// divided by one less it (DropGaussian, Park et al. 2025). The file needs no correction.
    pub rate_end: f64,
    /// Above 0 here or below, each Gaussian has a share of its own in that probability: this times
    /// its nearness to the camera, 0 to 1, and, all of it, times 0.7 and 0.3 in the middle and far
    /// third; the others keep their opacity (D2GS, Song et al. 2026).
    pub depth_weight: f64,
    /// And this times how crowded it is, 0 to 1, by the mean distance to its six nearest others.
    pub density_weight: f64,
}

impl DropoutConfig {
    /// Whether Gaussians have shares of their own.
    pub fn is_guided(&self) -> bool {
        self.depth_weight > 0.0 || self.density_weight > 0.0
    }
}

/// Refinement of the training cameras' poses with the Gaussians. The field and the virtual views are
/// those of the poses before; these views and the cloud hold the frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PosesConfig {
    /// Otherwise poses stay as the scene has them.
    pub refine: bool,
    /// Learning rate of a camera's turn about its centre at the start, radians.
    pub turn_lr: f64,
    /// Learning rate of its shift at the start, in `R`.
    pub shift_lr: f64,
    /// Share of both that is left at the end; in between they fall exponentially.
    pub rate_left: f64,
}

/// Adam with 3DGS's learning rates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OptimizerConfig {
    /// Learning rate of positions at the start, times the camera extent.
    pub mean_lr_start: f64,
    /// The same at the end; in between it falls exponentially.
    pub mean_lr_end: f64,
    /// Learning rate of colours of degree 0; higher degrees take a twentieth.
    pub sh_lr: f64,
    /// Learning rate of opacity logits.
    pub opacity_lr: f64,
    /// Learning rate of the scales' logarithms.
    pub scale_lr: f64,
    /// Learning rate of rotations.
    pub rotation_lr: f64,
    /// Adam's decay of the mean gradient.
    pub beta1: f64,
    /// Adam's decay of the mean squared gradient.
    pub beta2: f64,
    /// Adam's epsilon.
    pub epsilon: f64,
}

/// 3DGS's densification and pruning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DensifyConfig {
    /// Otherwise the number of Gaussians only falls.
    pub enabled: bool,
    /// Densification follows iterations after this one.
    pub start: u32,
    /// And before this one, the run's last at most: what it adds is trained.
    pub end: u32,
    /// Iterations between two densifications.
    pub interval: u32,
    /// Mean norm of the position gradient on screen (normalised device coordinates) above which
    /// a Gaussian is cloned or split. Coverage-aware densification replaces it.
    pub gradient_threshold: f64,
    /// Split above this scale, clone below, in camera extents.
    pub split_scale: f64,
    /// Prune below this opacity.
    pub min_opacity: f64,
    /// Prune above this scale, in camera extents, once opacities have been reset. Halves of a split
    /// Gaussian are judged by their own scale.
    pub max_scale: f64,
    /// Prune Gaussians that were wider than this on a training image, as a share of its longer
    /// side, once opacities have been reset. null: none, as 3DGS's code does, which clears the
    /// widths before it looks at them.
    pub max_screen: Option<f64>,
    /// Opacities are reset every so many iterations.
    pub opacity_reset_interval: u32,
    /// No reset after this iteration.
    pub opacity_reset_end: u32,
    /// No growth beyond this number of Gaussians.
    pub max_gaussians: usize,
}

/// Coverage-aware pruning and densification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoverageConfig {
    /// `Q_i`-guided anisotropy pruning.
    pub prune: bool,
    /// `Q_i`-guided densification threshold.
    pub densify: bool,
    /// First iteration after which `Q_i` guides the pruning and the densification threshold.
    pub start: u32,
    /// Iterations between two prunings.
    pub interval: u32,
    /// `tau_min`, greatest anisotropy where nothing is covered.
    pub tau_min: f64,
    /// `tau_max`, greatest anisotropy where coverage is best.
    pub tau_max: f64,
    /// `delta_min`, densification threshold where coverage is best.
    pub delta_min: f64,
    /// `delta_max`, densification threshold where nothing is covered.
    pub delta_max: f64,
    /// `epsilon` of the anisotropy, in `R`.
    pub anisotropy_epsilon: f64,
    /// At most this share of the Gaussians is pruned in one step, the worst first.
    pub max_pruned_share: f64,
}
