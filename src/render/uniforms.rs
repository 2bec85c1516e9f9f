//! Uniform structs shared with WGSL (`shaders/shared/view.wgsl`, `loss.wgsl`).

use bytemuck::{Pod, Zeroable};

use crate::camera::Camera;
use crate::gpu::constants::{RATIO_MARGIN, TILE_H};

/// Smallest near plane: depths reach 2^127 times as far, which from 0 is nowhere.
const MIN_NEAR: f64 = 1e-18;

/// One rendered view; `View` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ViewUniform {
    /// First row of world-to-camera `[R | t]`.
    pub w2c_x: [f32; 4],
    /// Second row of world-to-camera.
    pub w2c_y: [f32; 4],
    /// Third row of world-to-camera.
    pub w2c_z: [f32; 4],
    /// Rest of `w2c_x`, for which one `f32` has no room.
    pub w2c_low_x: [f32; 4],
    /// Rest of `w2c_y`, for which one `f32` has no room.
    pub w2c_low_y: [f32; 4],
    /// Rest of `w2c_z`, for which one `f32` has no room.
    pub w2c_low_z: [f32; 4],
    /// Optical centre in the frame of the Gaussians.
    pub center: [f32; 3],
    /// Near plane: camera z up to which nothing is drawn.
    pub near: f32,
    /// Rest of `center`, for which one `f32` has no room.
    pub center_low: [f32; 3],
    /// The number 0, which the shader's compiler does not know, so that it reorders no sums.
    pub zero: f32,
    /// Focal lengths along x and y, pixels.
    pub focal: [f32; 2],
    /// Principal point, pixels from the top left corner.
    pub principal: [f32; 2],
    /// Rest of `focal`, for which one `f32` has no room.
    pub focal_low: [f32; 2],
    /// Rest of `principal`, for which one `f32` has no room.
    pub principal_low: [f32; 2],
    /// Lower bounds of x/z and y/z in the projection's Jacobian.
    pub ratio_min: [f32; 2],
    /// Upper bounds of x/z and y/z in the projection's Jacobian.
    pub ratio_max: [f32; 2],
    /// Rest of `ratio_min`, for which one `f32` has no room.
    pub ratio_min_low: [f32; 2],
    /// Rest of `ratio_max`, for which one `f32` has no room.
    pub ratio_max_low: [f32; 2],
    /// Colour behind the last Gaussian, RGB.
    pub background: [f32; 3],
    /// Padding, as WGSL aligns what follows.
    pub pad_0: f32,
    /// Width and height of the image, pixels.
    pub size: [u32; 2],
    /// Tiles across and down.
    pub tiles: [u32; 2],
    /// Gaussians of the model; `Pass::new` sets it.
    pub n_gaussians: u32,
    /// Entries a plane of the Gaussians' buffers; `Pass::new` sets it.
    pub stride: u32,
    /// Probability of dropout, in steps of 2^-32; 0: no dropout.
    pub drop_threshold: u32,
    /// Key that decides which Gaussians are left out.
    pub drop_key: u32,
    /// `vec4f`s of one plane of the padded image.
    pub plane_vectors: u32,
    /// `vec4f`s of a row of the padded image, four pixels each.
    pub row_vectors: u32,
    /// The view's number among those of its step; `Pass::new` sets it.
    pub slot: u32,
    /// Entries of the longest tile list that the workspace's slices cover; `Pass::new` sets it.
    pub longest_list: u32,
    /// [`DropShare::base`].
    pub share_base: f32,
    /// [`DropShare::per_distance`].
    pub share_per_distance: f32,
    /// [`DropShare::per_density`].
    pub share_per_density: f32,
    /// 1 if the others' opacity makes up for the Gaussians that are left out, else 0.
    pub compensates: f32,
    /// [`DropShare::near_layer`]; infinite without a guide.
    pub near_layer: f32,
    /// [`DropShare::middle_layer`]; infinite without a guide.
    pub middle_layer: f32,
    /// The plane of `d_rendered` that holds what each pixel has blended last.
    pub blended_plane: u32,
    /// Padding to a whole number of vectors.
    pub pad_1: u32,
}

