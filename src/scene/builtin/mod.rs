//! The built-in scene is a still life that the program ray-traces itself, at any size, with exact
//! geometry and a cloud like DUSt3R's; a second one is a single [`object`] with its masks.
//!
//! World frame: z up, unit of length about half the arrangement's height, floor at `z = 0`,
//! everything inside a dome of radius [`DOME_RADIUS`]. Everything is a function of the options
//! alone: the same bits on any number of threads.

mod cloud;
mod noise;
mod object;
mod shapes;
mod still_life;
mod texture;
mod trace;

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

pub use cloud::{Imperfections, is_depth_edge, point_cloud};
pub use object::object;
pub use still_life::DOME_RADIUS;
pub use trace::{Hit, Traced, render, surface_distance, trace, unproject};

use super::{PoseProtocol, Scene, View};
use crate::camera::Camera;

/// Image widths that the built-in scene is made at.
pub const WIDTHS: RangeInclusive<u32> = 16..=4096;

/// Numbers of views that the cloud can be made from.
pub const CLOUD_VIEWS: RangeInclusive<usize> = 1..=8;

/// The point that every camera of the scene looks at, give or take a little.
pub const CENTER: DVec3 = DVec3::new(0.0, 0.0, 0.3);

/// Options that the built-in scene is made with.
#[derive(Clone, Debug, PartialEq)]
pub struct BuiltinOptions {
    /// Image width, pixels, within [`WIDTHS`] (others are clamped, with a warning); the height
    /// is two thirds of it.
    pub width: u32,
    /// Seeds the cloud's imperfections. Geometry, cameras and images never change.
    pub seed: u64,
    /// Number of test views.
    pub n_test: usize,
    /// Views that the cloud is made from, within [`CLOUD_VIEWS`] (others are clamped): the
    /// training views and, beyond them, views midway between.
    pub cloud_views: usize,
    /// The cloud has a point for every so-many-th pixel of its views, in x and in y;
    /// at 1, the density of DUSt3R, it has about as many points as there are training pixels.
    pub pixel_step: u32,
    /// Errors of the cloud, like those of a network's cloud.
    pub imperfections: Imperfections,
}

impl Default for BuiltinOptions {
    fn default() -> Self {
        Self {
            width: 480,
            seed: 0,
            n_test: 60,
            cloud_views: 4,
            pixel_step: 1,
            imperfections: Imperfections::default(),
        }
    }
}

/// Makes the scene: 4 training views on an uneven ring, `n_test` test views over the upper
/// hemisphere, and the cloud.
pub fn scene(options: &BuiltinOptions) -> Scene {
    let mut warnings = Vec::new();
    let width = width_of(options, &mut warnings);
    let cameras = train_cameras(width);
    let all = [cameras.clone(), cameras_between(width)].concat();
    let n_cloud = options
        .cloud_views
        .clamp(*CLOUD_VIEWS.start(), *CLOUD_VIEWS.end());
    let n_traced = n_cloud.max(cameras.len());
    let traced: Vec<Traced> = all[..n_traced].par_iter().map(trace).collect();
    let cloud = point_cloud(
        &all[..n_cloud],
        &traced[..n_cloud],
        options.pixel_step,
        options.seed,
        &options.imperfections,
    );
    let train = cameras
        .into_iter()
        .zip(traced)
        .map(|(camera, traced)| View {
            camera,
            image: traced.image,
            mask: None,
            prior: None,
        })
        .collect();
    let test = test_cameras(width, options.n_test)
        .into_par_iter()
        .map(|camera| View {
            image: render(&camera),
            camera,
            mask: None,
            prior: None,
        })
        .collect();
    Scene {
        name: "builtin".into(),
        source: format!("built-in scene, {width} pixels wide"),
        train,
        test,
        cloud,
        whole_cloud: None,
        pose_protocol: PoseProtocol::SharedFrame,
        warnings,
    }
}

/// Returns the width that a scene is made at, and tells `warnings` if it is not the one asked for.
fn width_of(options: &BuiltinOptions, warnings: &mut Vec<String>) -> u32 {
    let width = options.width.clamp(*WIDTHS.start(), *WIDTHS.end());
    if width != options.width {
        warnings.push(format!(
            "built-in scene: width {} px changed to {width} px; it is made {} to {} px wide",
            options.width,
            WIDTHS.start(),
            WIDTHS.end()
        ));
    }
    width
}

