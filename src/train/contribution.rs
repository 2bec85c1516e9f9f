//! This module finds what each Gaussian contributes to the views that are learned from.
//!
//! A Gaussian's contribution is the sum of `alpha T` over pixels, each times its weight in the loss: what it puts of its colour
//! into the images. It is the gradient of the images' sum with respect to its colour, which the backward of the
//! rasterizer has for each (tile, Gaussian) pair when a colour's gradient at every pixel is the pixel's weight. The pairs' sums are
//! added here in their order, in f64.

use super::signal::evenly;
use super::trainer::Trainer;
use crate::error::Result;
use crate::render::{ViewUniform, read_totals};

/// Most virtual views that are looked at, evenly over all: each costs a forward and half a backward, and many show the same.
const MOST_VIRTUAL: usize = 16;

impl Trainer<'_> {
    /// Returns the contribution of every Gaussian after `done` iterations to the photographs and up to 16 virtual views.
    ///
    /// # Errors
    /// A view that the adapter cannot hold, or a GPU fault.
    pub fn contributions(&mut self, done: u32) -> Result<Vec<f64>> {
        let degree = self.sh_degree(done.saturating_sub(1));
        let supervision = self.supervision;
        let shown = evenly(self.virtual_views.len(), MOST_VIRTUAL);
        let real = supervision.real.iter().zip(self.real.clone());
        let shown: Vec<(_, ViewUniform)> = shown
            .map(|i| (&supervision.virtual_views[i], self.virtual_views[i]))
            .chain(real)
            .collect();
        let mut contributions = vec![0.0; self.optimizer.model.n];
        for (view, uniform) in shown {
            view.goal.unpack(&mut self.goal);
            let weights: Vec<f32> = self
                .goal
                .iter()
                .map(|texel| view.weight_of(*texel) as f32)
                .collect();
            self.contribute(uniform, degree, &weights, &mut contributions)?;
        }
        Ok(contributions)
    }

    /// Adds what each Gaussian contributes to one view whose pixels have these weights.
    fn contribute(
        &mut self,
        view: ViewUniform,
        degree: u32,
        weights: &[f32],
        contributions: &mut [f64],
    ) -> Result<()> {
        let gradient = blue_gradient(&view, weights);
        self.pass(view, degree, |pass, commands| {
            pass.workspace
                .buffer("d_rendered")
                .write(pass.gpu, &gradient);
            pass.forward(commands);
            pass.rasterize_backward(commands);
        })?;
        let n_pairs = read_totals(self.gpu, &self.workspace)?.pairs;
        let read = |name| self.workspace.buffer(name);
        let gaussians: Vec<u32> = read("pair_gaussian").read(self.gpu, n_pairs)?;
        let sums: Vec<f32> = read("d_pair_c").read(self.gpu, n_pairs)?;
        for (gaussian, sum) in gaussians.into_iter().zip(sums) {
            contributions[gaussian as usize] += f64::from(sum);
        }
        Ok(())
    }
}

/// Returns `d_rendered`'s planes where the gradient is `weights` (`height * width`) in blue and 0 in red, green and alpha.
fn blue_gradient(view: &ViewUniform, weights: &[f32]) -> Vec<f32> {
    let plane = 4 * view.plane_len();
    let (width, row) = (view.size[0] as usize, 4 * view.padded_size().0);
    let mut gradient = vec![0.0; 4 * plane];
    let blue = &mut gradient[2 * plane..3 * plane];
    for (to, from) in blue.chunks_mut(row).zip(weights.chunks(width)) {
        to[..width].copy_from_slice(from);
    }
    gradient
}
