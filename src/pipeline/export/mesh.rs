//! This module makes a surface mesh of a run.

use crate::camera::{Camera, Frame, Similarity};
use crate::config::ModelConfig;
use crate::error::{Error, Result};
use crate::gaussians::Gaussians;
use crate::gpu::Gpu;
use crate::mesh::{DepthImage, Grid, Mesh, Volume, depth};
use crate::render::{Kernels, Model, Renderer, ViewUniform};
use crate::terminal::progress::Progress;

/// Every so-many-th of the training views' pixels, in x and in y, says where the scene is.
const STEP: usize = 4;

/// What a mesh is made of.
pub(super) struct Seen<'a> {
    /// In the canonical frame.
    pub gaussians: &'a Gaussians,
    /// In the scene's own frame: training views, which say where the scene is, and others.
    pub train: &'a [Camera],
    pub others: &'a [Camera],
    pub frame: Frame,
    pub config: &'a ModelConfig,
}

/// Fuses the depth of all views; returns the mesh in the scene's own frame. It holds what the training
/// views see within the sphere around the focus, in a grid with `voxels` along its longest side.
///
/// # Errors
/// No surface, a grid of too much memory, or a GPU fault.
pub(super) fn surface(seen: &Seen<'_>, voxels: u32) -> Result<Mesh> {
    let gpu = Gpu::open()?;
    log::info!("adapter: {}", gpu.describe());
    let kernels = Kernels::new(&gpu);
    let model = Model::upload(&gpu, seen.gaussians, seen.gaussians.len())?;
    let mut renderer = Renderer::new(&gpu, &kernels);
    let mut look = |camera: &Camera, take: &mut dyn FnMut(DepthImage<'_>)| -> Result<()> {
        let camera = seen.frame.camera_to_canonical(camera);
        let near = seen.frame.near(seen.config.near);
        let view = ViewUniform::new(&camera, near, seen.config.background);
        let (image, medians) = renderer
            .render_medians(&model, &view)
            .map_err(|e| e.at(&camera.name))?;
        take(DepthImage {
            camera: &camera,
            depth: &depth(&camera, seen.gaussians, &medians),
            rgb: &image.rgb,
        });
        Ok(())
    };
    let mut points = Vec::new();
    for camera in seen.train {
        look(camera, &mut |image| points.extend(image.points(STEP)))?;
    }
    points.retain(|p| p.length() <= 1.0);
    let grid = Grid::around(&points, voxels)?;
    log::info!(
        "a grid of {grid} voxels of {:.4}, {} MiB",
        grid.voxel * seen.frame.radius,
        grid.bytes() >> 20
    );
    let n_views = seen.train.len() + seen.others.len();
    let mut progress = Progress::stage("meshing", n_views as u32);
    let mut volume = Volume::new(grid);
    for (done, camera) in (1..).zip(seen.train.iter().chain(seen.others)) {
        look(camera, &mut |image| volume.add(&image))?;
        progress.advance(done);
    }
    progress.finish();
    let mesh = volume.surface();
    if mesh.triangles.is_empty() {
        return Err(Error::new("the views agree on no surface")
            .way_out("ask for fewer, larger voxels with --mesh-voxels"));
    }
    Ok(mesh.placed(&Similarity {
        scale: seen.frame.radius,
        translation: seen.frame.center,
        ..Similarity::IDENTITY
    }))
}
