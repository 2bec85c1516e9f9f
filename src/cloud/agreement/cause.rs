//! This module looks for why cloud and cameras may not belong together: it tries motions of the
//! cloud and changes of a view.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::probe::{Photo, Probe};
use super::{MIN_AGREEMENT, PointCloud, middle, thin};
use crate::camera::Camera;
use crate::error::Result;

/// The cloud as it is.
pub(super) const STILL: (DMat3, DVec3) = (DMat3::IDENTITY, DVec3::ZERO);

/// Points and views that a motion is tried on.
const MAX_POINTS: usize = 10_000;
const MAX_VIEWS: usize = 8;
/// A change that mends a view has colours agree by so much, and by so much more than before.
const MENDED: f64 = 2.0 * MIN_AGREEMENT;
/// If cloud and photographs agree by more than chance, as mirrored images of one place may, this
/// much more says that something is wrong, and so much where red and blue are exchanged.
const CLEARLY: f64 = MIN_AGREEMENT;
const EXCHANGED: f64 = 0.05;
/// Units are tried from `1 / RANGE` to `RANGE`, `N_UNITS` of them, a few per cent apart.
const RANGE: f64 = 1e4;
const N_UNITS: i32 = 400;
/// A camera that is so many times as far from the others as they are from their middle is astray.
const ASTRAY: f64 = 10.0;

/// A motion of the cloud, and what it says of its origin.
struct Motion {
    what: String,
    turn: DMat3,
    shift: DVec3,
}

/// Looks for what would make most of the views fit.
pub(super) fn likely_cause(
    cloud: &PointCloud,
    photos: &[Photo],
    center: DVec3,
) -> Result<Option<String>> {
    let probe = Probe::new(&thin(cloud, MAX_POINTS, 0), center)?;
    let step = photos.len().div_ceil(MAX_VIEWS).max(1);
    let photos: Vec<&Photo> = photos.iter().step_by(step).collect();
    let mean = |agreements: Vec<f64>| agreements.iter().sum::<f64>() / photos.len().max(1) as f64;
    let moved = |motion| {
        mean(
            photos
                .iter()
                .map(|p| agreement(&probe, p, motion))
                .collect(),
        )
    };
    let changed = |change: fn(&Photo) -> Photo| {
        let photos = photos.iter().map(|photo| change(photo));
        mean(photos.map(|p| agreement(&probe, &p, STILL)).collect())
    };
    let before = moved(STILL).max(0.0);
    let motions: Vec<Motion> = axes().into_iter().chain(units(center)).collect();
    let of_cloud: Vec<(f64, String)> = motions
        .into_par_iter()
        .map(|m| (moved((m.turn, m.shift)), m.what))
        .collect();
    let of_views = CHANGES
        .iter()
        .map(|(what, change)| (changed(*change), (*what).to_owned()));
    let best = of_cloud.into_iter().chain(of_views).reduce(better);
    Ok(best
        .filter(|(score, _)| *score >= before + MENDED)
        .map(|(score, what)| format!("{what} (colours are then correlated by {score:.2})")))
}

/// Looks for what would make cloud and photographs, which agree, agree clearly better in every view
/// that tells.
pub(super) fn better_still(
    cloud: &PointCloud,
    photos: &[Photo],
    center: DVec3,
) -> Result<Option<String>> {
    let probe = Probe::new(&thin(cloud, MAX_POINTS, 0), center)?;
    let exchanged = probe.recolored(|[r, g, b]| [b, g, r]);
    let step = photos.len().div_ceil(MAX_VIEWS).max(1);
    let photos: Vec<&Photo> = photos.iter().step_by(step).collect();
    let colors = |probe: &Probe, photo: &Photo| {
        let colors = probe.look(photo, STILL).colors;
        colors.map(|colors| colors.agreement)
    };
    let gain = |changed: &dyn Fn(&Photo) -> Option<f64>| {
        let pairs = photos
            .iter()
            .map(|p| Some((colors(&probe, p)?, changed(p)?)));
        let pairs: Vec<(f64, f64)> = pairs.flatten().collect();
        let is_better = !pairs.is_empty() && pairs.iter().all(|(before, after)| after > before);
        let n = pairs.len().max(1) as f64;
        let mean = |of: fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let (before, after) = (mean(|p| p.0), mean(|p| p.1));
        (if is_better { after - before } else { 0.0 }, before, after)
    };
    let of_views = CHANGES.iter().map(|(what, change)| {
        let gained = gain(&|photo| colors(&probe, &change(photo)));
        (gained, *what, CLEARLY)
    });
    // What is where stays as it is: any gain says that the channels are others.
    let of_colors = (
        gain(&|photo| colors(&exchanged, photo)),
        "red and blue of the cloud's points are exchanged: write red, green, blue",
        EXCHANGED,
    );
    let all = of_views.chain([of_colors]);
    let best = all.filter(|((gain, ..), _, least)| gain >= least);
    let best = best.reduce(|a, b| if b.0.0 > a.0.0 { b } else { a });
    Ok(best.map(|((_, before, after), what, _)| {
        format!("{what} (colours are then correlated by {after:.2} instead of {before:.2})")
    }))
}

