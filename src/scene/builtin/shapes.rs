//! This module has solids as exact signed distances, and finds where rays meet them.

use glam::{DMat3, DVec2, DVec3};

/// A solid in its own frame, centred on the origin. `round` and `radius` are part of the outer
/// size: every measure is that of the finished solid.
#[derive(Clone, Copy, Debug)]
pub(super) enum Shape {
    Sphere {
        radius: f64,
    },
    /// An axis-aligned box whose edges are rounded.
    Box {
        half: DVec3,
        round: f64,
    },
    /// A cone frustum (a cylinder where both radii agree) along z whose edges are rounded.
    Frustum {
        bottom: f64,
        top: f64,
        half_height: f64,
        round: f64,
    },
    /// A rod along z with hemispherical ends.
    Capsule {
        half_length: f64,
        radius: f64,
    },
    /// A ring in the xy plane; the only solid here that is not convex.
    Torus {
        major: f64,
        minor: f64,
    },
}

impl Shape {
    /// Returns the signed distance to the surface (negative inside) and its gradient, the outward
    /// normal.
    #[inline(always)]
    fn distance(&self, p: DVec3) -> (f64, DVec3) {
        match *self {
            Shape::Sphere { radius } => {
                let length = p.length();
                (length - radius, p / length.max(f64::MIN_POSITIVE))
            }
            Shape::Box { half, round } => {
                let q = p.abs() - (half - DVec3::splat(round));
                let sign = DVec3::ONE.copysign(p);
                if q.max_element() > 0.0 {
                    let outside = q.max(DVec3::ZERO);
                    let length = outside.length();
                    (length - round, outside / length * sign)
                } else {
                    let axis = q.max_position();
                    let mut gradient = DVec3::ZERO;
                    gradient[axis] = sign[axis];
                    (q[axis] - round, gradient)
                }
            }
            Shape::Frustum {
                bottom,
                top,
                half_height,
                round,
            } => {
                let rho = DVec2::new(p.x, p.y).length();
                let (distance, g) = trapezoid(
                    DVec2::new(rho, p.z),
                    bottom - round,
                    top - round,
                    half_height - round,
                );
                let radial = DVec2::new(p.x, p.y) / rho.max(f64::MIN_POSITIVE) * g.x;
                (distance - round, radial.extend(g.y))
            }
            Shape::Capsule {
                half_length,
                radius,
            } => {
                let from_axis = p - DVec3::Z * p.z.clamp(-half_length, half_length);
                let length = from_axis.length();
                (length - radius, from_axis / length.max(f64::MIN_POSITIVE))
            }
            Shape::Torus { major, minor } => {
                let rho = DVec2::new(p.x, p.y).length().max(f64::MIN_POSITIVE);
                let on_circle = DVec3::new(p.x, p.y, 0.0) * (major / rho);
                let from_circle = p - on_circle;
                let length = from_circle.length();
                (length - minor, from_circle / length.max(f64::MIN_POSITIVE))
            }
        }
    }

    /// Returns half the size of the box around the solid.
    fn half_extent(&self) -> DVec3 {
        match *self {
            Shape::Sphere { radius } => DVec3::splat(radius),
            Shape::Box { half, .. } => half,
            Shape::Frustum {
                bottom,
                top,
                half_height,
                ..
            } => DVec3::new(bottom.max(top), bottom.max(top), half_height),
            Shape::Capsule {
                half_length,
                radius,
            } => DVec3::new(radius, radius, half_length + radius),
            Shape::Torus { major, minor } => DVec3::new(major + minor, major + minor, minor),
        }
    }

    /// Returns the radius of a sphere around the origin that holds the solid.
    fn bounding_radius(&self) -> f64 {
        match *self {
            Shape::Frustum {
                bottom,
                top,
                half_height,
                ..
            } => bottom.max(top).hypot(half_height),
            Shape::Torus { major, minor } => major + minor,
            Shape::Box { half, .. } => half.length(),
            _ => self.half_extent().max_element(),
        }
    }
}

