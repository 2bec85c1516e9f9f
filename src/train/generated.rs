//! The trainer with a network that makes the Gaussians: they are written from it, and their gradients read for it.

use glam::Vec3;
use nalgebra::DMatrix;

use super::generator::{Generator, OUTPUTS};
use super::trainer::{StepViews, Trainer};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::gaussians::{Gaussians, SH_0};
use crate::render::read_totals;

/// Share of the Gaussians that lie within the planes; those beyond see the border.
const WITHIN: f64 = 0.95;

/// The network, and how what it makes becomes Gaussians.
pub(super) struct Generated {
    network: Generator<f32>,
    /// Half of a plane's side, in `R`.
    reach: f32,
    /// The logarithms of the first scales.
    scales_log: Vec<Vec3>,
    /// Centres as last made, in `R`.
    means: Vec<Vec3>,
}

impl Generated {
    /// Draws a network for `start`.
    pub(super) fn new(start: &Gaussians, config: &Config) -> Generated {
        let reach = reach(&start.means);
        let places = DMatrix::from_fn(3, start.len(), |row, i| {
            f64::from(start.means[i][row] / reach)
        });
        let noise_side = config.generator.noise_side as usize;
        Generated {
            network: Generator::new(&places, noise_side, config.seed),
            reach,
            scales_log: start.scales_log.clone(),
            means: Vec::new(),
        }
    }

    /// Returns the number of the network's parameters.
    pub(super) fn n_parameters(&self) -> usize {
        self.network.parameters.len()
    }

    /// Returns the parameters and their moments as bytes.
    pub(super) fn buffers(&self) -> impl Iterator<Item = Vec<u8>> {
        let moments = self.network.moments.iter();
        let all = std::iter::once(&self.network.parameters).chain(moments);
        all.map(|values| bytemuck::cast_slice(values).to_vec())
    }

    /// Takes up what [`Generated::buffers`] has returned, in a row and whole.
    pub(super) fn refill(&mut self, bytes: &[u8]) {
        let network = &mut self.network;
        let [first, second] = &mut network.moments;
        let own = [&mut network.parameters, first, second];
        let parts = bytes.chunks_exact(bytes.len() / own.len());
        for (own, bytes) in own.into_iter().zip(parts) {
            bytemuck::cast_slice_mut(own).copy_from_slice(bytes);
        }
    }
}

/// Returns the half side of the cube about the focus in which most of the places lie.
fn reach(means: &[Vec3]) -> f32 {
    let mut sizes: Vec<f32> = means.iter().map(|mean| mean.abs().max_element()).collect();
    sizes.sort_by(f32::total_cmp);
    let within = (WITHIN * sizes.len() as f64) as usize;
    let reach = sizes.get(within).copied().unwrap_or(1.0);
    if reach > 0.0 { reach } else { 1.0 }
}

/// Returns what the network and its work take on the host, for `n` Gaussians.
pub fn generator_bytes(n: usize, config: &Config) -> u64 {
    match config.generator.enabled {
        true => Generator::<f32>::bytes(n, config.generator.noise_side as usize),
        false => 0,
    }
}

impl Trainer<'_> {
    /// Writes the Gaussians that the network makes now, where there is one.
    pub(super) fn generate(&mut self) {
        let Some(generated) = &mut self.generated else {
            return;
        };
        let made = generated.network.forward();
        let model = &self.optimizer.model;
        let mut geometry = vec![[0.0_f32; 4]; 3 * model.stride];
        let mut colors = vec![[0.0_f32; 4]; model.n];
        generated.means.clear();
        for (i, of) in made.column_iter().enumerate() {
            let mean = generated.reach * Vec3::new(of[0], of[1], of[2]);
            let scale = generated.scales_log[i] + Vec3::new(of[4], of[5], of[6]);
            geometry[i] = [mean.x, mean.y, mean.z, of[3]];
            geometry[model.stride + i] = [scale.x, scale.y, scale.z, 0.0];
            geometry[2 * model.stride + i] = [of[7], of[8], of[9], of[10]];
            let color = [of[11], of[12], of[13]].map(|c| (c - 0.5) / SH_0 as f32);
            colors[i] = [color[0], color[1], color[2], 0.0];
            generated.means.push(mean);
        }
        model.blocks[0].write(self.gpu, &geometry);
        model.blocks[1].write(self.gpu, &colors);
    }

    /// Takes the network's step from the gradients of the Gaussians that iteration `iteration` (from 0) has left.
    ///
    /// # Errors
    /// A GPU fault, or a gradient that is not finite.
    pub(super) fn train_generator(&mut self, iteration: u32, views: StepViews) -> Result<()> {
        if self.generated.is_none() {
            return Ok(());
        }
        // A step whose pairs did not fit has no gradient; it is taken again.
        if read_totals(self.gpu, &self.workspace)?.overflow_step != 0 {
            return Ok(());
        }
        let d = self.made_gradient(views)?;
        let Some(generated) = &mut self.generated else {
            return Ok(());
        };
        let gradient = generated.network.backward(&d);
        if gradient.iter().any(|g| !g.is_finite()) {
            return Err(Error::new(format!(
                "the generator's gradient is not finite in iteration {}",
                iteration + 1
            ))
            .way_out("lower generator.lr_start"));
        }
        let (config, o) = (&self.config.generator, &self.config.optimizer);
        let progress = f64::from(iteration) / f64::from(self.config.iterations.max(1));
        let rate = config.lr_start * (config.lr_end / config.lr_start).powf(progress);
        let rate = rate * self.settling.rate(iteration);
        let decays = ([o.beta1, o.beta2], o.epsilon);
        generated
            .network
            .step(&gradient, (iteration + 1, rate), decays);
        self.generate();
        Ok(())
    }

    /// Reads the gradient of what the network has made.
    fn made_gradient(&self, views: StepViews) -> Result<DMatrix<f32>> {
        let (n, stride) = (self.optimizer.model.n, self.optimizer.model.stride);
        let n_views = 1 + usize::from(views.virtual_view.is_some());
        let geometry = self.workspace.buffer("d_geometry");
        let geometry: Vec<[f32; 4]> = geometry.read(self.gpu, 3 * stride)?;
        let colors = self.workspace.buffer("d_color");
        let colors: Vec<[f32; 4]> = colors.read(self.gpu, n_views * stride)?;
        let mut d = DMatrix::zeros(OUTPUTS, n);
        let Some(generated) = &self.generated else {
            return Ok(d);
        };
        let norm = self.config.generator.norm_weight as f32 / n.max(1) as f32;
        for (i, mut d) in d.column_iter_mut().enumerate() {
            let outward = generated.means[i].normalize_or_zero().to_array();
            let [mean, scale, rotation] = [0, 1, 2].map(|plane| geometry[plane * stride + i]);
            for axis in 0..3 {
                d[axis] = generated.reach * (mean[axis] + norm * outward[axis]);
                d[4 + axis] = scale[axis];
                d[11 + axis] = (0..n_views)
                    .map(|view| colors[view * stride + i][axis])
                    .sum();
            }
            d[3] = mean[3];
            for part in 0..4 {
                d[7 + part] = rotation[part];
            }
        }
        Ok(d)
    }
}
