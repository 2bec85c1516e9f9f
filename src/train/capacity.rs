//! This module predicts what training's buffers will take, before there are any.

use super::depths::size;
use super::optimizer::{plan_bytes, statistics_bytes, with_room};
use super::partner;
use super::schedule;
use super::supervision::{Supervision, TrainingView};
use crate::camera::Camera;
use crate::config::Config;
use crate::gpu::{Buffer, Gpu, Rasterizer};
use crate::render::{
    Capacity, DepthPass, Lists, PoseGradient, Targets, ViewUniform, WorkspaceBytes, block_bytes,
    first_pairs, model_bytes, most_gaussians,
};

/// Bytes of GPU buffers that training holds at one time, to the byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainingBytes {
    /// Gaussians of the model, those of the far shell among them.
    pub n_gaussians: usize,
    /// Pairs of one view that there is room for.
    pub n_pairs: usize,
    /// The Gaussians' parameters.
    pub model: u64,
    /// Both of Adam's moments.
    pub moments: u64,
    /// What densification gathers, and the uniform of an Adam step.
    pub statistics: u64,
    /// The buffers of forward and backward pass, by kind.
    pub workspace: WorkspaceBytes,
    /// Target images that stay on the GPU.
    pub targets: u64,
    /// Gradients of poses, where they are refined.
    pub poses: u64,
    /// All that a partner has of these for itself, where there is one.
    pub partner: u64,
    /// Depths, normals and their gradients, where training views are held to some.
    pub depths: u64,
    /// Staging buffer of the largest block that the host reads at once.
    pub reading: u64,
    /// What densifying, or pruning without it, holds beside the old set; at most.
    pub densifying: u64,
}

impl TrainingBytes {
    /// Returns what training that starts from `n` Gaussians takes, until it densifies or more pairs
    /// are needed.
    pub fn at_start(
        gpu: &Gpu,
        n: usize,
        supervision: &Supervision,
        config: &Config,
    ) -> TrainingBytes {
        let rasterizer = Rasterizer::of(config.render.rasterizer, gpu);
        let capacity = start_capacity(gpu, rasterizer, n, supervision, config);
        Self::with(capacity, n, (gpu, supervision), config)
    }

    /// Returns the same while it densifies to `config.densify.max_gaussians`; `None` where nothing
    /// grows. Pairs have grown in proportion.
    pub fn at_most(
        gpu: &Gpu,
        n: usize,
        supervision: &Supervision,
        config: &Config,
    ) -> Option<TrainingBytes> {
        if !config.densify.enabled {
            return None;
        }
        let degree = config.model.sh_degree;
        let most = config.densify.max_gaussians.max(n);
        let rasterizer = Rasterizer::of(config.render.rasterizer, gpu);
        let stride = with_room(most, most_gaussians(gpu, degree));
        let capacity = Capacity {
            stride,
            ..start_capacity(gpu, rasterizer, most, supervision, config)
        };
        Some(TrainingBytes {
            n_gaussians: most,
            densifying: model_bytes(stride, degree) + plan_bytes(most),
            ..Self::with(capacity, most, (gpu, supervision), config)
        })
    }

    fn with(
        capacity: Capacity,
        n_gaussians: usize,
        (gpu, supervision): (&Gpu, &Supervision),
        config: &Config,
    ) -> TrainingBytes {
        let sh_degree = config.model.sh_degree;
        let model = model_bytes(capacity.stride, sh_degree);
        let statistics = statistics_bytes(capacity.stride);
        let workspace = WorkspaceBytes::of(capacity);
        TrainingBytes {
            n_gaussians,
            n_pairs: capacity.pairs,
            model,
            moments: 2 * model,
            statistics,
            workspace,
            targets: target_bytes(gpu, supervision, config),
            depths: depth_bytes(&capacity, supervision, config),
            poses: match config.poses.refine {
                true => PoseGradient::bytes(capacity.stride),
                false => 0,
            },
            partner: match config.partner.enabled {
                true => 3 * model + statistics + workspace.total(),
                false => 0,
            },
            reading: Buffer::readback_bytes(read_bytes(&capacity, config)),
            densifying: match prunes(config) {
                true => model + plan_bytes(n_gaussians),
                false => 0,
            },
        }
    }

    /// Returns the bytes of a (tile, Gaussian) pair, but for the sort's counts.
    pub fn bytes_a_pair(&self) -> u64 {
        let WorkspaceBytes {
            pairs,
            pair_gradients,
            ..
        } = self.workspace;
        let n = self.n_pairs.max(1) as u64;
        // The sort's second half is as large as its first, two of the three words of a pair.
        let of_depths = match self.depths {
            0 => 0,
            _ => n * DepthPass::BYTES_A_PAIR,
        };
        (pairs + pairs / 3 * 2 + pair_gradients + of_depths) / n
    }

    /// Returns the bytes that are held between two iterations.
    pub fn held(&self) -> u64 {
        let of_gaussians = self.model + self.moments + self.statistics;
        let of_sets = of_gaussians + self.workspace.total() + self.partner;
        of_sets + self.targets + self.poses + self.depths
    }

    /// Returns the bytes that are held at the worst moment.
    pub fn peak(&self) -> u64 {
        self.held() + self.reading.max(self.densifying)
    }
}

/// Says whether Gaussians are pruned without densification.
fn prunes(config: &Config) -> bool {
    config.need.prunes() || partner::ever_prunes(config) || schedule::ever_prunes_floaters(config)
}

/// Bytes of the largest buffer that the host reads.
fn read_bytes(capacity: &Capacity, config: &Config) -> u64 {
    let block = block_bytes(capacity.stride, config.model.sh_degree);
    let renders = match config.need.hold_out {
        0 => 0,
        _ => rendered_bytes(capacity.plane),
    };
    let lists = match schedule::ever_prunes_floaters(config) {
        true => Lists::bytes(capacity),
        false => 0,
    };
    block.max(renders).max(lists)
}

/// Bytes of a render, four planes of `plane` vectors.
fn rendered_bytes(plane: usize) -> u64 {
    4 * 16 * plane as u64
}

/// Bytes of depths and normals.
fn depth_bytes(capacity: &Capacity, supervision: &Supervision, config: &Config) -> u64 {
    if !config.prior.is_on() {
        return 0;
    }
    let uniform = |view: &TrainingView| uniform(&view.camera, supervision, config);
    let views: Vec<ViewUniform> = supervision.real.iter().map(uniform).collect();
    DepthPass::bytes(capacity.stride, capacity.pairs, &views, size(&config.prior))
}

/// Bytes of the target images that stay on the GPU.
fn target_bytes(gpu: &Gpu, supervision: &Supervision, config: &Config) -> u64 {
    let uniform = |view: &TrainingView| uniform(&view.camera, supervision, config);
    let views: Vec<ViewUniform> = supervision.trained().map(uniform).collect();
    Targets::bytes(&views, Targets::budget(config.render.targets_mib, gpu))
}

/// Returns the room that training starts with.
pub(super) fn start_capacity(
    gpu: &Gpu,
    rasterizer: Rasterizer,
    n: usize,
    supervision: &Supervision,
    config: &Config,
) -> Capacity {
    let uniform = |view: &TrainingView| uniform(&view.camera, supervision, config);
    let views: Vec<ViewUniform> = supervision.views().map(uniform).collect();
    Capacity::new(rasterizer, n, first_pairs(gpu, n), &views)
}

/// Returns a canonical camera as the kernels take it.
pub(super) fn uniform(camera: &Camera, supervision: &Supervision, config: &Config) -> ViewUniform {
    ViewUniform::new(camera, supervision.near, config.model.background)
}
