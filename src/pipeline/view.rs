//! This module shows a finished run, or the Gaussians of a file, on a page.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use glam::{DMat3, DVec3};

use super::TrainJob;
use super::orbit::orbit;
use crate::camera::json::read_cameras;
use crate::camera::{Camera, Frame};
use crate::config::{Config, PRESETS};
use crate::error::{Error, Result};
use crate::field::Focus;
use crate::gaussians::Gaussians;
use crate::gaussians::ply::read_ply;
use crate::live::{Live, Phase, Subject};
use crate::report::Course;
use crate::run::{Metrics, RunDir};

/// Cameras around a file that comes without any.
const N_CAMERAS: u32 = 4;

/// Their images, pixels, and their focal length.
const SIZE: (u32, u32) = (900, 600);
const FOCAL_PX: f64 = 900.0;

/// How far from the middle they stand, in times the distance within which most Gaussians lie.
const DISTANCE: f64 = 2.5;

/// Share of the Gaussians that count as most.
const MOST: f64 = 0.8;

/// Serves a page on `port` that shows the run in `path`, or the Gaussians of the PLY file `path`, until the
/// process ends.
///
/// # Errors
/// Neither a finished run nor such a file, or a port that is in use.
pub fn view(path: &Path, port: u16) -> Result<Live> {
    if path.is_dir() {
        view_run(&RunDir::open(path)?, port)
    } else {
        view_file(path, port)
    }
}

fn view_run(run: &RunDir, port: u16) -> Result<Live> {
    let (config, metrics, evaluation) = (run.config()?, run.metrics()?, run.evaluation()?);
    let cameras = read_cameras(&run.cameras())?;
    let stored = read_ply(&run.point_cloud())?;
    let is_training = |c: &&Camera| metrics.scene.train_views.contains(&c.name);
    let training: Vec<Camera> = cameras.iter().filter(is_training).cloned().collect();
    let live = Live::serve(port)?;
    let scene = TrainJob::recorded(&metrics.scene, config.clone()).and_then(|job| job.load());
    // The frame is that of the cloud, too, where the scene is still there.
    let focus = match &scene {
        Ok(scene) => Focus::find(&training, &scene.cloud),
        Err(e) => {
            log::warn!("{e}; the page shows no photographs");
            Focus::find(&training, &Default::default())
        }
    };
    let frame = focus?.frame();
    if let Ok(scene) = scene {
        live.photographs(Arc::new(scene));
    }
    let iterations = metrics.iterations;
    live.ends(iterations);
    live.course(course(metrics.clone(), config.loss.ssim_weight), iterations);
    live.tested(&super::watch::curve_point(iterations, &evaluation));
    live.show(iterations, stored.to_canonical(&frame), Duration::ZERO);
    live.subject(Subject {
        name: run.name(),
        cameras,
        frame,
        config,
        scene: Some(metrics.scene),
    });
    live.phase(Phase::Finished);
    Ok(live)
}

/// Returns the course of a finished training, without its end at the test views.
fn course(metrics: Metrics, ssim_weight: f64) -> Course {
    let Metrics {
        iterations,
        loss,
        model_size,
        mut curve,
        signal,
        ..
    } = metrics;
    curve.retain(|point| point.iteration < iterations);
    Course {
        ssim_weight,
        loss,
        model_size,
        curve,
        signal,
    }
}

fn view_file(path: &Path, port: u16) -> Result<Live> {
    // The frame is of the positions as they are stored, so their offset does not matter.
    let gaussians = read_ply(path)?.gaussians;
    let config = Config::preset(PRESETS[0].0)?;
    let frame = frame_of(&gaussians).ok_or_else(|| {
        Error::new("none of its Gaussians is ever drawn, so there is nothing to see").at_path(path)
    })?;
    let live = Live::serve(port)?;
    live.show(0, gaussians.to_canonical(&frame), Duration::ZERO);
    live.subject(Subject {
        name: path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        cameras: cameras_around(&frame)?,
        frame,
        config,
        scene: None,
    });
    live.phase(Phase::Finished);
    Ok(live)
}

/// Returns the frame in which most Gaussians lie within a distance of 1; `None` if none is drawn.
fn frame_of(gaussians: &Gaussians) -> Option<Frame> {
    let mut means: Vec<DVec3> = gaussians
        .heaviest(usize::MAX)
        .into_iter()
        .map(|i| gaussians.means[i].as_dvec3())
        .collect();
    let middle = means.len().checked_sub(1)? / 2;
    // Medians: a few Gaussians far away do not move them.
    let median = |axis: usize, means: &mut Vec<DVec3>| {
        let by = |a: &DVec3, b: &DVec3| a[axis].total_cmp(&b[axis]);
        means.select_nth_unstable_by(middle, by).1[axis]
    };
    let center = DVec3::new(
        median(0, &mut means),
        median(1, &mut means),
        median(2, &mut means),
    );
    let mut distances: Vec<f64> = means.iter().map(|mean| mean.distance(center)).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let most = distances[((distances.len() - 1) as f64 * MOST) as usize];
    let radius = if most > 0.0 { most } else { 1.0 };
    Some(Frame {
        center,
        radius,
        extent: radius,
    })
}

/// Places cameras around the middle, upright as in the files of structure from motion: y down.
fn cameras_around(frame: &Frame) -> Result<Vec<Camera>> {
    let first = Camera {
        name: String::new(),
        width: SIZE.0,
        height: SIZE.1,
        fx: FOCAL_PX,
        fy: FOCAL_PX,
        cx: 0.5 * f64::from(SIZE.0),
        cy: 0.5 * f64::from(SIZE.1),
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let eye = frame.to_world(DVec3::new(0.0, -0.3, -1.0).normalize() * DISTANCE);
    let first = first.looking_at(String::new(), eye, frame.center, DVec3::NEG_Y);
    let focus = Focus {
        center: frame.center,
        radius: frame.radius,
        extent: frame.extent,
        fallback: None,
    };
    orbit(&[first], &focus, N_CAMERAS)
}
