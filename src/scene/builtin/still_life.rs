//! This module says what stands where: the objects, the light, and the distance to the nearest
//! surface.

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

use glam::{DMat3, DQuat, DVec3};

use super::shapes::{Shape, Solid};
use super::texture::{Texture, color, floor_fade, horizon};

/// Radius of the dome (centre: the origin) that closes the scene above the floor `z = 0`.
pub const DOME_RADIUS: f64 = 10.0;

/// Upper side of the tray on which the objects stand.
const TRAY_TOP: f64 = 0.07;

/// Half the sun's apparent size as a tangent: large, for soft shadows.
const SUN_SIZE: f64 = 0.07;
const SUN: DVec3 = DVec3::new(1.30, 1.18, 1.00);
const SKY: DVec3 = DVec3::new(0.36, 0.40, 0.47);
const BOUNCE: DVec3 = DVec3::new(0.20, 0.16, 0.12);

/// One thing on the table.
#[derive(Clone)]
pub(super) struct Body {
    pub(super) solid: Solid,
    pub(super) texture: Texture,
    /// Strength of the highlight.
    pub(super) gloss: f64,
}

/// The surface that a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Surface {
    Dome,
    Floor,
    /// Index into the bodies.
    Body(usize),
}

/// The light that falls on a surface, each part in `[0, 1]`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Light {
    /// Share of the sky that is not occluded.
    openness: f64,
    /// Share of the sun's disc that is not occluded.
    sun: f64,
}

/// The arrangement.
pub(super) struct StillLife {
    bodies: Vec<Body>,
    to_sun: DVec3,
}

/// The one still life that there is.
pub(super) static STILL_LIFE: LazyLock<StillLife> = LazyLock::new(StillLife::new);

impl StillLife {
    /// Makes an arrangement of these bodies in light from this direction.
    pub(super) fn of(bodies: Vec<Body>, to_sun: DVec3) -> Self {
        Self {
            bodies,
            to_sun: to_sun.normalize(),
        }
    }

    /// Returns the same in light from another direction.
    pub(super) fn lit_from(&self, to_sun: DVec3) -> Self {
        Self::of(self.bodies.clone(), to_sun)
    }

