//! This module fits poses of test views to their photographs while the Gaussians are held
//! (InstantSplat, Fan et al. 2024; earlier iNeRF, Yen-Chen et al. 2021).

use crate::camera::{Camera, Frame};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::gaussians::Gaussians;
use crate::gpu::{Commands, Gpu};
use crate::render::{
    Bound, Capacity, Device, Kernels, LossUniform, Model, Pass, PassStep, PoseGradient,
    PoseKernels, ViewUniform, Workspace, first_pairs, read_totals, until_it_fits,
};
use crate::scene::View;
use crate::terminal::progress::Progress;
use crate::train::{PoseAdam, TrainingView};

/// Steps a view.
const N_STEPS: u32 = 100;

/// Step size of turns (radians) and of shifts (canonical units) at the start, and the share of it
/// that is left at the end of an exponential decay: a pose can travel 2.5 degrees and 4 % of the
/// sphere's radius, and settles to a hundredth of a pixel.
const RATE: f64 = 2e-3;
const RATE_LEFT: f64 = 0.01;

/// Returns the cameras of `views`, in the world frame, each at the pose with the smallest training
/// loss over Adam's way from where it is; Gaussians are of the canonical `frame`.
///
/// # Errors
/// A view that the adapter cannot hold, or a GPU fault.
pub fn fit_poses(
    Device { gpu, kernels }: Device<'_>,
    gaussians: &Gaussians,
    frame: &Frame,
    views: &[View],
    config: &Config,
) -> Result<Vec<Camera>> {
    let mut fit = Fit {
        gpu,
        kernels,
        pose_kernels: PoseKernels::default(),
        model: Model::upload(gpu, gaussians, gaussians.len())?,
        config,
        near: frame.near(config.model.near),
        room: None,
        goal: Vec::new(),
    };
    let mut progress = Progress::stage("pose fit", views.len() as u32);
    let mut cameras = Vec::with_capacity(views.len());
    for view in views {
        let camera = frame.camera_to_canonical(&view.camera);
        let view = TrainingView::of(camera, view);
        let fitted = fit.fit(&view).map_err(|e| e.at(&view.camera.name))?;
        cameras.push(frame.camera_to_world(&fitted));
        progress.advance(cameras.len() as u32);
    }
    progress.finish();
    Ok(cameras)
}

struct Fit<'a> {
    gpu: &'a Gpu,
    kernels: &'a Kernels,
    pose_kernels: PoseKernels,
    model: Model,
    config: &'a Config,
    /// Canonical.
    near: f64,
    room: Option<Room>,
    /// The target image of the view that is being fitted, unpacked.
    goal: Vec<u32>,
}

/// Buffers, and their bind groups.
struct Room {
    workspace: Workspace,
    bound: Bound,
    pose: PoseGradient,
}

impl Fit<'_> {
    fn fit(&mut self, view: &TrainingView) -> Result<Camera> {
        let mut adam = PoseAdam::default();
        view.goal.unpack(&mut self.goal);
        let mut camera = view.camera.clone();
        let mut best = (f64::INFINITY, camera.clone());
        for step in 0..=N_STEPS {
            let (loss, gradient) = self.gradient(view, &camera)?;
            if loss < best.0 {
                best = (loss, camera.clone());
            }
            let rate = RATE * RATE_LEFT.powf(f64::from(step) / f64::from(N_STEPS));
            camera = adam.step(&camera, gradient, [rate; 2]);
        }
        Ok(best.1)
    }

    /// Returns the view's loss from `camera`, and its gradient with respect to the pose.
    fn gradient(&mut self, view: &TrainingView, camera: &Camera) -> Result<(f64, [f64; 6])> {
        let (gpu, model) = (self.gpu, &self.config.model);
        let uniform = ViewUniform::new(camera, self.near, model.background);
        let w = self.config.loss.ssim_weight;
        let loss = LossUniform::new(view.weight, w, view.total_weight, view.masked);
        let n_pairs = first_pairs(gpu, self.model.n);
        let needed = Capacity::new(
            self.kernels.rasterizer,
            self.model.stride,
            n_pairs,
            &[uniform],
        );
        until_it_fits(gpu, needed, |needed| {
            let room = self.room(needed)?;
            room.workspace.set_goal(gpu, 0, &uniform, &self.goal);
            let pass = Pass::new(
                gpu,
                self.kernels,
                &room.workspace,
                &room.bound,
                &self.model,
                uniform,
                PassStep {
                    slot: 0,
                    sh_degree: self.model.sh_degree,
                    number: 1,
                },
            );
            let mut commands = Commands::new(gpu);
            commands.clear(room.workspace.buffer("totals"));
            pass.forward(&mut commands);
            pass.loss(&mut commands, loss);
            pass.backward(&mut commands);
            pass.pose_backward(&mut commands, &self.pose_kernels, &room.pose);
            commands.submit();
            let totals = read_totals(gpu, &room.workspace);
            self.room = Some(room);
            totals
        })?;
        let Some(room) = &self.room else {
            return Err(Error::new("nothing was rendered"));
        };
        let losses = room.workspace.read_losses(gpu)?;
        let [l1, ssim] = losses.first().copied().unwrap_or_default();
        Ok(((1.0 - w) * l1 + w * (1.0 - ssim), room.pose.read(gpu)?))
    }

    /// Returns the buffers there are, or larger ones.
    fn room(&mut self, needed: Capacity) -> Result<Room> {
        let held = match self.room.take() {
            Some(room) if room.workspace.capacity.holds(&needed) => return Ok(room),
            room => room.map(|room| room.workspace),
        };
        let workspace = Workspace::reserved(self.gpu, held, needed, true)?;
        Ok(Room {
            bound: Bound::new(self.gpu, self.kernels, &workspace, &self.model),
            pose: PoseGradient::new(self.gpu, &self.pose_kernels, &workspace, &self.model)?,
            workspace,
        })
    }
}
