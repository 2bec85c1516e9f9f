//! This module lays smooth paths through cameras.

use glam::{DMat3, DQuat, DVec3, DVec4};

use super::{Camera, Motion};
use crate::error::{Error, Result};

/// What is interpolated of a camera: its centre, its rotation as a quaternion, the logarithms of
/// its focal lengths, and its principal point in shares of the image.
const N: usize = 11;
type Key = [f64; N];

/// Turns up to here are rounding, radians.
const SAME_TURN: f64 = 1e-6;

/// Places `n` cameras on a smooth path that begins at the first of `cameras`, goes through all in
/// their order at an even pace, and ends at the last. Their images have the first one's size.
///
/// Between two cameras every number runs along a cubic Hermite curve. Its slope at a camera is that
/// of the parabola through it and its two neighbours, so the path has no corner. Time between two
/// cameras is their distance plus their turn, each in shares of its mean along the path.
///
/// # Errors
/// There are not two cameras that differ.
pub fn along(cameras: &[Camera], n: u32) -> Result<Vec<Camera>> {
    let Some(first) = cameras.first() else {
        return Err(too_few(0));
    };
    let (times, keys) = keys(cameras);
    if keys.len() < 2 {
        return Err(too_few(cameras.len()));
    }
    let slopes = slopes(&times, &keys);
    let end = times[times.len() - 1];
    let camera = |i: u32| {
        let time = end * f64::from(i) / f64::from(n.max(2) - 1);
        // The last key that is not later, but for the end of the path.
        let k = times
            .partition_point(|t| *t <= time)
            .clamp(1, keys.len() - 1)
            - 1;
        let span = times[k + 1] - times[k];
        let share = ((time - times[k]) / span).clamp(0.0, 1.0);
        let at = hermite(
            [&keys[k], &keys[k + 1]],
            [&slopes[k], &slopes[k + 1]],
            span,
            share,
        );
        camera_of(&at, format!("path_{i:03}"), first)
    };
    Ok((0..n).map(camera).collect())
}

fn too_few(n: usize) -> Error {
    Error::usage(format!(
        "a path needs two cameras that differ, and there is {}",
        match n {
            0 => "no camera".to_owned(),
            1 => "one camera".to_owned(),
            n => format!("one place for all {n} cameras"),
        }
    ))
    .way_out("choose more views with --views, or another file of cameras")
}

/// Returns when the path is at each camera, and what it is there; of cameras in a row that are the
/// same, the first.
fn keys(cameras: &[Camera]) -> (Vec<f64>, Vec<Key>) {
    let mut chosen: Vec<&Camera> = Vec::new();
    for camera in cameras {
        let is_new = chosen.last().is_none_or(|last| {
            let Motion { turn, shift } = camera.difference(last);
            turn > SAME_TURN || shift > 0.0
        });
        if is_new {
            chosen.push(camera);
        }
    }
    let motions: Vec<Motion> = chosen.windows(2).map(|w| w[1].difference(w[0])).collect();
    let mean = |of: fn(&Motion) -> f64| motions.iter().map(of).sum::<f64>() / motions.len() as f64;
    let (turn, shift) = (mean(|m| m.turn), mean(|m| m.shift));
    let share = |value: f64, mean: f64| if mean > 0.0 { value / mean } else { 0.0 };
    let mut times = vec![0.0];
    for motion in &motions {
        let last = times[times.len() - 1];
        times.push(last + share(motion.turn, turn) + share(motion.shift, shift));
    }
    let mut keys: Vec<Key> = Vec::with_capacity(chosen.len());
    for camera in chosen {
        let before = keys.last().map(|key| DVec4::from_slice(&key[3..7]));
        keys.push(key_of(camera, before));
    }
    (times, keys)
}

/// Returns a camera's numbers; its quaternion is the one of both that is nearer to that `before`.
fn key_of(camera: &Camera, before: Option<DVec4>) -> Key {
    let mut turn = DVec4::from(DQuat::from_mat3(&camera.rotation));
    if before.is_some_and(|before| before.dot(turn) < 0.0) {
        turn = -turn;
    }
    let [x, y, z] = camera.center().to_array();
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    [
        x,
        y,
        z,
        turn.x,
        turn.y,
        turn.z,
        turn.w,
        (camera.fx / width).ln(),
        (camera.fy / height).ln(),
        camera.cx / width,
        camera.cy / height,
    ]
}

/// Undoes [`key_of`] for an image of the size of `first`.
fn camera_of(key: &Key, name: String, first: &Camera) -> Camera {
    let center = DVec3::from_slice(&key[..3]);
    let turn = DVec4::from_slice(&key[3..7]);
    // Turns of nearly 180 degrees may pass zero.
    let turn = turn.try_normalize().unwrap_or(DVec4::W);
    let rotation = DMat3::from_quat(DQuat::from_vec4(turn));
    let (width, height) = (f64::from(first.width), f64::from(first.height));
    Camera {
        name,
        fx: key[7].exp() * width,
        fy: key[8].exp() * height,
        cx: key[9] * width,
        cy: key[10] * height,
        rotation,
        translation: -(rotation * center),
        ..first.clone()
    }
}

/// Returns the change a unit of time at each key: of the parabola through three of them, and at
/// both ends of the line through two.
fn slopes(times: &[f64], keys: &[Key]) -> Vec<Key> {
    let chord = |k: usize, c: usize| (keys[k + 1][c] - keys[k][c]) / (times[k + 1] - times[k]);
    let last = keys.len() - 1;
    let slope = |k: usize, c: usize| match k {
        0 => chord(0, c),
        k if k == last => chord(last - 1, c),
        k => {
            let (before, after) = (times[k] - times[k - 1], times[k + 1] - times[k]);
            (chord(k - 1, c) * after + chord(k, c) * before) / (before + after)
        }
    };
    (0..keys.len())
        .map(|k| std::array::from_fn(|c| slope(k, c)))
        .collect()
}

fn hermite([a, b]: [&Key; 2], [da, db]: [&Key; 2], span: f64, t: f64) -> Key {
    let (t2, t3) = (t * t, t * t * t);
    let (at_b, out_of_a, into_b) = (3.0 * t2 - 2.0 * t3, t3 - 2.0 * t2 + t, t3 - t2);
    std::array::from_fn(|c| {
        a[c] + (b[c] - a[c]) * at_b + span * (da[c] * out_of_a + db[c] * into_b)
    })
}
