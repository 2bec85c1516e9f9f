//! This module makes what training leaves beside the model: its cameras, the sheet of virtual
//! views, and records of poses and of the model's size.

use super::cameras;
use crate::camera::{Camera, Motion};
use crate::error::Result;
use crate::report::{ContactSheet, mask_image, write_png};
use crate::run::{ModelSize, PoseChange, RunDir};
use crate::scene::{Image, Scene};
use crate::train::{PlanRecord, TrainingView};

/// Returns training, test and virtual cameras; a test view that is also a training view is there
/// once.
pub(super) fn all_cameras(
    scene: &Scene,
    train: Vec<Camera>,
    virtual_cameras: &[Camera],
) -> Vec<Camera> {
    let is_new = |camera: &Camera| train.iter().all(|other| other.name != camera.name);
    let mut test = cameras(&scene.test);
    test.retain(is_new);
    [&train, &test, virtual_cameras].concat()
}

/// Returns how far refined `cameras` are from those that the views came with, and logs the means.
pub(super) fn pose_changes(cameras: &[Camera], before: &[TrainingView]) -> Vec<PoseChange> {
    let change = |(after, before): (&Camera, &TrainingView)| {
        let Motion { turn, shift } = after.difference(&before.camera);
        PoseChange {
            view: after.name.clone(),
            turn_deg: turn.to_degrees(),
            shift,
        }
    };
    let changes: Vec<PoseChange> = cameras.iter().zip(before).map(change).collect();
    let mean =
        |of: fn(&PoseChange) -> f64| changes.iter().map(of).sum::<f64>() / changes.len() as f64;
    log::info!(
        "poses refined: turned by {:.2} degrees and shifted by {:.2} % of R in the mean",
        mean(|c| c.turn_deg),
        100.0 * mean(|c| c.shift)
    );
    changes
}

/// Writes the virtual views beside their masks.
pub(super) fn write_virtual_sheet(run: &RunDir, views: &[TrainingView]) -> Result<()> {
    let Some(first) = views.first() else {
        return Ok(());
    };
    let (width, height) = (first.camera.width, first.camera.height);
    let mut sheet = ContactSheet::new(views.len(), 2, width, height)?;
    for TrainingView { camera, goal, .. } in views {
        let (width, height) = (camera.width, camera.height);
        let goal = goal.texels();
        let rgb = goal
            .iter()
            .flat_map(|t| t.to_le_bytes().into_iter().take(3))
            .collect();
        let mask: Vec<u8> = goal.iter().map(|texel| texel.to_le_bytes()[3]).collect();
        sheet.add(&[
            &Image { width, height, rgb },
            &mask_image(width, height, &mask),
        ])?;
    }
    write_png(&run.virtual_sheet(), &sheet.finish())
}

/// Lists how many Gaussians there were from the start and after each change of the set.
pub(super) fn model_sizes(start: usize, plans: &[PlanRecord]) -> Vec<ModelSize> {
    let first = ModelSize {
        iteration: 0,
        n_gaussians: start,
        plan: None,
    };
    let rest = plans.iter().map(|plan| ModelSize {
        iteration: plan.iteration,
        n_gaussians: plan.n_gaussians,
        plan: Some(plan.counts),
    });
    std::iter::once(first).chain(rest).collect()
}
