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
