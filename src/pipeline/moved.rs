//! Whether the scene in another folder is the one that a run was trained on.

use super::focus_of;
use crate::camera::Camera;
use crate::camera::json::read_cameras;
use crate::error::{Error, Result};
use crate::run::{Metrics, RunDir};
use crate::scene::Scene;

/// How far a camera may be from the run's: files hold few digits.
const TURN_RAD: f64 = 1e-5;
/// In shares of the sphere's radius.
const SHIFT: f64 = 1e-5;
/// Tolerance of focal lengths and the principal point, in shares of the image's longer side.
const LENS: f64 = 1e-5;

/// Holds the scene against what the run wrote of its own: the views' names were looked up when it
/// was loaded; here their sizes, lenses and poses, and the cloud. Poses that the run refined are
/// not compared. Photographs may be other files of the same size.
///
/// # Errors
/// The first difference, by name.
pub(super) fn check_same(run: &RunDir, metrics: &Metrics, scene: &Scene) -> Result<()> {
    let differs = |what: String| {
        Error::new(format!(
            "the scene is not the one that was trained on: {what}"
        ))
        .at(&metrics.scene.source)
        .way_out("name the folder to which that scene has moved")
    };
    let record = &metrics.scene;
    if scene.cloud.len() != record.n_points {
        let (now, then) = (scene.cloud.len(), record.n_points);
        return Err(differs(format!(
            "its cloud has {now} points and had {then}"
        )));
    }
    if record
        .cloud_crc32
        .is_some_and(|crc| crc != scene.cloud.crc32())
    {
        return Err(differs("its cloud has other points".to_owned()));
    }
    let known = read_cameras(&run.cameras())?;
    let (_, frame) = focus_of(scene)?;
    for view in scene.train.iter().chain(&scene.test) {
        let now = &view.camera;
        let name = now.name.escape_debug();
        let Some(then) = known.iter().find(|camera| camera.name == now.name) else {
            return Err(differs(format!("view `{name}` is none of the run's")));
        };
        if (now.width, now.height) != (then.width, then.height) {
            return Err(differs(format!(
                "view `{name}` is {}x{} pixels and was {}x{}",
                now.width, now.height, then.width, then.height
            )));
        }
        let lens = |c: &Camera| [c.fx, c.fy, c.cx, c.cy];
        let bound = LENS * f64::from(now.width.max(now.height));
        let mut pairs = lens(now).into_iter().zip(lens(then));
        if !pairs.all(|(a, b)| (a - b).abs() <= bound) {
            return Err(differs(format!("view `{name}` has another lens")));
        }
        let is_refined = metrics.refined_poses.iter().any(|p| p.view == now.name);
        let (turn, shift) = now.difference(then);
        let is_there = turn <= TURN_RAD && shift <= SHIFT * frame.radius;
        if !is_refined && !is_there {
            return Err(differs(format!("view `{name}` is taken from elsewhere")));
        }
    }
    Ok(())
}
