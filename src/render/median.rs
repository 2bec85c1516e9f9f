//! This module finds the Gaussian in the middle of what every pixel sees.
//!
//! It reads back what a forward pass leaves, projected Gaussians and each tile's list in its order,
//! and blends it again on the CPU, up to the middle. That is a small part of a render, and it needs
//! no kernel of its own.

use rayon::prelude::*;

use super::kernels::Kernels;
use super::model::Model;
use super::renderer::{Rendered, Renderer};
use super::uniforms::{Splat, ViewUniform};
use super::workspace::Workspace;
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::gpu::constants::{ALPHA_MAX, ALPHA_MIN};

/// Stands for no Gaussian: a pixel that more light than half passes through.
pub const NO_MEDIAN: u32 = u32::MAX;

/// Transmittance in the middle.
const HALF: f32 = 0.5;

impl Renderer<'_> {
    /// Renders `view`, and returns with it the Gaussian of every pixel that takes its transmittance
    /// to a half or less, row 0 on top, or [`NO_MEDIAN`].
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn render_medians(
        &mut self,
        model: &Model,
        view: &ViewUniform,
    ) -> Result<(Rendered, Vec<u32>)> {
        let rendered = self.render(model, view)?;
        let (gpu, kernels, workspace) = self.parts();
        let workspace = workspace.ok_or_else(|| Error::new("nothing was rendered"))?;
        let lists = Lists::read(gpu, kernels, workspace, model, view)?;
        Ok((rendered, lists.medians()))
    }
}

/// What a forward pass leaves.
struct Lists {
    splats: Vec<Splat>,
    /// The part of `entries` that each tile blends.
    ranges: Vec<[u32; 2]>,
    /// Gaussian and pair.
    entries: Vec<[u32; 2]>,
    size: [u32; 2],
    tile: [u32; 2],
    /// Tiles across.
    across: u32,
}

impl Lists {
    fn read(
        gpu: &Gpu,
        kernels: &Kernels,
        workspace: &Workspace,
        model: &Model,
        view: &ViewUniform,
    ) -> Result<Lists> {
        let rasterizer = kernels.rasterizer;
        let n_tiles = rasterizer.n_tiles(view.size);
        let ranges: Vec<[u32; 2]> = workspace.buffer("tile_ranges").read(gpu, n_tiles)?;
        let n_entries = ranges.iter().map(|range| range[1]).max().unwrap_or(0);
        Ok(Lists {
            splats: workspace.buffer("splats").read(gpu, model.n)?,
            entries: workspace.tile_splats().read(gpu, n_entries as usize)?,
            ranges,
            size: view.size,
            tile: rasterizer.tile(),
            across: rasterizer.tiles(view.size)[0],
        })
    }

    fn medians(&self) -> Vec<u32> {
        let width = self.size[0];
        let mut medians = vec![NO_MEDIAN; width as usize * self.size[1] as usize];
        medians
            .par_chunks_exact_mut(width as usize)
            .zip(0..self.size[1])
            .for_each(|(row, y)| {
                for (pixel, x) in row.iter_mut().zip(0..width) {
                    *pixel = self.median(x, y);
                }
            });
        medians
    }

    /// Blends as `rasterize` does, until half of the light is taken.
    fn median(&self, x: u32, y: u32) -> u32 {
        let tile = (y / self.tile[1]) * self.across + x / self.tile[0];
        let [first, end] = self.ranges[tile as usize].map(|at| at as usize);
        let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
        let mut transmittance = 1.0;
        for [gaussian, _] in &self.entries[first.min(end)..end] {
            let splat = &self.splats[*gaussian as usize];
            let (dx, dy) = (px - splat.anchor[0], py - splat.anchor[1]);
            let t_x = splat.t_0[0] + splat.l_xx * dx + splat.l_xy * dy;
            let t_y = splat.t_0[1] + splat.l_yy * dy;
            let alpha = splat.opacity * (-(t_x * t_x + t_y * t_y)).exp2();
            if alpha < ALPHA_MIN as f32 {
                continue;
            }
            transmittance *= 1.0 - alpha.min(ALPHA_MAX as f32);
            if transmittance <= HALF {
                return *gaussian;
            }
        }
        NO_MEDIAN
    }
}
