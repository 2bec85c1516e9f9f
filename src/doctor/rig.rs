//! One view of one model on the GPU, every stage of it open to inspection, and every output
//! poisoned before it is computed.

use bytemuck::Pod;
use glam::{DMat3, DVec3, Vec3};

use crate::camera::Camera;
use crate::doctor::twin::dropout::TwinDropout;
use crate::doctor::twin::model::{TwinCamera, TwinGaussians};
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::shader::{self, Sources};
use crate::gpu::{Buffer, Commands, Gpu};
use crate::render::{
    Bound, Capacity, Kernels, LossUniform, Model, Pass, PassStep, PoseKernels, Rendered,
    ViewUniform, Workspace, read_rendered, read_totals, until_it_fits,
};
use crate::train::guide::Guide;
use crate::train::optimizer::OptimizerKernels;

/// An adapter with every kernel.
pub struct Context {
    pub gpu: Gpu,
    pub kernels: Kernels,
    pub optimizer: OptimizerKernels,
    pub pose: PoseKernels,
}

impl Context {
    /// Compiles all kernels.
    ///
    /// # Errors
    /// A kernel that the driver refuses.
    pub fn new(gpu: Gpu) -> Result<Context> {
        Self::from_sources(gpu, &shader::compose)
    }

    /// [`Context::new`] with other sources than the program's.
    pub fn from_sources(gpu: Gpu, sources: Sources<'_>) -> Result<Context> {
        let context = Context {
            kernels: Kernels::from_sources(&gpu, sources),
            optimizer: OptimizerKernels::from_sources(&gpu, sources),
            pose: PoseKernels::from_sources(&gpu, sources),
            gpu,
        };
        context.gpu.check()?;
        Ok(context)
    }
}

/// A NaN as f32, far beyond any index as u32.
pub const POISON: u32 = 0x7fc0_dead;

/// What the stages read but do not write, or the host has written for good.
const INPUTS: [&str; 7] = ["view", "loss", "geometry", "sh_0", "sh_2", "sh_3", "goal"];

/// One view of one model, with the buffers for its backward.
pub struct Rig {
    pub model: Model,
    pub workspace: Workspace,
    pub bound: Bound,
    pub view: ViewUniform,
    pub sh_degree: u32,
}

/// Gradients of a view as the GPU leaves them.
pub struct ViewGradients {
    pub means: Vec<f64>,
    pub opacity_logit: Vec<f64>,
    pub scale_log: Vec<f64>,
    pub rotation_wxyz: Vec<f64>,
    /// Colour's, after its clamp at 0.
    pub color: Vec<[f64; 3]>,
}

impl Rig {
    pub fn new(
        ctx: &Context,
        gaussians: &Gaussians,
        view: ViewUniform,
        sh_degree: u32,
    ) -> Result<Rig> {
        let gpu = &ctx.gpu;
        let model = Model::upload(gpu, gaussians, gaussians.len())?;
        let capacity = Capacity::new(model.stride, 4 * gaussians.len().max(64), &[view]);
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

    /// A rig for the reference's Gaussians and camera. Coefficients above the view's degree are
    /// there and must not matter.
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

    /// The view's stages, to be recorded.
    pub fn pass<'a>(&'a self, ctx: &'a Context) -> Pass<'a> {
        Pass::new(
            &ctx.gpu,
            &ctx.kernels,
            &self.workspace,
            &self.bound,
            &self.model,
            self.view,
            PassStep {
                slot: 0,
                sh_degree: self.sh_degree,
                number: 1,
            },
        )
    }

    /// The buffer of this name in the shaders.
    ///
    /// # Panics
    /// If there is none: a fault in this program.
    pub fn buffer(&self, name: &str) -> &Buffer {
        let names = self.workspace.names(&self.model, 0);
        let found = names.into_iter().find(|(n, _)| *n == name);
        found.unwrap_or_else(|| panic!("no buffer `{name}`")).1
    }

    /// The first `len` values of the buffer of this name.
    pub fn read<T: Pod>(&self, ctx: &Context, name: &str, len: usize) -> Result<Vec<T>> {
        self.buffer(name).read(&ctx.gpu, len)
    }

    /// Fills every buffer that the stages write.
    pub fn poison(&self, ctx: &Context) {
        for (name, buffer) in self.workspace.names(&self.model, 0) {
            if !INPUTS.contains(&name) {
                buffer.write(&ctx.gpu, &vec![POISON; buffer.bytes() as usize / 4]);
            }
        }
    }

    /// Poisons, and clears the counts, as the first stage expects it.
    pub fn start(&self, ctx: &Context) {
        self.poison(ctx);
        let mut commands = Commands::new(&ctx.gpu);
        commands.clear(self.workspace.buffer("totals"));
        commands.submit();
    }

    /// Poisons, renders, and makes room where the pairs do not fit.
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

    /// The image as the last rasterization left it.
    pub fn read_rendered(&self, ctx: &Context) -> Result<Rendered> {
        read_rendered(&ctx.gpu, self.workspace.buffer("rendered"), &self.view)
    }

    /// The first three planes of an image buffer as interleaved pixels, without its padding.
    pub fn read_rgb(&self, ctx: &Context, name: &str) -> Result<Vec<f64>> {
        let plane = 4 * self.view.plane_len();
        let values: Vec<f32> = self.read(ctx, name, 3 * plane)?;
        let of_pixel = |i: usize| [0, 1, 2].map(|p| f64::from(values[p * plane + i]));
        Ok(self.pixels().flat_map(of_pixel).collect())
    }

    /// Places of the image's pixels in a padded plane.
    fn pixels(&self) -> impl Iterator<Item = usize> {
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

    /// Gradient of `sum(d_rgb * rgb) + sum(d_alpha * alpha)` after [`Rig::forward`].
    pub fn backward(&self, ctx: &Context, d_rgb: &[f64], d_alpha: &[f64]) -> Result<ViewGradients> {
        self.write_image(ctx, "d_rendered", d_rgb, d_alpha, 0.0);
        let mut commands = Commands::new(&ctx.gpu);
        self.pass(ctx).backward(&mut commands);
        commands.submit();
        self.gradients(ctx)
    }

    /// What the last backward has left.
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

    /// The image loss of what `rendered` holds against `goal`; returns (L1, SSIM).
    pub fn loss(&self, ctx: &Context, loss: LossUniform, goal: &[u32]) -> Result<[f64; 2]> {
        self.workspace.set_goal(&ctx.gpu, 0, &self.view, goal);
        let mut commands = Commands::new(&ctx.gpu);
        self.pass(ctx).loss(&mut commands, loss);
        commands.submit();
        let losses = self.workspace.read_losses(&ctx.gpu)?;
        Ok(losses.first().copied().unwrap_or_default())
    }
}

/// Single precision of a twin's Gaussians, which are exact in it.
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

/// The program's camera of a twin's.
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

/// The twin of a camera.
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

/// The view that a twin's camera sees.
pub fn view_of(twin: &TwinCamera) -> ViewUniform {
    let view = ViewUniform::new(&camera_of(twin), twin.near, twin.background);
    match twin.dropout {
        Some(TwinDropout { threshold, key, .. }) => {
            view.with_dropout(f64::from(threshold) / 2f64.powi(32), key)
        }
        None => view,
    }
}

/// Values as f64.
pub fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}
