//! The trainer with a network that makes the Gaussians: they are written from it, and their gradients read for it.

use glam::Vec3;
use nalgebra::DMatrix;

use super::generator::OUTPUTS;
use super::trainer::{StepViews, Trainer};
use crate::error::{Error, Result};
use crate::gaussians::SH_0;
use crate::render::read_totals;

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
