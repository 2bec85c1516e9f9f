//! One view of one model on the GPU, every stage of it open to inspection, and every output
//! poisoned before it is computed.

use bytemuck::Pod;
use glam::{DMat3, DVec3, Vec3};

use crate::camera::Camera;
use crate::config::{Exp2Choice, RasterizerChoice};
use crate::doctor::twin::dropout::TwinDropout;
use crate::doctor::twin::model::{TwinCamera, TwinGaussians};
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::shader::Sources;
use crate::gpu::{Buffer, Commands, Exp2, Gpu, Kernel, Rasterizer, exp2};
use crate::render::{
    Bound, Capacity, DepthKernels, Kernels, LossUniform, Model, Pass, PassStep, PoseKernels,
    Rendered, ViewUniform, Workspace, read_rendered, read_totals, until_it_fits,
};
use crate::train::guide::Guide;
use crate::train::optimizer::OptimizerKernels;
use crate::train::partner::exchange::ExchangeKernels;

/// An adapter with every kernel.
pub struct Context {
    /// The opened adapter.
    pub gpu: Gpu,
    /// Kernels of a view, forward and backward.
    pub kernels: Kernels,
    /// Kernels of the optimiser and of changes of the set.
    pub optimizer: OptimizerKernels,
    /// Kernels of the gradient with respect to the camera's pose.
    pub pose: PoseKernels,
    /// Kernels that hand over between two sets of Gaussians.
    pub exchange: ExchangeKernels,
    /// Kernels of depths and normals.
    pub depth: DepthKernels,
    /// Whose 2^x the program's own kernels take.
    pub exp2: Exp2,
    /// Takes 2^x as the rasterizers do.
    pub powers: Kernel,
}

impl Context {
    /// Takes all kernels, with the rasterizer and the 2^x that the rules give this adapter.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn new(gpu: Gpu) -> Result<Context> {
        let rasterizer = Rasterizer::of(RasterizerChoice::Auto, &gpu);
        let exp2 = Exp2::of(Exp2Choice::Auto, &gpu)?;
        let ctx = Self::from_sources(gpu, rasterizer, exp2.sources());
        Ok(Context { exp2, ..ctx })
    }

    /// Does the same as [`Context::new`] with another rasterizer, and other sources than the program's.
    pub fn from_sources(gpu: Gpu, rasterizer: Rasterizer, sources: Sources<'_>) -> Context {
        Context {
            kernels: Kernels::from_sources(rasterizer, sources),
            optimizer: OptimizerKernels::from_sources(sources),
            pose: PoseKernels::from_sources(sources),
            exchange: ExchangeKernels::from_sources(sources),
            depth: DepthKernels::from_sources(rasterizer, sources),
            exp2: Exp2::Polynomial,
            powers: exp2::kernel(sources),
            gpu,
        }
    }

    /// Makes a context of the same adapter with another rasterizer.
    pub fn with_rasterizer(self, rasterizer: Rasterizer) -> Context {
        Context {
            kernels: Kernels::from_sources(rasterizer, self.exp2.sources()),
            depth: DepthKernels::from_sources(rasterizer, self.exp2.sources()),
            ..self
        }
    }
}

/// A NaN as f32, far beyond any index as u32.
pub const POISON: u32 = 0x7fc0_dead;

/// Buffers that the stages read but do not write, or that the host has written for good.
const INPUTS: [&str; 7] = ["view", "loss", "geometry", "sh_0", "sh_2", "sh_3", "goal"];

/// One view of one model, with the buffers for its backward.
pub struct Rig {
    /// The Gaussians, without room for more.
    pub model: Model,
    /// Buffers of the view and of its backward.
    pub workspace: Workspace,
    /// Bind groups of `workspace` and `model`.
    pub bound: Bound,
    /// Camera, image and dropout of the view.
    pub view: ViewUniform,
    /// The active degree.
    pub sh_degree: u32,
}