/// Returns the better of two, the first of equal ones.
fn better<T>(a: (f64, T), b: (f64, T)) -> (f64, T) {
    if b.0 > a.0 { b } else { a }
}

/// Returns how far the colours agree; 0 where nothing tells.
fn agreement(probe: &Probe, photo: &Photo, motion: (DMat3, DVec3)) -> f64 {
    let colors = probe.look(photo, motion).colors;
    colors.map_or(0.0, |colors| colors.agreement)
}

/// A likely fault in words, and how a photograph looks without it.
type Change = (&'static str, fn(&Photo) -> Photo);

/// Faults that all views may share.
const CHANGES: [Change; 4] = [
    (
        "the photographs are stored upside down: turn their pixels by 180 degrees, as their EXIF \
         orientation may say",
        |photo| photo.turned(),
    ),
    ("the photographs are mirrored", |photo| photo.mirrored()),
    (
        "the cameras have the axes of OpenGL (y up, z back): turn y and z of each over",
        |photo| {
            let over = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
            photo.from(Camera {
                rotation: over * photo.camera.rotation,
                translation: over * photo.camera.translation,
                ..photo.camera.clone()
            })
        },
    ),
    (
        "the poses are camera-to-world where world-to-camera is wanted: invert them",
        |photo| {
            photo.from(Camera {
                rotation: photo.camera.rotation.transpose(),
                translation: photo.camera.center(),
                ..photo.camera.clone()
            })
        },
    ),
];

/// Returns every other way to name three axes and their directions, mirrored ones included.
fn axes() -> Vec<Motion> {
    const ORDERS: [[usize; 3]; 6] = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    let unit = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut motions = Vec::new();
    for order in ORDERS {
        for signs in 1..8_u32 + u32::from(order != ORDERS[0]) {
            let sign = |axis: usize| if signs >> axis & 1 == 0 { 1.0 } else { -1.0 };
            let row = |axis: usize| unit[order[axis]] * sign(axis);
            let turn = DMat3::from_cols(row(0), row(1), row(2)).transpose();
            let name = |axis: usize| {
                let minus = if sign(axis) < 0.0 { "-" } else { "" };
                format!("{minus}{}", ["x", "y", "z"][order[axis]])
            };
            let written = format!("(x, y, z) -> ({}, {}, {})", name(0), name(1), name(2));
            let why = if order == ORDERS[0] && signs == 6 {
                "the cloud has the axes of OpenGL and viewers, y and z turned over"
            } else if turn.determinant() < 0.0 {
                "the cloud is mirrored"
            } else {
                "the cloud has other axes than the cameras"
            };
            motions.push(Motion {
                what: format!("{why}: write it with {written}"),
                turn,
                shift: DVec3::ZERO,
            });
        }
    }
    motions
}

/// Returns other units, about the world's origin and about the cameras.
fn units(center: DVec3) -> Vec<Motion> {
    let about = [(DVec3::ZERO, "the origin"), (center, "the cameras")];
    let steps = (-N_UNITS / 2..=N_UNITS / 2).filter(|step| *step != 0);
    steps
        .flat_map(|step| {
            let factor = RANGE.powf(f64::from(2 * step) / f64::from(N_UNITS));
            about.map(|(origin, name)| Motion {
                what: format!(
                    "the cloud has another unit than the cameras: multiply its positions by about \
                     {factor:.3e} about {name}"
                ),
                turn: DMat3::from_diagonal(DVec3::splat(factor)),
                shift: origin * (1.0 - factor),
            })
        })
        .collect()
}

/// Looks for what would make view `i` fit, where others do.
pub(super) fn view_cause(probe: &Probe, photos: &[Photo], i: usize) -> Option<String> {
    let photo = &photos[i];
    let before = agreement(probe, photo, STILL).max(0.0);
    let mut changed = vec![
        (
            photo.turned(),
            "its photograph would fit turned by 180 degrees: turn its pixels, as its EXIF orientation \
             may say"
                .to_owned(),
        ),
        (photo.mirrored(), "its photograph would fit mirrored".to_owned()),
    ];
    for other in photos.iter().filter(|o| o.camera.name != photo.camera.name) {
        changed.extend(photo.with_cells_of(other).map(|swapped| {
            let name = other.camera.name.escape_debug();
            (
                swapped,
                format!("the photograph of `{name}` would fit its camera: are names mixed up?"),
            )
        }));
    }
    let tried = changed
        .into_iter()
        .map(|(photo, what)| (agreement(probe, &photo, STILL), what));
    let best = tried.reduce(better);
    if let Some((_, what)) = best.filter(|(score, _)| *score >= before + MENDED) {
        return Some(what);
    }
    let others = photos.iter().map(|p| &p.camera);
    let others: Vec<_> = others.filter(|c| c.name != photo.camera.name).collect();
    let center = middle(&others);
    let mut distances: Vec<f64> = others.iter().map(|c| c.center().distance(center)).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let usual = *distances.get(distances.len() / 2)?;
    let times = photo.camera.center().distance(center) / usual;
    (times.is_finite() && times >= ASTRAY).then(|| {
        format!(
            "its camera is astray, {times:.0} times as far from the others as they are from their middle: \
             leave it out or pose it again"
        )
    })
}