    fn new() -> Self {
        let mut bodies = Vec::new();
        let mut put = |shape, rotation, position, texture, gloss| {
            bodies.push(Body {
                solid: Solid::new(shape, rotation, position),
                texture,
                gloss,
            });
        };
        // A solid that stands on the tray at (x, y); `lift` is its centre's height above it.
        let on_tray = |x, y, lift: f64| DVec3::new(x, y, TRAY_TOP + lift);
        let upright = DMat3::IDENTITY;

        let tray = Shape::Frustum {
            bottom: 1.46,
            top: 1.5,
            half_height: TRAY_TOP / 2.0,
            round: 0.025,
        };
        let tray_center = DVec3::Z * (TRAY_TOP / 2.0);
        put(tray, upright, tray_center, Texture::Mosaic, 0.10);

        let ball = |radius| Shape::Sphere { radius };
        let tilt = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.5, 0.35, 0.2));
        put(
            ball(0.43),
            upright,
            on_tray(-0.50, 0.36, 0.43),
            Texture::Marble,
            0.28,
        );
        let checks = Texture::Globe {
            a: color(196, 44, 40),
            b: color(244, 236, 220),
        };
        put(ball(0.19), tilt, on_tray(0.10, -0.30, 0.19), checks, 0.25);
        let lemon = Texture::Globe {
            a: color(244, 206, 70),
            b: color(226, 164, 36),
        };
        put(ball(0.105), tilt, on_tray(0.98, 0.14, 0.105), lemon, 0.2);
        let berry = Texture::Globe {
            a: color(92, 46, 120),
            b: color(150, 92, 170),
        };
        put(ball(0.085), tilt, on_tray(-0.12, -0.78, 0.085), berry, 0.2);

        let dice = Shape::Box {
            half: DVec3::splat(0.30),
            round: 0.05,
        };
        let turned = DMat3::from_rotation_z(0.5);
        put(
            dice,
            turned,
            on_tray(0.52, 0.52, 0.30),
            Texture::Dots { half: 0.30 },
            0.06,
        );

        let vase = Shape::Frustum {
            bottom: 0.15,
            top: 0.21,
            half_height: 0.46,
            round: 0.04,
        };
        put(
            vase,
            upright,
            on_tray(-0.02, 0.98, 0.46),
            Texture::Spiral,
            0.22,
        );
        let cone = Shape::Frustum {
            bottom: 0.27,
            top: 0.045,
            half_height: 0.40,
            round: 0.03,
        };
        put(
            cone,
            upright,
            on_tray(0.66, -0.50, 0.40),
            Texture::Wood,
            0.08,
        );

        // A ring that stands on its edge.
        let (major, minor) = (0.27, 0.075);
        let standing = DMat3::from_rotation_z(-0.55) * DMat3::from_rotation_x(FRAC_PI_2 - 0.12);
        let ring_lift = major * (FRAC_PI_2 - 0.12).sin() + minor;
        put(
            Shape::Torus { major, minor },
            standing,
            on_tray(-0.55, -0.50, ring_lift),
            Texture::Segments { major },
            0.08,
        );

        // Two books beside the tray's middle, and a marble on top of them.
        let thick = DVec3::new(0.26, 0.20, 0.055);
        let thin = DVec3::new(0.20, 0.15, 0.04);
        let mut stack = |half: DVec3, angle, lift, cover| {
            put(
                Shape::Box { half, round: 0.008 },
                DMat3::from_rotation_z(angle),
                on_tray(-1.02, -0.14, lift),
                Texture::Book { half, cover },
                0.04,
            );
        };
        stack(thick, 1.25, thick.z, color(36, 74, 66));
        stack(thin, 0.75, 2.0 * thick.z + thin.z, color(138, 34, 42));
        let on_books = 2.0 * (thick.z + thin.z);
        let green = Texture::Globe {
            a: color(60, 130, 70),
            b: color(170, 206, 120),
        };
        put(
            ball(0.075),
            tilt,
            on_tray(-1.02, -0.14, on_books + 0.075),
            green,
            0.3,
        );

        // A tripod with a cross bar: thin parts that occlude little.
        let foot = on_tray(0.18, -1.06, 0.0);
        let apex = foot + DVec3::Z * 0.74;
        let mut rod = |a: DVec3, b: DVec3, radius| {
            put(
                Shape::Capsule {
                    half_length: a.distance(b) / 2.0,
                    radius,
                },
                DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, (b - a).normalize())),
                (a + b) / 2.0,
                Texture::Brass,
                0.25,
            );
        };
        let leg =
            |angle: f64| foot + DVec3::new(angle.cos(), angle.sin(), 0.0) * 0.26 + DVec3::Z * 0.014;
        for angle in [0.3, 2.4, 4.5] {
            rod(leg(angle), apex, 0.014);
        }
        let halfway = |angle| leg(angle).midpoint(apex);
        rod(halfway(0.3), halfway(2.4), 0.009);
        rod(halfway(2.4), halfway(4.5), 0.009);
        rod(halfway(4.5), halfway(0.3), 0.009);
        let knob = Texture::Globe {
            a: color(28, 92, 150),
            b: color(226, 226, 214),
        };
        put(ball(0.07), tilt, apex + DVec3::Z * 0.05, knob, 0.3);

        Self::of(bodies, DVec3::new(0.62, -0.48, 0.92))
    }

    /// Returns the indices of the bodies that rays from `apex` within the angle with this cosine
    /// around the unit `axis` may meet.
    pub(super) fn bodies_in_cone(&self, apex: DVec3, axis: DVec3, cos: f64) -> Vec<usize> {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let may_meet = |&i: &usize| self.bodies[i].solid.may_be_in_cone(apex, axis, cos, sin);
        (0..self.bodies.len()).filter(may_meet).collect()
    }

    /// Returns the distance along the unit `direction` from `origin` (inside the dome, above the
    /// floor, outside every body) to the first surface, and that surface. The scene is closed. Only
    /// the bodies `among` these are tried.
    pub(super) fn first_hit(
        &self,
        origin: DVec3,
        direction: DVec3,
        among: &[usize],
    ) -> (f64, Surface) {
        let b = origin.dot(direction);
        let c = origin.length_squared() - DOME_RADIUS * DOME_RADIUS;
        let mut hit = (-b + (b * b - c).max(0.0).sqrt(), Surface::Dome);
        if direction.z < 0.0 {
            let t = -origin.z / direction.z;
            if t < hit.0 {
                hit = (t, Surface::Floor);
            }
        }
        for &i in among {
            if let Some(t) = self.bodies[i].solid.hit(origin, direction, hit.0) {
                hit = (t, Surface::Body(i));
            }
        }
        hit
    }

    /// Returns the unit normal of a surface at one of its points, towards the inside of the scene.
    pub(super) fn normal(&self, surface: Surface, p: DVec3) -> DVec3 {
        match surface {
            Surface::Dome => -p / DOME_RADIUS,
            Surface::Floor => DVec3::Z,
            Surface::Body(i) => self.bodies[i].solid.normal(p),
        }
    }

    /// Returns the signed distance from `p` to the nearest surface; negative inside a body, below
    /// the floor and beyond the dome.
    pub(super) fn distance(&self, p: DVec3) -> f64 {
        let shell = p.z.min(DOME_RADIUS - p.length());
        self.bodies
            .iter()
            .map(|body| body.solid.distance(p))
            .fold(shell, f64::min)
    }

    /// Returns the light that falls on a point of a surface.
    pub(super) fn light(&self, surface: Surface, p: DVec3) -> Light {
        // The backdrop shines by itself.
        if surface == Surface::Dome {
            return Light::default();
        }
        let normal = self.normal(surface, p);
        let is_lit = normal.dot(self.to_sun) > 0.0;
        Light {
            openness: self.openness(surface, p, normal),
            sun: if is_lit {
                self.sun_visibility(surface, p)
            } else {
                0.0
            },
        }
    }

    /// Returns the linear colour at a point of a surface under `light`, seen along the unit
    /// `direction`.
    pub(super) fn radiance(
        &self,
        surface: Surface,
        p: DVec3,
        direction: DVec3,
        light: Light,
    ) -> DVec3 {
        match surface {
            Surface::Dome => Texture::Backdrop.albedo(p),
            Surface::Floor => {
                let fade = floor_fade(p);
                let horizon = horizon(p.y.atan2(p.x));
                if fade >= 1.0 {
                    return horizon;
                }
                let albedo = Texture::Planks.albedo(p);
                self.reflected(albedo, 0.04, DVec3::Z, direction, light)
                    .lerp(horizon, fade)
            }
            Surface::Body(i) => {
                let body = &self.bodies[i];
                let albedo = body.texture.albedo(body.solid.to_local(p));
                self.reflected(albedo, body.gloss, body.solid.normal(p), direction, light)
            }
        }
    }

    /// Reflects light by Lambert under sun and sky, with a Blinn-Phong highlight.
    fn reflected(
        &self,
        albedo: DVec3,
        gloss: f64,
        normal: DVec3,
        direction: DVec3,
        light: Light,
    ) -> DVec3 {
        let above = 0.5 + 0.5 * normal.z;
        let ambient = (SKY * above + BOUNCE * (1.0 - above)) * light.openness;
        let sun = SUN * (light.sun * normal.dot(self.to_sun).max(0.0));
        let half_way = (self.to_sun - direction).normalize();
        let highlight = gloss * normal.dot(half_way).max(0.0).powi(48);
        albedo * (ambient + sun) + sun * highlight
    }

    /// Returns the share of the sun's disc that a point sees.
    fn sun_visibility(&self, surface: Surface, p: DVec3) -> f64 {
        let mut visible = 1.0;
        for (i, body) in self.bodies.iter().enumerate() {
            if surface == Surface::Body(i) {
                continue;
            }
            if let Some(clearance) = body.solid.clearance(p, self.to_sun, SUN_SIZE) {
                visible *= super::noise::smoothstep(-SUN_SIZE, SUN_SIZE, clearance);
                if visible <= 0.0 {
                    break;
                }
            }
        }
        visible
    }

    /// Returns the ambient occlusion: how far bodies and floor stay off two points above the
    /// surface.
    fn openness(&self, surface: Surface, p: DVec3, normal: DVec3) -> f64 {
        const TAPS: [(f64, f64); 2] = [(0.07, 0.45), (0.30, 0.55)];
        let mut open = 1.0;
        for (reach, weight) in TAPS {
            let tap = p + normal * reach;
            let mut shade = |distance: f64| {
                open *= 1.0 - weight * (1.0 - distance / reach).clamp(0.0, 1.0);
            };
            if surface != Surface::Floor {
                shade(tap.z);
            }
            for (i, body) in self.bodies.iter().enumerate() {
                if surface != Surface::Body(i) && !body.solid.is_beyond(tap, reach) {
                    shade(body.solid.distance(tap));
                }
            }
        }
        open
    }
}
