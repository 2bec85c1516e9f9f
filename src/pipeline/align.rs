//! This module brings a scene's test cameras into the frame of a run's model.

use crate::camera::json::read_cameras;
use crate::camera::{Camera, Frame, Similarity};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::eval::{Alignment, fit_poses};
use crate::gaussians::Gaussians;
use crate::render::Device;
use crate::run::RunDir;
use crate::scene::{Scene, View};

/// Poses as near as this, in shares of the sphere's radius and entries of the rotation, are one
/// pose that was written and read.
const SAME_POSE: f64 = 1e-9;

/// Test views with cameras in the frame of a run's model, and its canonical frame.
pub(super) struct Aligned {
    pub views: Vec<View>,
    pub frame: Frame,
}

/// Brings the test views of `scene` into the frame of the run's own training cameras.
///
/// # Errors
/// A training camera that the run does not have, or cameras that fix no similarity.
pub(super) fn by_similarity(run: &RunDir, scene: &Scene, frame: &Frame) -> Result<Aligned> {
    let similarity = similarity_to(run, scene, frame)?;
    let placed = |view: &View| View {
        camera: similarity.camera(&view.camera),
        ..view.clone()
    };
    Ok(Aligned {
        views: scene.test.iter().map(placed).collect(),
        frame: similarity.frame(frame),
    })
}

/// Fits the poses of aligned views where `align` asks for it.
pub(super) fn fitted(
    device: Device<'_>,
    gaussians: &Gaussians,
    config: &Config,
    align: Alignment,
    mut aligned: Aligned,
) -> Result<Aligned> {
    if align == Alignment::Fit {
        let Aligned { views, frame } = &mut aligned;
        let cameras = fit_poses(device, gaussians, frame, views, config)?;
        for (view, camera) in views.iter_mut().zip(cameras) {
            view.camera = camera;
        }
    }
    Ok(aligned)
}

/// Finds the similarity from the scene's frame to that of the run's `cameras.json`; exactly the
/// identity where the training cameras are in both alike.
fn similarity_to(run: &RunDir, scene: &Scene, frame: &Frame) -> Result<Similarity> {
    let path = run.cameras();
    let all = read_cameras(&path)?;
    let of_run = |view: &View| -> Result<Camera> {
        let name = &view.camera.name;
        let found = all.iter().find(|camera| camera.name == *name);
        let missing = || Error::new(format!("no camera of the training view `{name}`"));
        found.cloned().ok_or_else(|| missing().at_path(&path))
    };
    let to = scene.train.iter().map(of_run).collect::<Result<Vec<_>>>()?;
    let from = super::cameras(&scene.train);
    let same = |(a, b): (&Camera, &Camera)| {
        a.rotation.abs_diff_eq(b.rotation, SAME_POSE)
            && a.center().distance(b.center()) <= SAME_POSE * frame.radius
    };
    if from.iter().zip(&to).all(same) {
        return Ok(Similarity::IDENTITY);
    }
    let centers = |cameras: &[Camera]| cameras.iter().map(Camera::center).collect::<Vec<_>>();
    let (from, to) = (centers(&from), centers(&to));
    let similarity = Similarity::between(&from, &to).map_err(|e| {
        e.at("the centres of the training cameras")
            .at_path(run.root())
            .way_out(
                "give the scene the poses that the run was trained with, or train on more views",
            )
    })?;
    let squares = from.iter().zip(&to);
    let squares = squares.map(|(a, b)| similarity.point(*a).distance_squared(*b));
    let rms = (squares.sum::<f64>() / from.len() as f64).sqrt();
    log::info!(
        "{}: a similarity of scale {:.6} takes the scene's training cameras to the run's, which \
         it misses by {:.3} % of R",
        run.root().display(),
        similarity.scale,
        100.0 * rms / similarity.frame(frame).radius
    );
    Ok(similarity)
}
