//! The built-in object turns on the spot before a white ground, as objects of `OmniObject3D` do: camera and light stay where
//! they are. In the frame of the object the camera goes round it, and the light with it.
//!
//! World frame: z up, the object stands on `z = 0`, a little more than one unit high.

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::cloud::{Imperfections, point_cloud};
use super::shapes::{Shape, Solid};
use super::still_life::{Body, StillLife};
use super::texture::{Texture, color};
use super::trace::{Hit, Traced, cut_out, trace_of};
use super::{BuiltinOptions, CLOUD_VIEWS, looking_from, width_of};
use crate::camera::Camera;
use crate::scene::{Mask, Outside, PoseProtocol, Scene, View};

/// The middle of the object, which every camera looks at.
const MIDDLE: DVec3 = DVec3::new(0.0, 0.0, 0.6);

/// Distance of the camera from there.
const DISTANCE: f64 = 3.0;

/// Elevation of the camera in training views, degrees.
const ELEVATION: f64 = 20.0;

/// Turns of the object in training views, degrees: gaps of 75 to 105.
const TURNS: [f64; 4] = [-40.0, 45.0, 140.0, 215.0];

/// Elevations of the camera in test views, in turn, degrees.
const TEST_ELEVATIONS: [f64; 3] = [5.0, 22.0, 42.0];

/// The light of a view in which the object is not turned.
const TO_SUN: DVec3 = DVec3::new(0.62, -0.48, 0.92);

/// Ground of the photographs, RGB in [0, 1].
const WHITE: [f64; 3] = [1.0; 3];

static OBJECT: LazyLock<StillLife> = LazyLock::new(|| StillLife::of(bodies(), TO_SUN));

fn bodies() -> Vec<Body> {
    let upright = DMat3::IDENTITY;
    let tilt = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 0.3, 0.2));
    let body = |shape, rotation, position, texture, gloss| Body {
        solid: Solid::new(shape, rotation, position),
        texture,
        gloss,
    };
    let globe = |a, b| Texture::Globe { a, b };
    let base = DVec3::new(0.40, 0.30, 0.09);
    let foot = 2.0 * base.z;
    let standing = DMat3::from_rotation_x(FRAC_PI_2);
    let spout = DVec3::new(-0.75, 0.15, 0.6).normalize();
    vec![
        body(
            Shape::Box {
                half: base,
                round: 0.03,
            },
            upright,
            DVec3::Z * base.z,
            Texture::Dots { half: 0.3 },
            0.06,
        ),
        body(
            Shape::Frustum {
                bottom: 0.25,
                top: 0.17,
                half_height: 0.30,
                round: 0.04,
            },
            upright,
            DVec3::Z * (foot + 0.30),
            Texture::Spiral,
            0.2,
        ),
        body(
            Shape::Sphere { radius: 0.19 },
            tilt,
            DVec3::Z * (foot + 0.60 + 0.16),
            globe(color(196, 44, 40), color(244, 236, 220)),
            0.25,
        ),
        body(
            Shape::Sphere { radius: 0.06 },
            tilt,
            DVec3::Z * (foot + 0.60 + 0.39),
            globe(color(28, 92, 150), color(226, 226, 214)),
            0.3,
        ),
        body(
            Shape::Torus {
                major: 0.17,
                minor: 0.042,
            },
            standing,
            DVec3::new(0.33, 0.0, foot + 0.32),
            Texture::Segments { major: 0.17 },
            0.08,
        ),
        body(
            Shape::Capsule {
                half_length: 0.15,
                radius: 0.045,
            },
            DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, spout)),
            DVec3::new(-0.29, 0.06, foot + 0.38),
            Texture::Brass,
            0.25,
        ),
        body(
            Shape::Frustum {
                bottom: 0.10,
                top: 0.03,
                half_height: 0.13,
                round: 0.02,
            },
            upright,
            DVec3::new(0.24, -0.19, foot + 0.13),
            Texture::Wood,
            0.08,
        ),
        body(
            Shape::Sphere { radius: 0.08 },
            tilt,
            DVec3::new(-0.27, 0.19, foot + 0.08),
            globe(color(60, 130, 70), color(170, 206, 120)),
            0.3,
        ),
    ]
}

