//! This module tells whether the scene in another folder is the one that a run was trained on.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;

use super::focus_of;
use crate::camera::json::read_cameras;
use crate::camera::{Camera, Motion};
use crate::error::{Error, Result};
use crate::run::{Metrics, RunDir};
use crate::scene::{Scene, View};

/// How far a camera may be from the run's: files hold few digits.
const TURN_RAD: f64 = 1e-5;
/// In shares of the sphere's radius.
const SHIFT: f64 = 1e-5;
/// Tolerance of focal lengths and the principal point, in shares of the image's longer side.
const LENS: f64 = 1e-5;

/// Rows and columns of a photograph's thumbnail.
const CELLS: usize = 8;
/// A cell may differ by so many levels of 255: other systems round otherwise, and so do photographs
/// that are saved in another format.
const LEVELS: u8 = 2;

/// Holds the scene against what the run wrote of its own: the views' names were looked up when it
/// was loaded; here their sizes, lenses, poses and [`thumbnail`]s, and the cloud. Poses that the
/// run refined are not compared. Photographs may be other files of the same content.
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
        let Motion { turn, shift } = now.difference(then);
        let is_there = turn <= TURN_RAD && shift <= SHIFT * frame.radius;
        if !is_refined && !is_there {
            return Err(differs(format!("view `{name}` is taken from elsewhere")));
        }
        let names = record.train_views.iter().chain(&record.test_views);
        let mut thumbnails = names.zip(record.thumbnails.iter().flatten());
        let then = thumbnails.find(|(known, _)| **known == now.name);
        if then.is_some_and(|(_, then)| !alike(&thumbnail(view), then)) {
            return Err(differs(format!(
                "view `{name}` has another photograph or mask"
            )));
        }
    }
    Ok(())
}

/// Returns what a photograph shows, in Base64: for each of 8x8 cells, row by row, the mean red,
/// green and blue and the share that its mask sets, 255 for all or for no mask at all.
pub(super) fn thumbnail(view: &View) -> String {
    let (width, height) = (view.image.width as usize, view.image.height as usize);
    let mut sums = [[0_u64; 5]; CELLS * CELLS];
    for (i, rgb) in view.image.rgb.chunks_exact(3).enumerate() {
        let (x, y) = (i % width, i / width);
        let sum = &mut sums[y * CELLS / height * CELLS + x * CELLS / width];
        let is_set = view.mask.as_ref().is_none_or(|mask| mask.set[i]);
        let alpha = if is_set { 255 } else { 0 };
        for (sum, value) in sum.iter_mut().zip([rgb[0], rgb[1], rgb[2], alpha]) {
            *sum += u64::from(value);
        }
        sum[4] += 1;
    }
    let mean = |[r, g, b, a, n]: [u64; 5]| [r, g, b, a].map(|sum| (sum / n.max(1)) as u8);
    BASE64_STANDARD.encode(sums.map(mean).as_flattened())
}

/// Returns whether two thumbnails are the same but for rounding.
fn alike(a: &str, b: &str) -> bool {
    let [a, b] = [a, b].map(|text| BASE64_STANDARD.decode(text).unwrap_or_default());
    a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= LEVELS)
}