/// Gradients of a view as the GPU leaves them.
pub struct ViewGradients {
    /// To the means, `[n][3]`.
    pub means: Vec<f64>,
    /// To the opacity logits, `[n]`.
    pub opacity_logit: Vec<f64>,
    /// To the logarithms of the scales, `[n][3]`.
    pub scale_log: Vec<f64>,
    /// To the quaternions as stored, `[n][4]`.
    pub rotation_wxyz: Vec<f64>,
    /// To the colours, `[n]` of RGB; 0 where a colour is clamped at 0.
    pub color: Vec<[f64; 3]>,
}

impl Rig {
    /// Uploads Gaussians and allocates the buffers of one view and of its backward.
    ///
    /// # Errors
    /// A case that the adapter cannot hold.
    pub fn new(
        ctx: &Context,
        gaussians: &Gaussians,
        view: ViewUniform,
        sh_degree: u32,
    ) -> Result<Rig> {
        let gpu = &ctx.gpu;
        let model = Model::upload(gpu, gaussians, gaussians.len())?;
        let capacity = Capacity::new(
            ctx.kernels.rasterizer,
            model.stride,
            4 * gaussians.len().max(64),
            &[view],
        );
        let workspace = Workspace::new(gpu, capacity, true)?;
        let bound = Bound::new(gpu, &ctx.kernels, &workspace, &model);
        Ok(Rig {
            model,
            workspace,
            bound,
            view,
            sh_degree,
        })
    }

    /// Makes a rig for the reference's Gaussians and camera. Coefficients above the view's degree
    /// are there and must not matter.
    ///
    /// # Errors
    /// As [`Rig::new`], or a GPU fault.
    pub fn of_twin(ctx: &Context, gaussians: &TwinGaussians, camera: &TwinCamera) -> Result<Rig> {
        let degree = gaussians.sh_degree as u32;
        let own = gaussians_of(gaussians, 3);
        let mut view = view_of(camera);
        let guide = camera.dropout.as_ref().and_then(|d| d.guide.as_ref());
        if let (Some(twin), Some(guide)) =
            (guide, Guide::of(camera_of(camera).center(), &own.means))
        {
            view = guide.applied(twin.weights, view);
        }
        let rig = Self::new(ctx, &own, view, degree)?;
        if let Some(guide) = guide {
            let densities: Vec<f32> = guide.densities.iter().map(|d| *d as f32).collect();
            rig.model.set_densities(&ctx.gpu, &densities)?;
        }
        Ok(rig)
    }

    /// Returns the view's stages, to be recorded.
    pub fn pass<'a>(&'a self, ctx: &'a Context) -> Pass<'a> {
        self.pass_in(ctx, 0)
    }

    /// Returns the stages of the view in this slot of a step.
    pub fn pass_in<'a>(&'a self, ctx: &'a Context, slot: usize) -> Pass<'a> {
        Pass::new(
            &ctx.gpu,
            &ctx.kernels,
            &self.workspace,
            &self.bound,
            &self.model,
            self.view,
            PassStep {
                slot,
                sh_degree: self.sh_degree,
                number: 1,
            },
        )
    }

    /// Returns the buffer of this name in the shaders.
    ///
    /// # Panics
    /// If there is none: a fault in this program.
    pub fn buffer(&self, name: &str) -> &Buffer {
        let names = self.workspace.names(&self.model, 0);
        let found = names.into_iter().find(|(n, _)| *n == name);
        found.unwrap_or_else(|| panic!("no buffer `{name}`")).1
    }

