//! Every tolerance of the comparisons, with its reason.

/// A pixel is fragile where a decision hangs on less than this share of its threshold. In single
/// precision `q` (up to 11 at the skip threshold, its terms much larger for narrow splats) is off
/// by up to 1e-4, so alpha by as much; a margin of ten covers the ill-conditioned.
pub const FRAGILE: f64 = 2e-3;

/// Neighbours in depth closer than this, relatively, may change places in single precision
/// (eps 6e-8, three products and a sum).
pub const DEPTH_GAP: f64 = 5e-7;

/// Fourth-order central differences of the f64 forward against the f64 backward, relative L2 over
/// a parameter class: rounding of the sum over a step of `STEP` leaves about 1e-9.
pub const FINITE_DIFFERENCE: f64 = 1e-6;

/// Step of the central differences. A needle of 1:1e4 sweeps many pixels a radian, so the step
/// is small; rounding still leaves three digits to `FINITE_DIFFERENCE`.
pub const STEP: f64 = 3e-6;

/// Pixels this close to a decision get no weight in central differences: the largest step
/// changes alpha by less.
pub const FRAGILE_STEP: f64 = 1e-2;

/// The twins against the reference images: these are stored as f32, of values up to about 4.
pub const REFERENCE_IMAGE: f64 = 1e-6;

/// The twins against the reference gradients (f64, weights rounded to f32 on both sides),
/// relative L2 per class.
pub const REFERENCE_GRADIENT: f64 = 1e-6;

/// GPU images off fragile pixels against the twins: f32 sums of a few hundred terms at most, of
/// order 1. Measured: 1e-6.
pub const GPU_IMAGE: f64 = 1e-5;
/// GPU gradients against the twins, relative L2 per class. Measured: 3e-6.
pub const GPU_GRADIENT: f64 = 1e-5;

/// Sums of 32 numbers, and of 32 such sums, as a share of the sum of their sizes: 62 roundings of
/// at most 6e-8 each.
pub const GPU_PAIR_SUM: f64 = 4e-6;

/// GPU images of needles of 1:1e4, whose narrow axis sees the rounding of the projected mean
/// magnified. Measured: 2e-5.
pub const GPU_NEEDLE_IMAGE: f64 = 1e-4;
/// GPU gradients of needles of 1:1e4. Measured: 4e-5.
pub const GPU_NEEDLE_GRADIENT: f64 = 2e-4;

/// Gradients of Gaussians of many scene sizes: their centres may lie close to the camera's plane,
/// where depth is a small difference of large products and 1/z carries its rounding. Measured over
/// 48 views: 4 beyond 1e-5, all in the mean of a Gaussian at depths of 0.02 to 0.06 whose
/// coordinates are 2; at most 3e-5.
pub const GPU_COVER_GRADIENT: f64 = 1e-4;

/// GPU images at fragile pixels: one Gaussian more or less at alpha = 1/255, and what lies behind
/// a stop at T = 1e-4.
pub const GPU_IMAGE_FRAGILE: f64 = 1e-2;

/// The GPU against the reference cases, which may hold anything: image off fragile pixels, and
/// gradient.
pub const GPU_REFERENCE: (f64, f64) = (1e-4, 1e-4);
/// The bounds of [`GPU_REFERENCE`] for needles.
pub const GPU_REFERENCE_NEEDLE: (f64, f64) = (5e-4, 2e-3);

/// Projected means, depths, conics and colours, relative L2 per column: a few dozen roundings,
/// the ill-conditioned ones (conics of long splats) a hundred times as much.
pub const GPU_PROJECTION: f64 = 1e-5;

/// Losses and their gradients. Measured: 1e-7 and 1e-6.
pub const GPU_LOSS: f64 = 1e-5;

/// Losses of depths and normals: f32 moments of up to a million depths about their means.
pub const GPU_DEPTH_LOSS: f64 = 1e-5;

/// Their gradients, of the same depths: four roundings of a depth, 6e-8 of the mean each, over the least deviation
/// with which a patch counts, 1e-3 of the mean. Measured: 3e-5.
pub const GPU_DEPTH_LOSS_GRADIENT: f64 = 2.4e-4;

/// Adam's moments and parameters after a few steps, relative L2: rounding of each step.
pub const GPU_ADAM: f64 = 1e-5;

/// Blended colours of the point splat, 0 to 255, against their unrounded means: half a level, and
/// f32 sums of some dozen terms.
pub const SPLAT_LEVELS: f64 = 0.501;

/// The potential field on the CPU against the same by chords, relative L2: a few roundings of f64.
pub const FIELD: f64 = 1e-13;
