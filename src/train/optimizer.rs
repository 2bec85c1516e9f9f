//! This module runs Adam on the GPU, and changes the set of Gaussians between steps.

use bytemuck::{Pod, Zeroable};

use super::policy::{Gathered, Plan};
use super::schedule;
use crate::config::Config;
use crate::error::Result;
use crate::gpu::shader::{self, Sources};
use crate::gpu::{Buffer, BufferKind, Commands, Gpu, Kernel, Stage, by_degree, shader_count};
use crate::render::{BLOCK_PLANES, Model, Workspace, most_gaussians, n_blocks, parts};

/// The kernels of this stage.
pub struct OptimizerKernels {
    /// By active SH degree, one a parameter block that has parameters of it.
    adam: [Vec<Kernel>; 4],
    rearrange: Kernel,
    reset_opacity: Kernel,
}

impl Default for OptimizerKernels {
    /// Takes the program's own shaders.
    fn default() -> OptimizerKernels {
        Self::from_sources(&shader::compose)
    }
}

impl OptimizerKernels {
    /// Takes other sources than the program's.
    pub fn from_sources(sources: Sources<'_>) -> OptimizerKernels {
        let stage = |name: &str, degree: u32| Stage::new(name, sources(name, degree));
        let kernel = |name: &str, entry| stage(name, 0).kernel(entry);
        let adam = |degree: u32| {
            let stage = stage("adam", degree);
            let entries = ["adam_geometry", "adam_sh_0", "adam_sh_2", "adam_sh_3"];
            let entries = entries.into_iter().take(n_blocks(degree));
            entries.map(|entry| stage.kernel(entry)).collect()
        };
        OptimizerKernels {
            adam: by_degree(adam),
            rearrange: kernel("rearrange", "rearrange_planes"),
            reset_opacity: kernel("reset_opacity", "reset_opacity"),
        }
    }
}

/// One Adam step; `Step` in `adam.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct StepUniform {
    /// The real and the virtual view; without a virtual view the second weighs 0.
    pub views: [StepView; 2],
    /// Learning rates of the planes of geometry: mean and opacity, log scale, rotation.
    pub geometry_rates: [[f32; 4]; 3],
    /// Learning rate of SH degree 0.
    pub sh_0_rate: f32,
    /// Learning rate of all higher SH degrees, a twentieth of `sh_0_rate` (3DGS).
    pub sh_rate: f32,
    /// Weight of the mean least scale of the Gaussians, those that are not drawn counted as 0; [`Optimizer::step`] divides
    /// it by their number.
    pub flat_weight: f32,
    /// Padding.
    pub pad_0: f32,
    /// Decay of the first moment.
    pub beta_1: f32,
    /// Decay of the second moment.
    pub beta_2: f32,
    /// `1 - beta_1`, taken in f64.
    pub new_share_1: f32,
    /// `1 - beta_2`, taken in f64.
    pub new_share_2: f32,
    /// `1 / (1 - beta_1^t)` at step `t`, from 1.
    pub correction_1: f32,
    /// `1 / sqrt(1 - beta_2^t)` at step `t`, from 1.
    pub correction_2: f32,
    /// Added to the root of the second moment.
    pub epsilon: f32,
    /// 1 where positions have rates of their own, else 0; [`Optimizer::step`] sets it.
    pub own_rates: u32,
    /// Distance from the focus beyond which geometry is held; infinite if nothing is.
    pub frozen_beyond: f32,
    /// Padding.
    pub pad_1: [f32; 3],
    /// Gaussians that are trained.
    pub n_gaussians: u32,
    /// Entries a plane of the buffers, not below `n_gaussians`.
    pub stride: u32,
    /// Padding.
    pub pad_2: [u32; 2],
}

/// One view of a step; `StepView` in `adam.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct StepView {
    /// Optical centre, canonical frame, rounded to f32.
    pub center: [f32; 3],
    /// 1 if the view takes part in the step, else 0.
    pub weight: f32,
    /// What rounding took off the optical centre.
    pub center_low: [f32; 3],
    /// Padding.
    pub pad: f32,
}

