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
    pub center_near: [f32; 4],
    pub center_low: [f32; 4],
    pub intrinsics: [f32; 4],
    pub intrinsics_low: [f32; 4],
    pub ratio_bounds: [f32; 4],
    pub ratio_bounds_low: [f32; 4],
    pub background: [f32; 4],
    pub size: [u32; 4],
    pub counts: [u32; 4],
    pub planes: [u32; 4],
    pub drop_share: [f32; 4],
    pub drop_layers: [f32; 4],
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
        let [x, y, z] = camera.center().to_array();
        let (mut center_near, center_low) = parts([x, y, z, 0.0]);
        center_near[3] = near.max(MIN_NEAR) as f32;
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let low = |c: f64, size: f64, f: f64| -(c + RATIO_MARGIN * size) / f;
        let high = |c: f64, size: f64, f: f64| (size - c + RATIO_MARGIN * size) / f;
        let (intrinsics, intrinsics_low) = parts([camera.fx, camera.fy, camera.cx, camera.cy]);
        let (ratio_bounds, ratio_bounds_low) = parts([
            low(camera.cx, w, camera.fx),
            high(camera.cx, w, camera.fx),
            low(camera.cy, h, camera.fy),
            high(camera.cy, h, camera.fy),
        ]);
        let (width_4, padded_height) = padded(camera.width, camera.height);
        ViewUniform {
            w2c_x,
            w2c_y,
            w2c_z,
            w2c_low_x,
            w2c_low_y,
            w2c_low_z,
            center_near,
            center_low,
            intrinsics,
            intrinsics_low,
            ratio_bounds,
            ratio_bounds_low,
            background: [
                background[0] as f32,
                background[1] as f32,
                background[2] as f32,
                0.0,
            ],
            size: [
                camera.width,
                camera.height,
                camera.width.div_ceil(TILE_W),
                camera.height.div_ceil(TILE_H),
            ],
            counts: [0; 4],
            // An image too large for its index is too large for every buffer, too.
            planes: [width_4.saturating_mul(padded_height), width_4, 0, 0],
            drop_share: [1.0, 0.0, 0.0, 1.0],
            drop_layers: [f32::INFINITY, f32::INFINITY, 0.0, 0.0],
        }
    }

    /// The same view with dropout: each Gaussian is left out with probability `rate` (below 1), and
    /// the others have their opacity divided by `1 - rate` (DropGaussian, Park et al. 2025). Which
    /// ones, `key` decides.
    pub fn with_dropout(mut self, rate: f64, key: u32) -> ViewUniform {
        self.counts[2] = (rate * 2f64.powi(32)) as u32;
        self.counts[3] = key;
        self
    }

    /// The same view with every Gaussian's probability multiplied by `x + y distance + z density`,
    /// at 0.7 beyond the first and 0.3 beyond the second of the `layers`, distances from the
    /// camera; the others keep their opacity (D2GS, Song et al. 2026).
    pub fn with_guided_dropout(mut self, [x, y, z]: [f64; 3], layers: [f64; 2]) -> ViewUniform {
        self.drop_share = [x as f32, y as f32, z as f32, 0.0];
        self.drop_layers = [layers[0] as f32, layers[1] as f32, 0.0, 0.0];
        self
    }

    /// The optical centre, to more digits than `f32` has.
    pub fn center(&self) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(self.center_near[i]) + f64::from(self.center_low[i]))
    }

    pub fn n_tiles(&self) -> usize {
        self.size[2] as usize * self.size[3] as usize
    }

    /// Threads of the rasterizers, one a tile: whole blocks of tiles.
    pub fn n_tile_slots(&self) -> usize {
        let blocks =
            self.size[2].div_ceil(BLOCK_W) as usize * self.size[3].div_ceil(BLOCK_H) as usize;
        blocks.saturating_mul(WORKGROUP as usize)
    }

    /// `vec4f`s of one plane of the padded image.
    pub fn plane_len(&self) -> usize {
        self.planes[0] as usize
    }

    /// Pixels of the image itself.
    pub fn n_pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Pixels of four a row of the padded image, and its rows.
    pub fn padded_size(&self) -> (usize, usize) {
        (
            self.planes[1] as usize,
            (self.planes[0] / self.planes[1]) as usize,
        )
    }
}

/// Numbers as `f32`, and what that leaves.
pub(crate) fn parts(values: [f64; 4]) -> ([f32; 4], [f32; 4]) {
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

/// One pass of a radix sort; `Radix` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixUniform {
    pub n: u32,
    pub pairs: u32,
    pub shift: u32,
    pub pad: u32,
}
