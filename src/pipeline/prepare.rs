//! Everything between the scene and the first iteration: focus, field, virtual views, their
//! point splats, and the Gaussians to start from.

use glam::DVec3;
use rayon::prelude::*;

use super::{Clock, cameras, focus_of};
use crate::camera::{Camera, Frame};
use crate::config::Config;
use crate::error::Result;
use crate::field::{Coverage, Field, fibonacci_sphere};
use crate::gaussians::Gaussians;
use crate::run::Seconds;
use crate::scene::{Image, Scene, View, thin};
use crate::splat::{SplatImage, fill_holes, splat_views};
use crate::train::shell::Shell;
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
    let goals = virtual_goals(&splats, config.loss.fill_weight);
    seconds.splat = Some(clock.lap());

    let n_pixels: usize = scene.train.iter().map(|view| n_pixels(&view.image)).sum();
    let n_points = config.scene.max_points.unwrap_or(n_pixels);
    let cloud = thin(&scene.cloud, n_points, config.seed);
    let mut start = Gaussians::from_cloud(&cloud, &frame, &config.model)?;
    let shell = Shell::around(&start, &config.shell);
    if let Some(shell) = shell {
        let color = mean_color(&scene.train);
        start.extend(shell.gaussians(config.shell.count, color, config.model.sh_degree));
    }
    let supervision = Supervision {
        shell,
        ..supervision(scene, &frame, coverage, &virtual_views, goals)
    };
    Ok(Prepared {
        supervision,
        warnings: focus.fallback.into_iter().collect(),
        frame,
        virtual_cameras,
        start,
    })
}

/// The views that the optimiser learns from, in the canonical frame.
fn supervision(
    scene: &Scene,
    frame: &Frame,
    coverage: Coverage,
    virtual_views: &[VirtualView],
    goals: Vec<Vec<u32>>,
) -> Supervision {
    let real = scene.train.iter().map(|view| {
        TrainingView::photograph(frame.camera_to_canonical(&view.camera), texels(&view.image))
    });
    let virtual_views = virtual_views.iter().zip(goals).map(|(view, goal)| {
        TrainingView::masked(frame.camera_to_canonical(&view.camera), goal, view.alpha)
    });
    let real: Vec<TrainingView> = real.collect();
    Supervision {
        extent: extent(&real),
        real,
        virtual_views: virtual_views.collect(),
        coverage,
        shell: None,
    }
}

/// What the virtual views are compared with: the splats, with alpha 255 times the weight of a pixel
/// as [`TrainingView`] wants it. At a `fill_weight` above 0 their holes are filled.
fn virtual_goals(splats: &[SplatImage], fill_weight: f64) -> Vec<Vec<u32>> {
    let weight = (255.0 * fill_weight).round() as u8;
    splats
        .par_iter()
        .map(|splat| match weight {
            0 => bytemuck::pod_collect_to_vec(&splat.rgba),
            weight => bytemuck::pod_collect_to_vec(&fill_holes(splat, weight)),
        })
        .collect()
}

/// Mean over all pixels, RGB in [0, 1].
fn mean_color(views: &[View]) -> DVec3 {
    let mut sum = [0_u64; 3];
    let mut n = 0_u64;
    for pixel in views.iter().flat_map(|view| view.image.rgb.chunks_exact(3)) {
        sum = std::array::from_fn(|c| sum[c] + u64::from(pixel[c]));
        n += 255;
    }
    DVec3::from_array(sum.map(|s| s as f64 / n.max(1) as f64))
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
    let mean = centers.iter().sum::<DVec3>() / centers.len().max(1) as f64;
    1.1 * centers.iter().map(|c| c.distance(mean)).fold(0.0, f64::max)
}

fn n_pixels(image: &Image) -> usize {
    image.width as usize * image.height as usize
}
