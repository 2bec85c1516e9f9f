//! Renders single views and reads them back, for evaluation, `render` and tests.

use super::capacity::Capacity;
use super::kernels::{Bound, Kernels};
use super::model::Model;
use super::pass::{Pass, PassStep};
use super::room::{read_totals, until_it_fits};
use super::uniforms::ViewUniform;
use super::workspace::Workspace;
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Commands, Gpu};

/// A rendered view, row 0 on top, values unclamped.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Width of the image, pixels.
    pub width: u32,
    /// Height of the image, pixels.
    pub height: u32,
    /// `[height][width][3]`.
    pub rgb: Vec<f32>,
    /// `[height][width]`: 1 - final transmittance.
    pub alpha: Vec<f32>,
}

/// Renders views of any size one after the other; its buffers grow as needed.
pub struct Renderer<'a> {
    gpu: &'a Gpu,
    kernels: &'a Kernels,
    workspace: Option<Workspace>,
}

impl<'a> Renderer<'a> {
    /// Makes a renderer without buffers yet.
    pub fn new(gpu: &'a Gpu, kernels: &'a Kernels) -> Renderer<'a> {
        Renderer {
            gpu,
            kernels,
            workspace: None,
        }
    }

    /// Returns what the last render was made with and in.
    pub(super) fn parts(&self) -> (&'a Gpu, &'a Kernels, Option<&Workspace>) {
        (self.gpu, self.kernels, self.workspace.as_ref())
    }

    /// Renders `view` with SH up to the model's degree.
    ///
    /// # Errors
    /// The view has more (tile, Gaussian) pairs than the adapter can bind, or the GPU has a fault.
    pub fn render(&mut self, model: &Model, view: &ViewUniform) -> Result<Rendered> {
        let gpu = self.gpu;
        let rasterizer = self.kernels.rasterizer;
        let needed = Capacity::new(rasterizer, model.stride, 4 * model.n.max(1024), &[*view]);
        until_it_fits(gpu, needed, |needed| {
            let workspace = Workspace::reserved(gpu, self.workspace.take(), needed, false)?;
            let bound = Bound::new(gpu, self.kernels, &workspace, model);
            let step = PassStep {
                slot: 0,
                sh_degree: model.sh_degree,
                number: 1,
            };
            let pass = Pass::new(gpu, self.kernels, &workspace, &bound, model, *view, step);
            let mut commands = Commands::new(gpu);
            commands.clear(workspace.buffer("totals"));
            pass.forward(&mut commands);
            commands.submit();
            let totals = read_totals(gpu, &workspace);
            self.workspace = Some(workspace);
            totals
        })?;
        match &self.workspace {
            Some(workspace) => read_rendered(gpu, workspace.buffer("rendered"), view),
            None => Err(Error::new("nothing was rendered")),
        }
    }
}

/// Reads colour and transmittance planes back into interleaved rows.
///
/// # Errors
/// A GPU fault.
pub fn read_rendered(gpu: &Gpu, rendered: &Buffer, view: &ViewUniform) -> Result<Rendered> {
    let plane = 4 * view.plane_len();
    let values: Vec<f32> = rendered.read(gpu, 4 * plane)?;
    let (width, height) = (view.size[0] as usize, view.size[1] as usize);
    let row_len = 4 * view.padded_size().0;
    let mut rgb = Vec::with_capacity(3 * width * height);
    let mut alpha = Vec::with_capacity(width * height);
    for y in 0..height {
        for i in y * row_len..y * row_len + width {
            rgb.extend([values[i], values[plane + i], values[2 * plane + i]]);
            alpha.push(1.0 - values[3 * plane + i]);
        }
    }
    Ok(Rendered {
        width: view.size[0],
        height: view.size[1],
        rgb,
        alpha,
    })
}