/// Returns the signed distance and gradient in the half plane (rho, z) of the trapezoid with half
/// height `h`, radius `bottom` at `-h` and `top` at `h`.
fn trapezoid(p: DVec2, bottom: f64, top: f64, h: f64) -> (f64, DVec2) {
    let beyond_end = p.y.abs() - h;
    let end_normal = DVec2::new(0.0, 1f64.copysign(p.y));
    let end_radius = if p.y > 0.0 { top } else { bottom };
    if beyond_end > 0.0 && p.x <= end_radius {
        return (beyond_end, end_normal);
    }
    let slant = DVec2::new(top - bottom, 2.0 * h);
    let length = slant.length();
    let normal = DVec2::new(slant.y, -slant.x) / length;
    let from_foot = p - DVec2::new(bottom, -h);
    let beyond_slant = normal.dot(from_foot);
    if beyond_slant <= 0.0 && beyond_end <= 0.0 {
        return if beyond_slant > beyond_end {
            (beyond_slant, normal)
        } else {
            (beyond_end, end_normal)
        };
    }
    let along = from_foot.dot(slant) / (length * length);
    if (0.0..=1.0).contains(&along) {
        return (beyond_slant, normal);
    }
    let corner = if along > 1.0 { slant } else { DVec2::ZERO };
    let off = from_foot - corner;
    let distance = off.length();
    (distance, off / distance.max(f64::MIN_POSITIVE))
}

/// A shape at its place in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solid {
    shape: Shape,
    /// Local to world.
    rotation: DMat3,
    position: DVec3,
    bounding_radius: f64,
    /// The solid lies between `position.z` plus and minus this.
    half_height: f64,
}

/// Rays end here: nearer to a surface than this is on it.
const ON_SURFACE: f64 = 1e-13;

impl Solid {
    pub(super) fn new(shape: Shape, rotation: DMat3, position: DVec3) -> Self {
        let up = rotation.row(2).abs();
        Self {
            shape,
            rotation,
            position,
            bounding_radius: shape.bounding_radius(),
            half_height: up.dot(shape.half_extent()),
        }
    }

    /// Returns a world point in the solid's own frame.
    pub(super) fn to_local(self, p: DVec3) -> DVec3 {
        self.rotation.transpose() * (p - self.position)
    }

    /// Returns the signed distance from a world point to the surface, negative inside.
    pub(super) fn distance(&self, p: DVec3) -> f64 {
        self.shape.distance(self.to_local(p)).0
    }

    /// Returns the outward unit normal at a world point of the surface.
    pub(super) fn normal(&self, p: DVec3) -> DVec3 {
        self.rotation * self.shape.distance(self.to_local(p)).1
    }

    /// Returns whether a ray from `apex` within the angle with this cosine and sine around the unit
    /// `axis` may meet the solid; may say yes too often.
    pub(super) fn may_be_in_cone(&self, apex: DVec3, axis: DVec3, cos: f64, sin: f64) -> bool {
        let to_center = self.position - apex;
        let along = to_center.dot(axis);
        let off = (to_center.length_squared() - along * along).max(0.0).sqrt();
        // Distance of the centre from the cone's flank.
        off * cos - along * sin <= self.bounding_radius
    }

    /// Returns whether nothing of the solid is within `reach` of `p`; may say no too often.
    pub(super) fn is_beyond(&self, p: DVec3, reach: f64) -> bool {
        let limit = self.bounding_radius + reach;
        self.position.distance_squared(p) > limit * limit
    }

    /// Returns the first `t` in `0..t_max` at which `origin + t * direction` (unit) meets the
    /// surface from outside.
    pub(super) fn hit(&self, origin: DVec3, direction: DVec3, t_max: f64) -> Option<f64> {
        let to_center = self.position - origin;
        let t_center = to_center.dot(direction);
        let half_chord2 =
            self.bounding_radius.powi(2) - (to_center.length_squared() - t_center * t_center);
        if half_chord2 <= 0.0 {
            return None;
        }
        let half_chord = half_chord2.sqrt();
        let mut start = (t_center - half_chord).max(0.0);
        let mut end = (t_center + half_chord).min(t_max);
        // Between the solid's lowest and highest point, a bit wider for rounding's sake.
        if direction.z.abs() > 1e-6 {
            let middle = to_center.z / direction.z;
            let half = (self.half_height + 1e-9) / direction.z.abs();
            start = start.max(middle - half);
            end = end.min(middle + half);
        }
        if start >= end {
            return None;
        }
        let o = self.to_local(origin);
        let d = self.rotation.transpose() * direction;
        let t = match self.shape {
            // Its bounding sphere is the sphere.
            Shape::Sphere { .. } => Some(start),
            Shape::Torus { .. } => self.hit_by_marching(o, d, start, end),
            _ => self.hit_by_newton(o, d, start, end),
        }?;
        (t < t_max).then_some(t)
    }

