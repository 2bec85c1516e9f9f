//! This module marks pixels of the photographs that further losses look at: the far ones, and those beside a
//! cut-out subject.

use super::cameras;
use crate::camera::Frame;
use crate::cloud::far::far_pixels;
use crate::cloud::splat::splat_depths;
use crate::config::Config;
use crate::error::Result;
use crate::scene::{PointCloud, Scene};
use crate::train::TrainingView;

/// Marks the pixels of `real`, the training views of `scene`, that the losses of `config` ask for; depths are those of
/// `cloud`.
///
/// # Errors
/// As [`splat_depths`].
pub(super) fn marked(
    real: Vec<TrainingView>,
    scene: &Scene,
    (cloud, frame): (&PointCloud, &Frame),
    config: &Config,
) -> Result<Vec<TrainingView>> {
    let mut real = real;
    if config.loss.far_weight > 0.0 {
        let cameras = cameras(&scene.train);
        let near = frame.near(config.model.near);
        let depths = splat_depths(cloud, frame, (&cameras, &cameras), &config.splat, near)?;
        let views = real.into_iter().zip(&scene.train).zip(&depths);
        let far =
            views.map(|((view, of), depths)| view.with_far(&far_pixels(depths, |i| of.shows(i))));
        real = far.collect();
    }
    if config.loss.silhouette_weight > 0.0 {
        let outlined = real
            .into_iter()
            .zip(&scene.train)
            .map(|(view, of)| match &of.mask {
                Some(mask) if of.is_cut_out() => view.with_silhouette(&mask.set),
                _ => view,
            });
        real = outlined.collect();
    }
    Ok(real)
}

/// Returns what to tell of losses that find nothing to look at.
pub(super) fn warning(real: &[TrainingView], config: &Config) -> Option<String> {
    let none = |n: fn(&TrainingView) -> usize| real.iter().all(|view| n(view) == 0);
    if config.loss.far_weight > 0.0 && none(|view| view.n_far) {
        return Some(
            "no point of the cloud lies in a pixel of a training view: loss.far_weight has no far pixels".to_owned(),
        );
    }
    (config.loss.silhouette_weight > 0.0 && none(|view| view.n_outlined)).then(|| {
        "no photograph's subject is cut out: loss.silhouette_weight has no mask to compare with"
            .to_owned()
    })
}