impl StepUniform {
    /// Returns the step after `iteration` steps. `centers` are the optical centres of its views.
    pub fn new(config: &Config, iteration: u32, extent: f64, centers: &[[f64; 3]]) -> StepUniform {
        let o = &config.optimizer;
        let mean = schedule::mean_rate(o, iteration, config.iterations, extent) as f32;
        let (scale, rotation) = (o.scale_lr as f32, o.rotation_lr as f32);
        let t = f64::from(iteration) + 1.0;
        let view = |center: Option<&[f64; 3]>| {
            let (high, low) = parts(center.copied().unwrap_or_default());
            StepView {
                center: high,
                weight: if center.is_some() { 1.0 } else { 0.0 },
                center_low: low,
                pad: 0.0,
            }
        };
        StepUniform {
            views: [view(centers.first()), view(centers.get(1))],
            geometry_rates: [
                [mean, mean, mean, o.opacity_lr as f32],
                [scale, scale, scale, 0.0],
                [rotation; 4],
            ],
            sh_0_rate: o.sh_lr as f32,
            sh_rate: (o.sh_lr / 20.0) as f32,
            flat_weight: config.loss.flat_weight as f32,
            pad_0: 0.0,
            beta_1: o.beta1 as f32,
            beta_2: o.beta2 as f32,
            new_share_1: (1.0 - o.beta1) as f32,
            new_share_2: (1.0 - o.beta2) as f32,
            correction_1: (1.0 / (1.0 - o.beta1.powf(t))) as f32,
            correction_2: (1.0 / (1.0 - o.beta2.powf(t)).sqrt()) as f32,
            epsilon: o.epsilon as f32,
            own_rates: 0,
            frozen_beyond: f32::INFINITY,
            pad_1: [0.0; 3],
            n_gaussians: 0,
            stride: 0,
            pad_2: [0; 2],
        }
    }

    /// Returns the same step with all rates multiplied by `rate`.
    pub fn slowed(mut self, rate: f64) -> StepUniform {
        let rate = rate as f32;
        for plane in &mut self.geometry_rates {
            *plane = plane.map(|own| own * rate);
        }
        self.sh_0_rate *= rate;
        self.sh_rate *= rate;
        self
    }

    /// Returns the same step for Gaussians up to this distance from the focus; those beyond learn
    /// colour alone.
    pub fn within(mut self, frozen_beyond: f32) -> StepUniform {
        self.frozen_beyond = frozen_beyond;
        self
    }
}

/// `Rearrange` in `rearrange.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RearrangeUniform {
    /// Gaussians of the new set.
    pub n: u32,
    /// Entries a plane of the old buffer.
    pub old_stride: u32,
    /// Entries a plane of the new buffer.
    pub new_stride: u32,
    /// Planes of the block, 1 to 5.
    pub n_planes: u32,
    /// 0 for geometry, 2 for Adam moments, 3 for statistics of which the rate alone stays, 1 for what is copied as it is.
    pub kind: u32,
    /// Padding.
    pub pad: [u32; 3],
}

/// An opacity reset; `Reset` in `reset_opacity.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ResetUniform {
    /// Largest logit that stays.
    pub ceiling: f32,
    /// Distance from the focus beyond which all stay.
    pub frozen_beyond: f32,
    /// Gaussians of the model.
    pub n_gaussians: u32,
    /// Padding.
    pub pad: u32,
}

const KIND_GEOMETRY: u32 = 0;
/// Copied as it is: SH, and the statistics.
const KIND_PLAIN: u32 = 1;
const KIND_MOMENTS: u32 = 2;
/// Statistics that start anew but for the position's rate.
const KIND_RATES: u32 = 3;

/// A `vec4f` a Gaussian: sum of screen gradients, number of views, largest radius, gain of the position's rate.
const STATISTICS: BufferKind = BufferKind::storage::<[f32; 4]>("statistics");
const STEP: BufferKind = BufferKind::uniform::<StepUniform>("step");
/// A plan, an entry a Gaussian of the new set.
const SOURCES: BufferKind = BufferKind::storage::<u32>("sources");
const CHANGES: BufferKind = BufferKind::storage::<[f32; 4]>("changes");

/// Returns the bytes of an [`Optimizer`] beyond its three models.
pub(super) fn statistics_bytes(stride: usize) -> u64 {
    STATISTICS.bytes(stride) + STEP.bytes(1)
}

/// Returns the bytes that [`Optimizer::rearrange`] takes beside the new set of one model.
pub(super) fn plan_bytes(n: usize) -> u64 {
    SOURCES.bytes(n) + CHANGES.bytes(n)
}

/// Returns the entries a plane for `n` Gaussians and some that will come, so that buffers need not
/// follow every plan.
pub(super) fn with_room(n: usize, most: usize) -> usize {
    (n + n / 4).min(most).max(n)
}

