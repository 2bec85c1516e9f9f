//! Uniform structs shared with WGSL (`shaders/shared/view.wgsl`, `loss.wgsl`).

use bytemuck::{Pod, Zeroable};

use crate::camera::Camera;
use crate::gpu::constants::{BLOCK_H, BLOCK_W, RATIO_MARGIN, SSIM_ROWS, TILE_H, TILE_W, WORKGROUP};

/// Smallest near plane: depths reach 2^127 times as far, which from 0 is nowhere.
const MIN_NEAR: f64 = 1e-18;

/// One rendered view; `View` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ViewUniform {
    pub w2c_x: [f32; 4],
    pub w2c_y: [f32; 4],
    pub w2c_z: [f32; 4],
    pub w2c_low_x: [f32; 4],
    pub w2c_low_y: [f32; 4],
    pub w2c_low_z: [f32; 4],
    pub center: [f32; 3],
    pub near: f32,
    pub center_low: [f32; 3],
    pub zero: f32,
    pub focal: [f32; 2],
    pub principal: [f32; 2],
    pub focal_low: [f32; 2],
    pub principal_low: [f32; 2],
    pub ratio_min: [f32; 2],
    pub ratio_max: [f32; 2],
    pub ratio_min_low: [f32; 2],
    pub ratio_max_low: [f32; 2],
    pub background: [f32; 3],
    pub pad_0: f32,
    pub size: [u32; 2],
    pub tiles: [u32; 2],
    pub n_gaussians: u32,
    pub stride: u32,
    pub drop_threshold: u32,
    pub drop_key: u32,
    pub plane_vectors: u32,
    pub row_vectors: u32,
    pub slot: u32,
    pub longest_list: u32,
    pub share_base: f32,
    pub share_per_distance: f32,
    pub share_per_density: f32,
    pub compensates: f32,
    pub near_layer: f32,
    pub middle_layer: f32,
    pub pad_1: [f32; 2],
}

impl ViewUniform {
    /// The camera's part, without dropout; numbers and slot are set where the view is rendered.
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
            tiles: [
                camera.width.div_ceil(TILE_W),
                camera.height.div_ceil(TILE_H),
            ],
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
            pad_1: [0.0; 2],
        }
    }

    /// The same view with dropout: each Gaussian is left out with probability `rate` (below 1), and
    /// the others have their opacity divided by `1 - rate` (DropGaussian, Park et al. 2025). Which
    /// ones, `key` decides.
    pub fn with_dropout(mut self, rate: f64, key: u32) -> ViewUniform {
        self.drop_threshold = (rate * 2f64.powi(32)) as u32;
        self.drop_key = key;
        self
    }

    /// The same view with every Gaussian's probability multiplied by its own share; the others keep
    /// their opacity (D2GS, Song et al. 2026).
    pub fn with_guided_dropout(mut self, share: DropShare) -> ViewUniform {
        self.share_base = share.base as f32;
        self.share_per_distance = share.per_distance as f32;
        self.share_per_density = share.per_density as f32;
        self.compensates = 0.0;
        self.near_layer = share.near_layer as f32;
        self.middle_layer = share.middle_layer as f32;
        self
    }

    /// The optical centre, to more digits than `f32` has.
    pub fn center(&self) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(self.center[i]) + f64::from(self.center_low[i]))
    }

    pub fn n_tiles(&self) -> usize {
        self.tiles[0] as usize * self.tiles[1] as usize
    }

    /// Threads of the rasterizers, one a tile: whole blocks of tiles.
    pub fn n_tile_slots(&self) -> usize {
        let blocks =
            self.tiles[0].div_ceil(BLOCK_W) as usize * self.tiles[1].div_ceil(BLOCK_H) as usize;
        blocks.saturating_mul(WORKGROUP as usize)
    }

    /// `vec4f`s of one plane of the padded image.
    pub fn plane_len(&self) -> usize {
        self.plane_vectors as usize
    }

    /// Pixels of the image itself.
    pub fn n_pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Pixels of four a row of the padded image, and its rows.
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
    pub base: f64,
    pub per_distance: f64,
    pub per_density: f64,
    pub near_layer: f64,
    pub middle_layer: f64,
}

/// Numbers as `f32`, and what that leaves.
pub(crate) fn parts<const N: usize>(values: [f64; N]) -> ([f32; N], [f32; N]) {
    let high = values.map(|v| v as f32);
    let low = std::array::from_fn(|i| (values[i] - f64::from(high[i])) as f32);
    (high, low)
}

/// Vectors of four pixels a row and rows of the padded image: whole tiles and whole SSIM strips.
fn padded(width: u32, height: u32) -> (u32, u32) {
    let rows = if TILE_H.is_multiple_of(SSIM_ROWS) {
        TILE_H
    } else {
        TILE_H * SSIM_ROWS
    };
    let padded_height = height.checked_next_multiple_of(rows);
    (width.div_ceil(4), padded_height.unwrap_or(u32::MAX))
}

/// One image loss; `Loss` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LossUniform {
    pub l1_scale: f32,
    pub ssim_scale: f32,
    pub masked: u32,
    pub mean_scale: f32,
    pub slot: u32,
    pub n_partials: u32,
    pub pad_0: u32,
    pub pad_1: u32,
}

impl LossUniform {
    /// `weight ((1 - ssim_weight) L1 + ssim_weight (1 - SSIM))`. With a mask the goal's alpha is
    /// the pixels' weight `m_p`, and both means are weighted by it: `L1 = sum m_p |x_p - y_p| /
    /// sum m_p`, SSIM likewise with the weights in its windows, too. `total_weight` is
    /// `sum m_p`, without a mask the number of pixels.
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
            pad_0: 0,
            pad_1: 0,
        }
    }
}

/// One prefix sum; `Scan` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ScanUniform {
    pub n: u32,
    pub total: u32,
    pub capacity: u32,
    pub step: u32,
}

/// What a dispatch of `bin` does; `Bin` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BinUniform {
    /// 0: count pairs, 1: emit them.
    pub emits: u32,
    pub pad: [u32; 3],
}

/// The slice of every list that a rasterizer takes; `Slice` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SliceUniform {
    /// Its first entry.
    pub first: u32,
    pub pad: [u32; 3],
}

/// A projected Gaussian; `Splat` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Splat {
    pub anchor: [f32; 2],
    pub t_0: [f32; 2],
    pub l_xx: f32,
    pub l_xy: f32,
    pub l_yy: f32,
    pub reach: f32,
    pub color: [f32; 3],
    pub opacity: f32,
}

/// One pass of a radix sort; `Radix` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixUniform {
    pub n: u32,
    pub pairs: u32,
    pub shift: u32,
    pub pad: u32,
}
