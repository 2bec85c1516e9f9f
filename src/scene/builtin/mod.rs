//! The built-in scene: a still life that the program ray-traces itself, at any size, with exact
//! geometry and a cloud like DUSt3R's.
//!
//! World frame: z up, unit of length about half the arrangement's height, floor at `z = 0`,
//! everything inside a dome of radius [`DOME_RADIUS`]. Everything is a function of the options
//! alone: the same bits on any number of threads.

mod cloud;
mod noise;
mod shapes;
mod still_life;
mod texture;
mod trace;

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

pub use cloud::{Imperfections, is_depth_edge, point_cloud};
pub use still_life::DOME_RADIUS;
pub use trace::{Hit, Traced, render, surface_distance, trace, unproject};

use super::{Scene, View};
use crate::camera::Camera;

/// Image widths that the built-in scene is made at.
pub const WIDTHS: RangeInclusive<u32> = 16..=4096;

/// What every camera of the scene looks at, give or take a little.
pub const CENTER: DVec3 = DVec3::new(0.0, 0.0, 0.3);

/// What the built-in scene is made with.
#[derive(Clone, Debug, PartialEq)]
pub struct BuiltinOptions {
    /// Image width, pixels, within [`WIDTHS`] (others are clamped, with a warning); the height
    /// is two thirds of it.
    pub width: u32,
    /// Seeds the cloud's imperfections. Geometry, cameras and images never change.
    pub seed: u64,
    /// Number of test views.
    pub n_test: usize,
    /// The cloud has a point for every so-many-th pixel of the training views, in x and in y;
    /// at 1, the density of DUSt3R, it has about as many points as there are training pixels.
    pub pixel_step: u32,
    pub imperfections: Imperfections,
}

impl Default for BuiltinOptions {
    fn default() -> Self {
        Self {
            width: 480,
            seed: 0,
            n_test: 60,
            pixel_step: 1,
            imperfections: Imperfections::default(),
        }
    }
}

/// Makes the scene: 4 training views on an uneven ring, `n_test` test views over the upper
/// hemisphere, and the cloud of the training views.
pub fn scene(options: &BuiltinOptions) -> Scene {
    let width = options.width.clamp(*WIDTHS.start(), *WIDTHS.end());
    let mut warnings = Vec::new();
    if width != options.width {
        warnings.push(format!(
            "built-in scene: width {} px changed to {width} px; it is made {} to {} px wide",
            options.width,
            WIDTHS.start(),
            WIDTHS.end()
        ));
    }
    let cameras = train_cameras(width);
    let traced: Vec<Traced> = cameras.par_iter().map(trace).collect();
    let cloud = point_cloud(
        &cameras,
        &traced,
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
        })
        .collect();
    let test = test_cameras(width, options.n_test)
        .into_par_iter()
        .map(|camera| View {
            image: render(&camera),
            camera,
            mask: None,
        })
        .collect();
    Scene {
        name: "builtin".into(),
        source: format!("built-in scene, {width} pixels wide"),
        train,
        test,
        cloud,
        warnings,
    }
}

/// The 4 training cameras for images of this width: azimuth gaps of 62 to 118 degrees,
/// elevations of 18 to 36.
pub fn train_cameras(width: u32) -> Vec<Camera> {
    // Azimuth and elevation in degrees, distance, and how far the aim is off the centre.
    const RING: [(f64, f64, f64, DVec3); 4] = [
        (-112.0, 25.0, 3.9, DVec3::new(0.05, -0.02, 0.02)),
        (-50.0, 36.0, 3.7, DVec3::new(-0.04, 0.05, -0.02)),
        (36.0, 18.0, 4.1, DVec3::new(0.02, 0.04, 0.03)),
        (154.0, 29.0, 3.8, DVec3::new(-0.03, -0.05, 0.0)),
    ];
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

/// `n` test cameras, even in area between 5 and 75 degrees of elevation, at the training
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

/// A camera that looks at `CENTER + aim` from a place around [`CENTER`] (radians, world units).
fn around(
    width: u32,
    name: String,
    azimuth: f64,
    elevation: f64,
    distance: f64,
    aim: DVec3,
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
    intrinsics.looking_at(name, CENTER + outward * distance, CENTER + aim, DVec3::Z)
}