/// The training cameras: azimuth and elevation in degrees, distance, and how far the aim is off
/// the centre.
const RING: [(f64, f64, f64, DVec3); 4] = [
    (-112.0, 25.0, 3.9, DVec3::new(0.05, -0.02, 0.02)),
    (-50.0, 36.0, 3.7, DVec3::new(-0.04, 0.05, -0.02)),
    (36.0, 18.0, 4.1, DVec3::new(0.02, 0.04, 0.03)),
    (154.0, 29.0, 3.8, DVec3::new(-0.03, -0.05, 0.0)),
];

/// Returns the 4 training cameras for images of this width: azimuth gaps of 62 to 118 degrees,
/// elevations of 18 to 36.
pub fn train_cameras(width: u32) -> Vec<Camera> {
    let camera = |(i, (azimuth, elevation, distance, aim)): (usize, (f64, f64, f64, DVec3))| {
        let name = format!("train_{i:02}.png");
        around(
            width,
            name,
            azimuth.to_radians(),
            elevation.to_radians(),
            distance,
            aim,
        )
    };
    RING.into_iter().enumerate().map(camera).collect()
}

/// Returns cameras midway between neighbours of the ring, which a cloud of more views than the
/// training views sees besides.
fn cameras_between(width: u32) -> Vec<Camera> {
    let between = |i: usize| {
        let (a, b) = (RING[i], RING[(i + 1) % RING.len()]);
        let gap = (b.0 - a.0).rem_euclid(360.0);
        around(
            width,
            format!("between_{i:02}.png"),
            (a.0 + 0.5 * gap).to_radians(),
            (0.5 * (a.1 + b.1)).to_radians(),
            0.5 * (a.2 + b.2),
            DVec3::ZERO,
        )
    };
    (0..RING.len()).map(between).collect()
}

/// Returns `n` test cameras, even in area between 5 and 75 degrees of elevation, at the training
/// cameras' distances, looking at [`CENTER`].
pub fn test_cameras(width: u32, n: usize) -> Vec<Camera> {
    // 1 / golden ratio: azimuths of a Fibonacci lattice.
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let (low, high) = (5f64.to_radians().sin(), 75f64.to_radians().sin());
    (0..n)
        .map(|i| {
            let height = low + (high - low) * (i as f64 + 0.5) / n as f64;
            let turn = i as f64 * GOLDEN;
            // A second irrational rotation spreads the distances evenly as well.
            let distance = 3.7 + 0.4 * (i as f64 * std::f64::consts::SQRT_2).fract();
            let name = format!("test_{i:02}.png");
            around(
                width,
                name,
                turn * TAU,
                height.asin(),
                distance,
                DVec3::ZERO,
            )
        })
        .collect()
}

/// Returns a camera that looks at `CENTER + aim` from a place around [`CENTER`] (radians, world
/// units).
fn around(
    width: u32,
    name: String,
    azimuth: f64,
    elevation: f64,
    distance: f64,
    aim: DVec3,
) -> Camera {
    let at = (azimuth, elevation, distance);
    looking_from(width, name, (CENTER, at), CENTER + aim)
}

/// Returns a camera that looks at `target` from a place around `center`: azimuth and elevation in
/// radians, distance in world units.
fn looking_from(
    width: u32,
    name: String,
    (center, (azimuth, elevation, distance)): (DVec3, (f64, f64, f64)),
    target: DVec3,
) -> Camera {
    let height = (width * 2).div_ceil(3);
    let (w, h) = (f64::from(width), f64::from(height));
    let intrinsics = Camera {
        name: String::new(),
        width,
        height,
        fx: 1.15 * w,
        fy: 1.15 * w,
        cx: 0.5 * w,
        cy: 0.5 * h,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let outward = DVec3::new(
        elevation.cos() * azimuth.cos(),
        elevation.cos() * azimuth.sin(),
        elevation.sin(),
    );
    intrinsics.looking_at(name, center + outward * distance, target, DVec3::Z)
}