impl ViewUniform {
    /// Fills in the camera's part, without dropout; numbers, tiles and slot are set where the view is rendered.
    /// `near` is in the camera's world unit.
    pub fn new(camera: &Camera, near: f64, background: [f64; 3]) -> ViewUniform {
        let row = |i: usize| {
            let [x, y, z] = camera.rotation.row(i).to_array();
            parts([x, y, z, camera.translation[i]])
        };
        let [(w2c_x, w2c_low_x), (w2c_y, w2c_low_y), (w2c_z, w2c_low_z)] = [0, 1, 2].map(row);
        let (center, center_low) = parts(camera.center().to_array());
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let low = |c: f64, size: f64, f: f64| -(c + RATIO_MARGIN * size) / f;
        let high = |c: f64, size: f64, f: f64| (size - c + RATIO_MARGIN * size) / f;
        let (focal, focal_low) = parts([camera.fx, camera.fy]);
        let (principal, principal_low) = parts([camera.cx, camera.cy]);
        let (ratio_min, ratio_min_low) =
            parts([low(camera.cx, w, camera.fx), low(camera.cy, h, camera.fy)]);
        let (ratio_max, ratio_max_low) =
            parts([high(camera.cx, w, camera.fx), high(camera.cy, h, camera.fy)]);
        let (row_vectors, padded_height) = padded(camera.width, camera.height);
        ViewUniform {
            w2c_x,
            w2c_y,
            w2c_z,
            w2c_low_x,
            w2c_low_y,
            w2c_low_z,
            center,
            near: near.max(MIN_NEAR) as f32,
            center_low,
            zero: 0.0,
            focal,
            principal,
            focal_low,
            principal_low,
            ratio_min,
            ratio_max,
            ratio_min_low,
            ratio_max_low,
            background: background.map(|c| c as f32),
            pad_0: 0.0,
            size: [camera.width, camera.height],
            tiles: [0; 2],
            n_gaussians: 0,
            stride: 0,
            drop_threshold: 0,
            drop_key: 0,
            // An image too large for its index is too large for every buffer, too.
            plane_vectors: row_vectors.saturating_mul(padded_height),
            row_vectors,
            slot: 0,
            longest_list: 0,
            share_base: 1.0,
            share_per_distance: 0.0,
            share_per_density: 0.0,
            compensates: 1.0,
            near_layer: f32::INFINITY,
            middle_layer: f32::INFINITY,
            blended_plane: 0,
            pad_1: 0,
        }
    }

    /// Returns the same view with dropout: each Gaussian is left out with probability `rate` (below
    /// 1), and the others have their opacity divided by `1 - rate` (DropGaussian, Park et al.
    /// 2025). The key decides which ones.
    pub fn with_dropout(mut self, rate: f64, key: u32) -> ViewUniform {
        self.drop_threshold = (rate * 2f64.powi(32)) as u32;
        self.drop_key = key;
        self
    }

    /// Returns the same view before another background colour, RGB, where there is one.
    pub fn before(mut self, background: Option<[f64; 3]>) -> ViewUniform {
        if let Some(background) = background {
            self.background = background.map(|c| c as f32);
        }
        self
    }

    /// Returns the same view with every Gaussian's probability multiplied by its own share; the
    /// others keep their opacity (D2GS, Song et al. 2026).
    pub fn with_guided_dropout(mut self, share: DropShare) -> ViewUniform {
        self.share_base = share.base as f32;
        self.share_per_distance = share.per_distance as f32;
        self.share_per_density = share.per_density as f32;
        self.compensates = 0.0;
        self.near_layer = share.near_layer as f32;
        self.middle_layer = share.middle_layer as f32;
        self
    }

    /// Returns the optical centre, to more digits than `f32` has.
    pub fn center(&self) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(self.center[i]) + f64::from(self.center_low[i]))
    }

    /// Returns the `vec4f`s of one plane of the padded image.
    pub fn plane_len(&self) -> usize {
        self.plane_vectors as usize
    }

    /// Returns the pixels of the image itself.
    pub fn n_pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Returns the vectors of four pixels in a row of the padded image, and its rows.
    pub fn padded_size(&self) -> (usize, usize) {
        (
            self.row_vectors as usize,
            (self.plane_vectors / self.row_vectors) as usize,
        )
    }
}

/// The share of the dropout's probability that a Gaussian of a distance `d` from the camera and a
/// density `rho` has: `base + per_distance d + per_density rho` up to `near_layer`, 0.7 of it up to
/// `middle_layer`, and 0.3 of it beyond.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DropShare {
    /// Share at distance 0 and density 0.
    pub base: f64,
    /// Change of the share per unit of distance, canonical frame.
    pub per_distance: f64,
    /// Change of the share from density 0 to density 1.
    pub per_density: f64,
    /// Distance up to which the share counts in full, canonical frame.
    pub near_layer: f64,
    /// Distance up to which 0.7 of the share counts, canonical frame.
    pub middle_layer: f64,
}

/// Splits numbers into `f32`s and what those leave of them.
pub(crate) fn parts<const N: usize>(values: [f64; N]) -> ([f32; N], [f32; N]) {
    let high = values.map(|v| v as f32);
    let low = std::array::from_fn(|i| (values[i] - f64::from(high[i])) as f32);
    (high, low)
}

/// Returns the vectors of four pixels a row and the rows of the padded image: whole tiles of a thread.
fn padded(width: u32, height: u32) -> (u32, u32) {
    let padded_height = height.checked_next_multiple_of(TILE_H);
    (width.div_ceil(4), padded_height.unwrap_or(u32::MAX))
}