/// The parameters in training, with what Adam and the densification remember of them.
pub struct Optimizer {
    /// The parameters.
    pub model: Model,
    /// Adam's running mean of the gradient, laid out as the parameters are.
    pub first_moment: Model,
    /// Adam's running mean of the squared gradient, laid out as the parameters are.
    pub second_moment: Model,
    /// `vec4f` a Gaussian: sum of screen gradients, number of views, largest radius, and what is added to
    /// 1 for the factor of its position's rate.
    statistics: Buffer,
    /// Whether that factor counts.
    own_rates: bool,
    step: Buffer,
}

impl Optimizer {
    /// Starts from `model`.
    ///
    /// # Errors
    /// More Gaussians than the adapter can hold.
    pub fn new(gpu: &Gpu, model: Model) -> Result<Optimizer> {
        let zeros = || Model::zeros(gpu, model.n, model.stride, model.sh_degree);
        Ok(Optimizer {
            first_moment: zeros()?,
            second_moment: zeros()?,
            statistics: STATISTICS.allocate(gpu, model.stride)?,
            own_rates: false,
            step: STEP.allocate(gpu, 1)?,
            model,
        })
    }

    /// Gives the positions rates of their own: Gaussian `i`'s is multiplied by `1 + gains[i]`. Without
    /// gains all have the same.
    pub fn set_position_gains(&mut self, gpu: &Gpu, gains: &[f32]) {
        self.own_rates = !gains.is_empty();
        if self.own_rates {
            let statistics: Vec<[f32; 4]> = gains.iter().map(|g| [0.0, 0.0, 0.0, *g]).collect();
            self.statistics.write(gpu, &statistics);
        }
    }

    /// Returns everything that a step changes: the blocks of the parameters, of the first and of
    /// the second moment, and the statistics.
    pub fn buffers(&self) -> Vec<&Buffer> {
        let models = [&self.model, &self.first_moment, &self.second_moment];
        let blocks = models
            .into_iter()
            .flat_map(|m| &m.blocks[..n_blocks(m.sh_degree)]);
        blocks.chain([&self.statistics]).collect()
    }

    /// Makes the bind groups of the Adam dispatches for the gradients in `workspace`, by active SH
    /// degree and parameter block.
    pub fn bind(
        &self,
        gpu: &Gpu,
        kernels: &OptimizerKernels,
        workspace: &Workspace,
    ) -> Vec<Vec<wgpu::BindGroup>> {
        let group = |degree: u32, block: usize| {
            let source = match block {
                0 => workspace.buffer("d_geometry"),
                _ => &self.model.blocks[0],
            };
            kernels.adam[degree as usize][block].bind(
                gpu,
                &[
                    (STEP.name(), &self.step),
                    ("parameters", &self.model.blocks[block]),
                    ("first_moment", &self.first_moment.blocks[block]),
                    ("second_moment", &self.second_moment.blocks[block]),
                    ("source", source),
                    ("d_color", workspace.buffer("d_color")),
                    ("totals", workspace.buffer("totals")),
                    ("screen", workspace.buffer("screen")),
                    (STATISTICS.name(), &self.statistics),
                ],
            )
        };
        (0..=self.model.sh_degree)
            .map(|degree| {
                (0..n_blocks(degree))
                    .map(|block| group(degree, block))
                    .collect()
            })
            .collect()
    }

    /// Records one step over `groups` from [`Optimizer::bind`]. SH first: its gradients need the
    /// means that the views were rendered with. Blocks of degrees that are not active yet have
    /// neither gradient nor moments and are left out.
    pub fn step(
        &self,
        gpu: &Gpu,
        kernels: &OptimizerKernels,
        groups: &[Vec<wgpu::BindGroup>],
        commands: &mut Commands<'_>,
        mut step: StepUniform,
        sh_degree: u32,
    ) {
        step.n_gaussians = shader_count(self.model.n);
        step.stride = shader_count(self.model.stride);
        step.own_rates = u32::from(self.own_rates);
        step.flat_weight /= self.model.n.max(1) as f32;
        self.step.write(gpu, &[step]);
        let n = self.model.n as u64;
        let degree = sh_degree as usize;
        for (kernel, group) in kernels.adam[degree].iter().zip(&groups[degree]).rev() {
            commands.dispatch(kernel, group, n);
        }
    }

    /// Caps every opacity at `opacity` (3DGS's reset), but for Gaussians beyond `frozen_beyond`.
    pub fn reset_opacity(
        &self,
        gpu: &Gpu,
        kernels: &OptimizerKernels,
        opacity: f64,
        frozen_beyond: f32,
    ) {
        let logit = (opacity / (1.0 - opacity)).ln() as f32;
        let reset = ResetUniform {
            ceiling: logit,
            frozen_beyond,
            n_gaussians: shader_count(self.model.n),
            pad: 0,
        };
        let reset = Buffer::uniform_from(gpu, "reset", &reset);
        let group = kernels.reset_opacity.bind(
            gpu,
            &[
                ("reset", &reset),
                ("geometry", &self.model.blocks[0]),
                ("first_moment", &self.first_moment.blocks[0]),
                ("second_moment", &self.second_moment.blocks[0]),
            ],
        );
        let mut commands = Commands::new(gpu);
        commands.dispatch(&kernels.reset_opacity, &group, self.model.n as u64);
        commands.submit();
    }