    /// Reads the first `len` values of the buffer of this name.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read<T: Pod>(&self, ctx: &Context, name: &str, len: usize) -> Result<Vec<T>> {
        self.buffer(name).read(&ctx.gpu, len)
    }

    /// Fills every buffer that the stages write with [`POISON`].
    pub fn poison(&self, ctx: &Context) {
        for (name, buffer) in self.workspace.names(&self.model, 0) {
            if !INPUTS.contains(&name) {
                buffer.write(&ctx.gpu, &vec![POISON; buffer.bytes() as usize / 4]);
            }
        }
    }

    /// Poisons the buffers and clears the counts, as the first stage expects it.
    pub fn start(&self, ctx: &Context) {
        self.poison(ctx);
        let mut commands = Commands::new(&ctx.gpu);
        commands.clear(self.workspace.buffer("totals"));
        commands.submit();
    }

    /// Poisons the buffers, renders, and makes room if the pairs do not fit.
    ///
    /// # Errors
    /// A GPU fault, or more pairs than the adapter can hold.
    pub fn forward(&mut self, ctx: &Context) -> Result<Rendered> {
        let gpu = &ctx.gpu;
        until_it_fits(gpu, self.workspace.capacity, |needed| {
            if !self.workspace.capacity.holds(&needed) {
                self.workspace = Workspace::new(gpu, needed, true)?;
                self.bound = Bound::new(gpu, &ctx.kernels, &self.workspace, &self.model);
            }
            self.start(ctx);
            let mut commands = Commands::new(gpu);
            self.pass(ctx).forward(&mut commands);
            commands.submit();
            read_totals(gpu, &self.workspace)
        })?;
        self.read_rendered(ctx)
    }

    /// Reads the image as the last rasterization left it.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read_rendered(&self, ctx: &Context) -> Result<Rendered> {
        read_rendered(&ctx.gpu, self.workspace.buffer("rendered"), &self.view)
    }

    /// Fills the target image of a slot with [`POISON`].
    pub fn poison_goal(&self, ctx: &Context, slot: usize) {
        let goal = self.workspace.of_slot("goal", slot);
        goal.write(&ctx.gpu, &vec![POISON; goal.bytes() as usize / 4]);
    }

    /// Reads the target image of a slot, without its padding.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read_goal(&self, ctx: &Context, slot: usize) -> Result<Vec<u32>> {
        let goal = self.workspace.of_slot("goal", slot);
        let texels: Vec<u32> = goal.read(&ctx.gpu, 4 * self.view.plane_len())?;
        Ok(self.pixels().map(|i| texels[i]).collect())
    }

    /// Reads the first three planes of an image buffer as interleaved pixels, without its padding.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read_rgb(&self, ctx: &Context, name: &str) -> Result<Vec<f64>> {
        let plane = 4 * self.view.plane_len();
        let values: Vec<f32> = self.read(ctx, name, 3 * plane)?;
        let of_pixel = |i: usize| [0, 1, 2].map(|p| f64::from(values[p * plane + i]));
        Ok(self.pixels().flat_map(of_pixel).collect())
    }

    /// Reads one plane of an image.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn read_plane(&self, ctx: &Context, name: &str, plane: usize) -> Result<Vec<f64>> {
        let len = 4 * self.view.plane_len();
        let values: Vec<f32> = self.read(ctx, name, (plane + 1) * len)?;
        Ok(self
            .pixels()
            .map(|i| f64::from(values[plane * len + i]))
            .collect())
    }

    /// Returns the places of the image's pixels in a padded plane.
    pub(super) fn pixels(&self) -> impl Iterator<Item = usize> {
        let row_len = 4 * self.view.padded_size().0;
        let (width, height) = (self.view.size[0] as usize, self.view.size[1] as usize);
        (0..height).flat_map(move |y| y * row_len..y * row_len + width)
    }

    /// Writes an image of interleaved colours and a fourth plane; its padding holds `padding`.
    pub fn write_image(
        &self,
        ctx: &Context,
        name: &str,
        rgb: &[f64],
        fourth: &[f64],
        padding: f32,
    ) {
        let len = 4 * self.view.plane_len();
        let mut values = vec![padding; 4 * len];
        for (i, (rgb, fourth)) in self.pixels().zip(rgb.chunks_exact(3).zip(fourth)) {
            for (p, value) in rgb.iter().chain([fourth]).enumerate() {
                values[p * len + i] = *value as f32;
            }
        }
        self.buffer(name).write(&ctx.gpu, &values);
    }

    /// Returns the gradient of `sum(d_rgb * rgb) + sum(d_alpha * alpha)` after [`Rig::forward`].
    ///
    /// # Errors
    /// A GPU fault.
    pub fn backward(&self, ctx: &Context, d_rgb: &[f64], d_alpha: &[f64]) -> Result<ViewGradients> {
        self.write_image(ctx, "d_rendered", d_rgb, d_alpha, 0.0);
        let mut commands = Commands::new(&ctx.gpu);
        self.pass(ctx).backward(&mut commands);
        commands.submit();
        self.gradients(ctx)
    }

    /// Reads the gradients that the last backward has left.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn gradients(&self, ctx: &Context) -> Result<ViewGradients> {
        let (n, stride) = (self.model.n, self.model.stride);
        let planes: Vec<[f32; 4]> = self.read(ctx, "d_geometry", 3 * stride)?;
        let color: Vec<[f32; 4]> = self.read(ctx, "d_color", n)?;
        let part = |plane: usize, first: usize, len: usize| -> Vec<f64> {
            planes[plane * stride..][..n]
                .iter()
                .flat_map(|v| v[first..first + len].iter().map(|x| f64::from(*x)))
                .collect()
        };
        Ok(ViewGradients {
            means: part(0, 0, 3),
            opacity_logit: part(0, 3, 1),
            scale_log: part(1, 0, 3),
            rotation_wxyz: part(2, 0, 4),
            color: color
                .iter()
                .map(|c| [c[0], c[1], c[2]].map(f64::from))
                .collect(),
        })
    }

    /// Computes the image loss of the buffer `rendered` against a target image, RGBA8; returns
    /// `[L1, SSIM]`.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn loss(&self, ctx: &Context, loss: LossUniform, goal: &[u32]) -> Result<[f64; 2]> {
        self.workspace.set_goal(&ctx.gpu, 0, &self.view, goal);
        let mut commands = Commands::new(&ctx.gpu);
        self.pass(ctx).loss(&mut commands, loss);
        commands.submit();
        let losses = self.workspace.read_losses(&ctx.gpu)?;
        Ok(losses.first().copied().unwrap_or_default())
    }
}