/// One image loss; `Loss` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LossUniform {
    /// `weight (1 - ssim_weight) / (3 total_weight)`, the factor of L1's sum in the loss.
    pub l1_scale: f32,
    /// `weight ssim_weight / (3 total_weight)`, the factor of the sum of 1 - SSIM in the loss.
    pub ssim_scale: f32,
    /// 1 if the target image's alpha weighs the pixels, else 0.
    pub masked: u32,
    /// `1 / (3 total_weight)`, for the means that are reported; 0 if no pixel has weight.
    pub mean_scale: f32,
    /// Entry of this loss in `losses`; `Pass::loss` sets it.
    pub slot: u32,
    /// Partial sums to add up; `Pass::loss` sets it.
    pub n_partials: u32,
    /// `weight / (3 n)`, the factor of the sum of `|x_p - y_p|` over the `n` far pixels; 0: none are.
    pub far_scale: f32,
    /// `weight / n`, the factor of the silhouette's sum over all `n` pixels; 0: it does not count.
    pub silhouette_scale: f32,
}

impl LossUniform {
    /// Weighs the loss `weight ((1 - ssim_weight) L1 + ssim_weight (1 - SSIM))`. With a mask the
    /// target image's alpha is the pixels' weight `m_p`, and both means are weighted by it:
    /// `L1 = sum m_p |x_p - y_p| / sum m_p`, SSIM likewise with the weights in its windows, too.
    /// `total_weight` is `sum m_p`, without a mask the number of pixels.
    pub fn new(weight: f64, ssim_weight: f64, total_weight: f64, masked: bool) -> Self {
        let mean_scale = if total_weight > 0.0 {
            1.0 / (3.0 * total_weight)
        } else {
            0.0
        };
        LossUniform {
            l1_scale: (weight * (1.0 - ssim_weight) * mean_scale) as f32,
            ssim_scale: (weight * ssim_weight * mean_scale) as f32,
            masked: u32::from(masked),
            mean_scale: mean_scale as f32,
            slot: 0,
            n_partials: 0,
            far_scale: 0.0,
            silhouette_scale: 0.0,
        }
    }

    /// Adds `weight` times the mean of `|x - y|` over the `n` pixels that the target image marks as far,
    /// whatever they weigh else.
    pub fn with_far(mut self, weight: f64, n: usize) -> Self {
        self.far_scale = per_pixel(weight / 3.0, n);
        self
    }

    /// Adds `weight` times the mean binary cross-entropy between the render's opacity and the subject
    /// that the target image of `n` pixels marks.
    pub fn with_silhouette(mut self, weight: f64, n: usize) -> Self {
        self.silhouette_scale = per_pixel(weight, n);
        self
    }
}

/// Returns the weight of one of `n` pixels, 0 if there is none.
fn per_pixel(weight: f64, n: usize) -> f32 {
    if n > 0 {
        (weight / n as f64) as f32
    } else {
        0.0
    }
}

/// One prefix sum; `Scan` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ScanUniform {
    /// Counts to add up; 0: the digit counts of the view's pairs.
    pub n: u32,
    /// Slot of `totals` for their sum.
    pub total: u32,
    /// Room that the sum is held against; 0: none.
    pub capacity: u32,
    /// Number of the step, which is stored on overflow.
    pub step: u32,
}

/// The mode of a dispatch of `bin`; `Bin` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BinUniform {
    /// 0: count pairs, 1: emit them; with one thread a tile, 1: emit the first of each splat, 2: the rest.
    pub emits: u32,
    /// Padding to a whole vector.
    pub pad: [u32; 3],
}

/// The slice of every list that a rasterizer takes; `Slice` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SliceUniform {
    /// First entry of the slice.
    pub first: u32,
    /// Padding to a whole vector.
    pub pad: [u32; 3],
}

/// A projected Gaussian; `Splat` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Splat {
    /// Pixel centre of the image nearest to the projected mean, pixels.
    pub anchor: [f32; 2],
    /// `L (anchor - mean)`, `L` the conic's Cholesky factor scaled by `sqrt(log2(e) / 2)`: alpha in
    /// the pixel `d` from the anchor is `opacity 2^-|t_0 + L d|^2`.
    pub t_0: [f32; 2],
    /// Entry of `L`, along x.
    pub l_xx: f32,
    /// Entry of `L` off its diagonal, in the row of x.
    pub l_xy: f32,
    /// Entry of `L`, along y.
    pub l_yy: f32,
    /// `log2(255 opacity)`, which bounds `|t_0 + L d|^2`; 0 if the Gaussian is not drawn.
    pub reach: f32,
    /// RGB, clamped at 0 from below.
    pub color: [f32; 3],
    /// Opacity, with what makes up for dropout; not scaled by the falloff.
    pub opacity: f32,
}

/// One pass of a radix sort; `Radix` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixUniform {
    /// Entries to sort, or room for them if `pairs` is 1.
    pub n: u32,
    /// 1 if there are as many entries as the view has pairs, else 0.
    pub pairs: u32,
    /// Bits below the pass's digit.
    pub shift: u32,
    /// 1 if what moves is counted for the next pass, else 0.
    pub counts_next: u32,
}