    /// Reads back what the policy looks at.
    pub fn gather(&self, gpu: &Gpu) -> Result<Gathered> {
        let (n, stride) = (self.model.n, self.model.stride);
        let geometry: Vec<[f32; 4]> = self.model.blocks[0].read(gpu, 3 * stride)?;
        let statistics: Vec<[f32; 4]> = self.statistics.read(gpu, n)?;
        let xyz = |v: &[f32; 4]| glam::Vec3::new(v[0], v[1], v[2]);
        Ok(Gathered {
            means: geometry[..n].iter().map(xyz).collect(),
            opacity_logits: geometry[..n].iter().map(|v| v[3]).collect(),
            scales_log: geometry[stride..][..n].iter().map(xyz).collect(),
            rotations_wxyz: geometry[2 * stride..][..n].to_vec(),
            statistics: statistics.iter().map(|v| [v[0], v[1], v[2]]).collect(),
        })
    }

    /// Carries out a plan. Statistics start anew where it is one of densification, which they are
    /// gathered for, and follow their Gaussians where it is not; rates of positions follow in both, to
    /// new Gaussians, too. Bind groups of the old set keep
    /// its memory: drop them first.
    ///
    /// # Errors
    /// More Gaussians than the adapter can hold, or a GPU fault.
    pub fn rearrange(
        &mut self,
        gpu: &Gpu,
        kernels: &OptimizerKernels,
        plan: &Plan,
        densifies: bool,
    ) -> Result<()> {
        let n = plan.sources.len();
        let degree = self.model.sh_degree;
        let stride = if n > self.model.stride {
            with_room(n, most_gaussians(gpu, degree))
        } else {
            self.model.stride
        };
        let sources = SOURCES.allocate(gpu, n)?;
        sources.write(gpu, &plan.sources);
        let changes = CHANGES.allocate(gpu, n)?;
        changes.write(gpu, &plan.changes);
        let follow =
            |commands: &mut Commands<'_>, old: &Buffer, new: &Buffer, layout: RearrangeUniform| {
                let uniform = Buffer::uniform_from(gpu, "rearrange", &layout);
                let group = kernels.rearrange.bind(
                    gpu,
                    &[
                        ("rearrange", &uniform),
                        ("old_planes", old),
                        ("new_planes", new),
                        (SOURCES.name(), &sources),
                        (CHANGES.name(), &changes),
                    ],
                );
                commands.dispatch(&kernels.rearrange, &group, n as u64);
            };
        let layout = |old_stride: usize, n_planes: usize, kind: u32| RearrangeUniform {
            n: shader_count(n),
            old_stride: shader_count(old_stride),
            new_stride: shader_count(stride),
            n_planes: n_planes as u32,
            kind,
            pad: [0; 3],
        };
        let statistics = STATISTICS.allocate(gpu, stride)?;
        if !densifies || self.own_rates {
            let mut commands = Commands::new(gpu);
            let kind = if densifies { KIND_RATES } else { KIND_PLAIN };
            let layout = layout(self.model.stride, 1, kind);
            follow(&mut commands, &self.statistics, &statistics, layout);
            commands.submit();
            gpu.wait()?;
        }
        self.statistics = statistics;
        for (old, moments) in [
            (&mut self.model, false),
            (&mut self.first_moment, true),
            (&mut self.second_moment, true),
        ] {
            let new = Model::zeros(gpu, n, stride, degree)?;
            let mut commands = Commands::new(gpu);
            for (block, n_planes) in BLOCK_PLANES.iter().enumerate().take(n_blocks(degree)) {
                let kind = match (moments, block) {
                    (true, _) => KIND_MOMENTS,
                    (false, 0) => KIND_GEOMETRY,
                    (false, _) => KIND_PLAIN,
                };
                let layout = layout(old.stride, *n_planes, kind);
                let (old, new) = (&old.blocks[block], &new.blocks[block]);
                follow(&mut commands, old, new, layout);
            }
            commands.submit();
            *old = new;
            // The old set's memory is free before the next is made.
            gpu.wait()?;
        }
        Ok(())
    }
}
