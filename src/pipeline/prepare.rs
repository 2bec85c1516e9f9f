//! Everything between the scene and the first iteration: focus, field, virtual views, their
//! point splats, and the Gaussians to start from.

use super::{Clock, cameras, focus_of};
use crate::camera::{Camera, Frame};
use crate::config::Config;
use crate::error::Result;
use crate::field::{Coverage, Field, fibonacci_sphere};
use crate::gaussians::Gaussians;
use crate::run::Seconds;
use crate::scene::{Image, Scene, thin};
use crate::splat::{SplatImage, splat_views};
use crate::train::{Supervision, TrainingView};
use crate::views::{VirtualView, virtual_views};

/// What training starts from.
pub struct Prepared {
    pub frame: Frame,
    /// World frame.
    pub virtual_cameras: Vec<Camera>,
    /// Canonical frame.
    pub supervision: Supervision,
    /// Canonical frame.
    pub start: Gaussians,
    /// For the log.
    pub warnings: Vec<String>,
}

/// Prepares `scene` as `config` says; adds the stages' times to `seconds`.
///
/// # Errors
/// A camera layout without a sphere, more virtual views than candidates, or an empty cloud.
pub fn prepare(scene: &Scene, config: &Config, seconds: &mut Seconds) -> Result<Prepared> {
    let train_cameras = cameras(&scene.train);
    let mut clock = Clock::start();
    let (focus, frame) = focus_of(scene)?;
    let field = Field::new(&train_cameras, &focus, &config.field);
    let coverage = Coverage::new(&field, &fibonacci_sphere(config.field.n_candidates));
    seconds.field = Some(clock.lap());
    let virtual_views = virtual_views(&train_cameras, &focus, &field, config)?;
    let virtual_cameras: Vec<Camera> = virtual_views.iter().map(|v| v.camera.clone()).collect();
    seconds.sample = Some(clock.lap());
    let near = config.model.near;
    let splats = splat_views(&scene.cloud, &frame, &virtual_cameras, &config.splat, near)?;
    seconds.splat = Some(clock.lap());

    let cloud = thin(&scene.cloud, n_start(scene, config), config.seed);
    let start = Gaussians::from_cloud(&cloud, &frame, &config.model)?;
    Ok(Prepared {
        supervision: supervision(scene, &frame, coverage, &virtual_views, splats),
        warnings: focus.fallback.into_iter().collect(),
        frame,
        virtual_cameras,
        start,
    })
}

/// Number of points that training on `scene` starts from: `scene.max_points`, else one a training
/// pixel, and no more than the cloud has.
pub fn n_start(scene: &Scene, config: &Config) -> usize {
    let n_pixels: usize = scene.train.iter().map(|view| n_pixels(&view.image)).sum();
    let wanted = config.scene.max_points.unwrap_or(n_pixels);
    wanted.min(scene.cloud.len())
}

/// The views that the optimiser learns from, in the canonical frame.
fn supervision(
    scene: &Scene,
    frame: &Frame,
    coverage: Coverage,
    virtual_views: &[VirtualView],
    splats: Vec<SplatImage>,
) -> Supervision {
    let real = scene.train.iter().map(|view| TrainingView {
        camera: frame.camera_to_canonical(&view.camera),
        goal: texels(&view.image),
        n_valid: n_pixels(&view.image),
        masked: false,
        weight: 1.0,
    });
    let virtual_views = virtual_views
        .iter()
        .zip(splats)
        .map(|(view, splat)| TrainingView {
            camera: frame.camera_to_canonical(&view.camera),
            goal: bytemuck::pod_collect_to_vec(&splat.rgba),
            n_valid: splat.mask().filter(|&valid| valid).count(),
            masked: true,
            weight: view.alpha,
        });
    let real: Vec<TrainingView> = real.collect();
    Supervision {
        extent: extent(&real),
        real,
        virtual_views: virtual_views.collect(),
        coverage,
    }
}

/// RGBA8 with alpha 255, red in the lowest byte.
fn texels(image: &Image) -> Vec<u32> {
    let pixels = image.rgb.chunks_exact(3);
    pixels
        .map(|p| u32::from_le_bytes([p[0], p[1], p[2], 255]))
        .collect()
}

/// 3DGS's camera extent: 1.1 times the greatest distance of a camera from their mean.
fn extent(views: &[TrainingView]) -> f64 {
    let centers: Vec<_> = views.iter().map(|view| view.camera.center()).collect();
    let mean = centers.iter().sum::<glam::DVec3>() / centers.len().max(1) as f64;
    1.1 * centers.iter().map(|c| c.distance(mean)).fold(0.0, f64::max)
}

fn n_pixels(image: &Image) -> usize {
    image.width as usize * image.height as usize
}