    /// Finds the hit by Newton's method. The distance to a convex solid is convex along a ray, so
    /// Newton's steps from outside never pass the surface, and a rising distance means a miss.
    fn hit_by_newton(&self, o: DVec3, d: DVec3, start: f64, end: f64) -> Option<f64> {
        let mut t = start;
        for _ in 0..64 {
            let (distance, gradient) = self.shape.distance(o + d * t);
            if distance <= ON_SURFACE {
                return Some(t);
            }
            let slope = gradient.dot(d);
            if slope >= 0.0 {
                return None;
            }
            t -= distance / slope;
            if t > end {
                return None;
            }
        }
        // Only a tangent ray converges this slowly.
        None
    }

    /// Steps by the distance, then bisects the step that went inside.
    fn hit_by_marching(&self, o: DVec3, d: DVec3, start: f64, end: f64) -> Option<f64> {
        const MIN_STEP: f64 = 2e-3;
        let (mut outside, mut t) = (start, start);
        while t < end {
            let distance = self.shape.distance(o + d * t).0;
            if distance > 0.0 {
                outside = t;
                t += distance.max(MIN_STEP);
                continue;
            }
            let mut inside = t;
            while inside - outside > ON_SURFACE * 10.0 {
                let middle = 0.5 * (outside + inside);
                if self.shape.distance(o + d * middle).0 > 0.0 {
                    outside = middle;
                } else {
                    inside = middle;
                }
            }
            return Some(outside);
        }
        None
    }

    /// Returns how far the solid stays clear of the ray from `p` towards a light: the least
    /// `distance / t`, about the tangent of the angle between the light and the silhouette;
    /// negative where the ray enters. `None` where it is certainly above `wide`.
    pub(super) fn clearance(&self, p: DVec3, to_light: DVec3, wide: f64) -> Option<f64> {
        if p.z >= self.position.z + self.half_height {
            return None;
        }
        let to_center = self.position - p;
        let t_center = to_center.dot(to_light);
        let farthest = t_center + self.bounding_radius;
        if farthest <= 0.0 {
            return None;
        }
        let miss2 = to_center.length_squared() - t_center * t_center;
        let reach = self.bounding_radius + wide * farthest;
        if miss2 > reach * reach {
            return None;
        }
        let o = self.to_local(p);
        let d = self.rotation.transpose() * to_light;
        let ratio = |t: f64| self.shape.distance(o + d * t).0 / t;
        let nearest = (t_center - self.bounding_radius).max(1e-3);
        Some(match self.shape {
            // Close to the least ratio for a light as small as the sun.
            Shape::Sphere { .. } => ratio(t_center.max(1e-3)),
            // Not unimodal: the best of an even grid, refined around.
            Shape::Torus { .. } => {
                const STEPS: u32 = 20;
                let step = (farthest - nearest) / f64::from(STEPS);
                let mut best = (f64::INFINITY, nearest);
                for i in 0..=STEPS {
                    let t = nearest + step * f64::from(i);
                    best = if ratio(t) < best.0 {
                        (ratio(t), t)
                    } else {
                        best
                    };
                }
                golden_minimum(ratio, (best.1 - step).max(1e-3), best.1 + step)
            }
            // A convex function over t is quasi-convex.
            _ => golden_minimum(ratio, nearest, farthest.max(nearest + 1e-3)),
        })
    }
}

/// Returns the least value of a unimodal function over `low..high` by golden-section search.
fn golden_minimum(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let mut a = high - GOLDEN * (high - low);
    let mut b = low + GOLDEN * (high - low);
    let (mut fa, mut fb) = (f(a), f(b));
    for _ in 0..10 {
        if fa < fb {
            (high, b, fb) = (b, a, fa);
            a = high - GOLDEN * (high - low);
            fa = f(a);
        } else {
            (low, a, fa) = (a, b, fb);
            b = low + GOLDEN * (high - low);
            fb = f(b);
        }
    }
    fa.min(fb)
}