/// A view of the object.
#[derive(Clone)]
struct Turned {
    camera: Camera,
    /// How far the object is turned against the camera, radians.
    turn: f64,
}

impl Turned {
    /// Turns the object so that the camera, `elevation` degrees high, is `turn` degrees round it.
    fn new(width: u32, name: String, turn: f64, elevation: f64) -> Turned {
        let (turn, elevation) = (turn.to_radians(), elevation.to_radians());
        let at = (turn, elevation, DISTANCE);
        Turned {
            camera: looking_from(width, name, (MIDDLE, at), MIDDLE),
            turn,
        }
    }

    /// Returns the object in the light that it has then.
    fn lit(&self) -> StillLife {
        OBJECT.lit_from(DMat3::from_rotation_z(self.turn) * TO_SUN)
    }

    /// Renders it on a ground of this colour.
    fn view(&self, outside: Outside, ground: [f64; 3]) -> View {
        let (image, set) = cut_out(&self.lit(), &self.camera, ground);
        View {
            camera: self.camera.clone(),
            image,
            mask: Some(Mask { set, outside }),
            prior: None,
        }
    }

    /// Traces it: what is not the object is backdrop.
    fn traced(&self) -> Traced {
        let mut traced = trace_of(&self.lit(), &self.camera);
        for hit in &mut traced.hit {
            if *hit == Hit::Floor {
                *hit = Hit::Backdrop;
            }
        }
        traced
    }
}

/// Makes the scene: 4 training views around the object, `n_test` test views of three heights, a mask for each, and the
/// cloud. What masks leave out is as `outside` says, with this `background`, RGB in [0, 1], or white.
pub fn object(options: &BuiltinOptions, outside: Outside, background: [f64; 3]) -> Scene {
    let mut warnings = Vec::new();
    let width = width_of(options, &mut warnings);
    let ground = match outside {
        Outside::Background => background,
        Outside::Kept | Outside::Ignored => WHITE,
    };
    let train = (0..TURNS.len()).map(|i| {
        let name = format!("train_{i:02}.png");
        Turned::new(width, name, TURNS[i], ELEVATION)
    });
    let train: Vec<Turned> = train.collect();
    // Midway between, for clouds of more views than are trained on.
    let between = (0..TURNS.len()).map(|i| {
        let gap = (TURNS[(i + 1) % TURNS.len()] - TURNS[i]).rem_euclid(360.0);
        let name = format!("between_{i:02}.png");
        Turned::new(width, name, TURNS[i] + 0.5 * gap, ELEVATION)
    });
    let n_cloud = options
        .cloud_views
        .clamp(*CLOUD_VIEWS.start(), *CLOUD_VIEWS.end());
    let seen: Vec<Turned> = train.iter().cloned().chain(between).take(n_cloud).collect();
    let traced: Vec<Traced> = seen.par_iter().map(Turned::traced).collect();
    let cameras: Vec<Camera> = seen.iter().map(|view| view.camera.clone()).collect();
    let cloud = point_cloud(
        &cameras,
        &traced,
        options.pixel_step,
        options.seed,
        // The ground is not of the object.
        &Imperfections {
            backdrop_loss: 1.0,
            ..options.imperfections
        },
    );
    let test = (0..options.n_test).map(|i| {
        let turn = 360.0 * (i as f64 + 0.5) / options.n_test as f64;
        let elevation = TEST_ELEVATIONS[i % TEST_ELEVATIONS.len()];
        Turned::new(width, format!("test_{i:02}.png"), turn, elevation)
    });
    let test: Vec<Turned> = test.collect();
    let views = |of: &[Turned]| {
        of.par_iter()
            .map(|view| view.view(outside, ground))
            .collect()
    };
    Scene {
        name: "builtin-object".into(),
        source: format!("built-in object, {width} pixels wide"),
        train: views(&train),
        test: views(&test),
        cloud,
        whole_cloud: None,
        pose_protocol: PoseProtocol::SharedFrame,
        warnings,
    }
}
