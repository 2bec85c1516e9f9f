//! One adapter and one set of kernels for all tests, and a single view on them with every output
//! poisoned before it is computed.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use bytemuck::Pod;
use glam::{DMat3, DVec3, Vec3};
use gspotential::camera::Camera;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::{Buffer, Commands, Gpu};
use gspotential::render::{
    Bound, Capacity, Kernels, LossUniform, Model, Pass, Rendered, ViewUniform, Workspace,
    read_totals,
};
use gspotential::train::optimizer::OptimizerKernels;

use crate::twins::compare::relative_l2;
use crate::twins::dropout::TwinDropout;
use crate::twins::model::{TwinCamera, TwinGaussians};

/// The adapter, for one test at a time: memory stays bounded and a fault belongs to its test.
pub struct Context {
    pub gpu: Gpu,
    pub kernels: Kernels,
    pub optimizer: OptimizerKernels,
}

/// Waits for the adapter. No adapter is a failure, never a skip.
pub fn context() -> MutexGuard<'static, Context> {
    static CONTEXT: OnceLock<Mutex<Context>> = OnceLock::new();
    CONTEXT
        .get_or_init(|| {
            let gpu = Gpu::open().unwrap_or_else(|e| panic!("{e}"));
            Mutex::new(Context {
                kernels: Kernels::new(&gpu),
                optimizer: OptimizerKernels::new(&gpu),
                gpu,
            })
        })
        .lock()
        // What another test has failed with is its own.
        .unwrap_or_else(PoisonError::into_inner)
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
    pub fn new(ctx: &Context, gaussians: &Gaussians, view: ViewUniform, sh_degree: u32) -> Rig {
        let gpu = &ctx.gpu;
        let model = Model::upload(gpu, gaussians, gaussians.len()).expect("the model fits");
        let capacity = Capacity::new(model.stride, 4 * gaussians.len().max(64), &[view]);
        let workspace = Workspace::new(gpu, capacity, true).expect("the workspace fits");
        let bound = Bound::new(gpu, &ctx.kernels, &workspace, &model);
        Rig {
            model,
            workspace,
            bound,
            view,
            sh_degree,
        }
    }

    fn pass<'a>(&'a self, ctx: &'a Context) -> Pass<'a> {
        Pass::new(
            &ctx.gpu,
            &ctx.kernels,
            &self.workspace,
            &self.bound,
            &self.model,
            (0, self.view),
            (self.sh_degree, 1),
        )
    }

    /// The buffer of this name in the shaders.
    pub fn buffer(&self, name: &str) -> &Buffer {
        let names = self.workspace.names(&self.model, 0);
        let found = names.into_iter().find(|(n, _)| *n == name);
        found.unwrap_or_else(|| panic!("no buffer `{name}`")).1
    }

    pub fn read<T: Pod>(&self, ctx: &Context, name: &str, len: usize) -> Vec<T> {
        let values = self.buffer(name).read(&ctx.gpu, len);
        values.unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Fills every buffer that the stages write.
    pub fn poison(&self, ctx: &Context) {
        for (name, buffer) in self.workspace.names(&self.model, 0) {
            if !INPUTS.contains(&name) {
                buffer.write(&ctx.gpu, &vec![POISON; buffer.bytes() as usize / 4]);
            }
        }
    }

    /// Poisons, renders, and makes room where the pairs do not fit.
    pub fn forward(&mut self, ctx: &Context) -> Rendered {
        loop {
            self.poison(ctx);
            let pass = self.pass(ctx);
            let mut commands = Commands::new(&ctx.gpu);
            commands.clear(&self.workspace.totals);
            pass.forward(&mut commands);
            commands.submit();
            let totals = read_totals(&ctx.gpu, &self.workspace).expect("counts are readable");
            if totals.overflow_step == 0 {
                return self.read_rendered(ctx);
            }
            let capacity = Capacity {
                pairs: totals.max,
                ..self.workspace.capacity
            };
            self.workspace = Workspace::new(&ctx.gpu, capacity, true).expect("the pairs fit");
            self.bound = Bound::new(&ctx.gpu, &ctx.kernels, &self.workspace, &self.model);
        }
    }

    fn read_rendered(&self, ctx: &Context) -> Rendered {
        let [r, g, b, t] = self.read_planes(ctx, "rendered");
        Rendered {
            width: self.view.size[0],
            height: self.view.size[1],
            rgb: (0..r.len()).flat_map(|i| [r[i], g[i], b[i]]).collect(),
            alpha: t.iter().map(|t| 1.0 - t).collect(),
        }
    }

    /// The first four planes of an image buffer without its padding.
    pub fn read_planes(&self, ctx: &Context, name: &str) -> [Vec<f32>; 4] {
        let plane = 4 * self.view.plane_len();
        let values: Vec<f32> = self.read(ctx, name, 4 * plane);
        std::array::from_fn(|p| {
            self.pixels()
                .map(|i| values[p * plane + i])
                .collect::<Vec<f32>>()
        })
    }

    /// Where the image's pixels lie in a padded plane.
    fn pixels(&self) -> impl Iterator<Item = usize> {
        let row_len = 4 * self.view.padded_size().0;
        let (width, height) = (self.view.size[0] as usize, self.view.size[1] as usize);
        (0..height).flat_map(move |y| y * row_len..y * row_len + width)
    }

    /// Writes an image of four planes; its padding holds `padding`.
    pub fn write_planes(&self, ctx: &Context, name: &str, planes: [&[f64]; 4], padding: f32) {
        let len = 4 * self.view.plane_len();
        let mut values = vec![padding; 4 * len];
        for (p, plane) in planes.iter().enumerate() {
            for (i, value) in self.pixels().zip(*plane) {
                values[p * len + i] = *value as f32;
            }
        }
        self.buffer(name).write(&ctx.gpu, &values);
    }

    /// Gradient of `sum(d_rgb * rgb) + sum(d_alpha * alpha)` after [`Rig::forward`].
    pub fn backward(&self, ctx: &Context, d_rgb: &[f64], d_alpha: &[f64]) -> ViewGradients {
        let channel = |c: usize| -> Vec<f64> { d_rgb.iter().skip(c).step_by(3).copied().collect() };
        let planes = [channel(0), channel(1), channel(2)];
        let planes = [&planes[0], &planes[1], &planes[2], d_alpha];
        self.write_planes(ctx, "d_rendered", planes, 0.0);
        let mut commands = Commands::new(&ctx.gpu);
        self.pass(ctx).backward(&mut commands);
        commands.submit();
        self.gradients(ctx)
    }

    /// What the last backward has left.
    pub fn gradients(&self, ctx: &Context) -> ViewGradients {
        let (n, stride) = (self.model.n, self.model.stride);
        let planes: Vec<[f32; 4]> = self.read(ctx, "d_geometry", 3 * stride);
        let color: Vec<[f32; 4]> = self.read(ctx, "d_color", n);
        let part = |plane: usize, first: usize, len: usize| -> Vec<f64> {
            planes[plane * stride..][..n]
                .iter()
                .flat_map(|v| v[first..first + len].iter().map(|x| f64::from(*x)))
                .collect()
        };
        ViewGradients {
            means: part(0, 0, 3),
            opacity_logit: part(0, 3, 1),
            scale_log: part(1, 0, 3),
            rotation_wxyz: part(2, 0, 4),
            color: color
                .iter()
                .map(|c| [c[0], c[1], c[2]].map(f64::from))
                .collect(),
        }
    }

    /// The image loss of what `rendered` holds against `goal`; returns (L1, SSIM).
    pub fn loss(&self, ctx: &Context, loss: LossUniform, goal: &[u32]) -> [f64; 2] {
        self.workspace.set_goal(&ctx.gpu, 0, goal);
        let mut commands = Commands::new(&ctx.gpu);
        self.pass(ctx).loss(&mut commands, loss);
        commands.submit();
        self.workspace
            .read_losses(&ctx.gpu)
            .expect("losses are readable")[0]
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

pub fn view_of(twin: &TwinCamera) -> ViewUniform {
    let view = ViewUniform::new(&camera_of(twin), twin.near, twin.background);
    match twin.dropout {
        Some(TwinDropout { threshold, key }) => {
            view.with_dropout(f64::from(threshold) / 2f64.powi(32), key)
        }
        None => view,
    }
}

pub fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

/// Fails where `ours` is not the twin's within `tolerance` (relative L2), and where the comparison
/// would also have passed with one element altered. Returns the error.
pub fn assert_held(what: &str, ours: &[f64], twin: &[f64], tolerance: f64) -> f64 {
    let error = relative_l2(ours, twin);
    assert!(
        error <= tolerance,
        "{what}: relative L2 {error:e} > {tolerance:e}"
    );
    let mut altered = ours.to_vec();
    let largest = (0..twin.len()).max_by(|&a, &b| twin[a].abs().total_cmp(&twin[b].abs()));
    if let Some(i) = largest {
        altered[i] = if twin[i] == 0.0 { 1.0 } else { -altered[i] };
        let blind = relative_l2(&altered, twin) <= tolerance;
        assert!(!blind, "{what}: an altered element passes");
        altered[i] = f64::NAN;
        let blind = relative_l2(&altered, twin) <= tolerance;
        assert!(!blind, "{what}: a NaN passes");
    }
    error
}
