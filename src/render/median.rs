//! This module finds the Gaussian in the middle of what every pixel sees, by blending the lists of a forward pass
//! again on the CPU, up to the middle.

use rayon::prelude::*;

use super::lists::Lists;
use super::model::Model;
use super::renderer::{Rendered, Renderer};
use super::uniforms::ViewUniform;
use crate::error::{Error, Result};
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
        Ok((rendered, medians(&lists)))
    }
}

fn medians(lists: &Lists) -> Vec<u32> {
    let [width, height] = lists.size();
    let mut medians = vec![NO_MEDIAN; width as usize * height as usize];
    medians
        .par_chunks_exact_mut(width as usize)
        .zip(0..height)
        .for_each(|(row, y)| {
            for (pixel, x) in row.iter_mut().zip(0..width) {
                *pixel = median(lists, x, y);
            }
        });
    medians
}

/// Blends as `rasterize` does, until half of the light is taken.
fn median(lists: &Lists, x: u32, y: u32) -> u32 {
    let mut transmittance = 1.0;
    for listed in lists.at(x, y) {
        if listed.alpha < ALPHA_MIN as f32 {
            continue;
        }
        transmittance *= 1.0 - listed.alpha.min(ALPHA_MAX as f32);
        if transmittance <= HALF {
            return listed.gaussian;
        }
    }
    NO_MEDIAN
}