/// Converts a twin's Gaussians, which are exact in single precision, with SH up to `sh_degree`.
pub fn gaussians_of(twin: &TwinGaussians, sh_degree: u32) -> Gaussians {
    let n_sh = (sh_degree as usize + 1).pow(2);
    let narrow = |v: &[f64; 3]| Vec3::from_array(v.map(|x| x as f32));
    Gaussians {
        means: twin.means.iter().map(narrow).collect(),
        scales_log: twin.scale_log.iter().map(narrow).collect(),
        rotations_wxyz: twin
            .rotation_wxyz
            .iter()
            .map(|q| q.map(|x| x as f32))
            .collect(),
        opacity_logits: twin.opacity_logit.iter().map(|x| *x as f32).collect(),
        sh: twin
            .sh
            .iter()
            .flat_map(|sh| sh[..n_sh].as_flattened().iter().map(|x| *x as f32))
            .collect(),
        sh_degree,
    }
}

/// Converts a twin's camera to the program's.
pub fn camera_of(twin: &TwinCamera) -> Camera {
    let w = twin.rotation();
    Camera {
        name: "twin".into(),
        width: twin.width as u32,
        height: twin.height as u32,
        fx: twin.fx,
        fy: twin.fy,
        cx: twin.cx,
        cy: twin.cy,
        rotation: DMat3::from_cols_array_2d(&w).transpose(),
        translation: DVec3::new(twin.w2c[0][3], twin.w2c[1][3], twin.w2c[2][3]),
    }
}

/// Converts a camera to a twin's, with a black background and no dropout.
pub fn twin_of(camera: &Camera, near: f64) -> TwinCamera {
    let row = |i: usize| {
        let [x, y, z] = camera.rotation.row(i).to_array();
        [x, y, z, camera.translation[i]]
    };
    TwinCamera {
        w2c: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        width: camera.width as usize,
        height: camera.height as usize,
        fx: camera.fx,
        fy: camera.fy,
        cx: camera.cx,
        cy: camera.cy,
        near,
        background: [0.0; 3],
        dropout: None,
    }
}

/// Returns the view that a twin's camera sees, with its dropout but without a guide.
pub fn view_of(twin: &TwinCamera) -> ViewUniform {
    let view = ViewUniform::new(&camera_of(twin), twin.near, twin.background);
    match twin.dropout {
        Some(TwinDropout { threshold, key, .. }) => {
            view.with_dropout(f64::from(threshold) / 2f64.powi(32), key)
        }
        None => view,
    }
}

/// Converts values to f64.
pub fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}
