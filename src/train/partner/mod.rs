//! The partner is a second set of Gaussians that is trained beside the first (Zhang et al. 2024,
//! "CoR-GS").
//!
//! Both start from one cloud and learn from one photograph an iteration. They come to differ by their own
//! draws: of the places of split Gaussians and of dropout. They are seldom right in what they disagree about, so that
//!
//! - each is drawn to the other: an iteration has one pseudo view, from an [`ellipse`], in which each
//!   set's target image is the render of the other, held constant ([`exchange`]);
//! - each loses the Gaussians that are far from all of the other's ([`apart`]).
//!
//! The first set is the one that is exported.

pub mod apart;
pub mod ellipse;
pub mod exchange;

use self::ellipse::Ellipse;
use self::exchange::{Exchange, ExchangeKernels};
use super::optimizer::{Optimizer, OptimizerKernels};
use super::schedule;
use super::supervision::Supervision;
use crate::camera::Camera;
use crate::config::Config;
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::Gpu;
use crate::render::{Bound, Kernels, Model, Workspace};

/// The slot of a step in which the pseudo view is rendered.
pub const PSEUDO_SLOT: usize = 1;

/// The second set with what it is trained by.
pub(super) struct Partner {
    pub(super) optimizer: Optimizer,
    pub(super) workspace: Workspace,
    pub(super) bound: Bound,
    pub(super) adam: Vec<Vec<wgpu::BindGroup>>,
    pub(super) kernels: ExchangeKernels,
    /// `None` while buffers are made anew.
    pub(super) exchange: Option<Exchange>,
    /// Pseudo cameras stand on it.
    pub(super) ellipse: Ellipse,
}

impl Partner {
    /// Uploads `start` and allocates as much as the first set has.
    ///
    /// # Errors
    /// A request that the adapter cannot hold.
    pub(super) fn new(
        gpu: &Gpu,
        (kernels, optimizer_kernels): (&Kernels, &OptimizerKernels),
        (own_workspace, start): (&Workspace, &Gaussians),
        supervision: &Supervision,
    ) -> Result<Partner> {
        let cameras: Vec<Camera> = supervision.real.iter().map(|v| v.camera.clone()).collect();
        let ellipse = Ellipse::through(&cameras)?;
        let optimizer = Optimizer::new(gpu, Model::upload(gpu, start, start.len())?)?;
        let workspace = Workspace::new(gpu, own_workspace.capacity, true)?;
        let exchange_kernels = ExchangeKernels::default();
        let exchange = Exchange::new(gpu, &exchange_kernels, [own_workspace, &workspace]);
        Ok(Partner {
            bound: Bound::new(gpu, kernels, &workspace, &optimizer.model),
            adam: optimizer.bind(gpu, optimizer_kernels, &workspace),
            optimizer,
            workspace,
            kernels: exchange_kernels,
            exchange: Some(exchange),
            ellipse,
        })
    }
}

/// Says whether iteration `iteration` (from 0) has a pseudo view.
pub fn shows_pseudo_view(config: &Config, iteration: u32) -> bool {
    config.partner.enabled && iteration >= config.partner.start
}

/// Says whether Gaussians that stand apart go after `done` iterations.
pub fn prunes(config: &Config, done: u32) -> bool {
    let partner = &config.partner;
    partner.enabled && done > partner.start && schedule::due(config, done, partner.prune_interval)
}

/// Says whether a run with this config prunes so at all.
pub fn ever_prunes(config: &Config) -> bool {
    let interval = config.partner.prune_interval;
    let first = (config.partner.start / interval).saturating_add(1);
    prunes(config, first.saturating_mul(interval))
}
