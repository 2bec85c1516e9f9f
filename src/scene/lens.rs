//! This module has lens distortion, and finds the pinhole camera that an undistorted image has.

use glam::{DMat2, DVec2};

use crate::camera::Camera;
use crate::error::{Error, Result};

/// Points on each side of an image whose undistorted places bound the pinhole image.
const BORDER_SAMPLES: u32 = 128;

/// Steps from the centre outwards in which a point is undistorted: each starts from the one
/// before, so that no fold of the model is jumped.
const STEPS: u32 = 16;

/// A pinhole image is at most this many times as wide and as high as its photograph, and at
/// least a fifth (COLMAP's bounds).
const MAX_SCALE: f64 = 2.0;
const MIN_SCALE: f64 = 0.2;

/// The border is known from samples: a pixel's tenth beyond it is no fault.
const BORDER_SLACK: f64 = 0.1;

/// Lengths are rounded down to whole pixels once they miss the next one by more than this.
const PIXEL_SLACK: f64 = 0.01;

/// A pinhole image of a fisheye photograph reaches this far to each side of the optical axis,
/// `tan` of 55 degrees: towards 90 degrees it would grow without end, and all of it be stretched.
const MAX_SLOPE: f64 = 1.428_148_006_742_114_4;

/// Points on a side of the grid that measures how much of a photograph a pinhole image shows.
const GRID: u32 = 48;

/// What a lens makes of a ray, as OpenCV and COLMAP have it. With `x`, `y` the coordinates on the
/// plane at depth 1 or, of a `fisheye`, these times `atan(r) / r`, and `s = x^2 + y^2`:
///
/// ```text
/// x' = x R + 2 p1 x y + p2 (s + 2 x^2) + sx s     R = (1 + k1 s + k2 s^2 + k3 s^3 + k4 s^4)
/// y' = y R + 2 p2 x y + p1 (s + 2 y^2) + sy s         / (1 + d1 s + d2 s^2 + d3 s^3)
/// ```
///
/// COLMAP's OPENCV has `k1 k2 p1 p2`; `FULL_OPENCV` also `k3` and the `d`; the fisheye models
/// `k1` to `k4`, and `THIN_PRISM_FISHEYE` also `p` and `s`. The default is no distortion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Distortion {
    pub fisheye: bool,
    /// `k1` to `k4`.
    pub radial: [f64; 4],
    /// `d1` to `d3`.
    pub denominator: [f64; 3],
    /// `p1`, `p2`.
    pub tangential: [f64; 2],
    /// `sx`, `sy`.
    pub prism: [f64; 2],
}

impl Distortion {
    /// Takes OpenCV's first four coefficients, `[k1, k2, p1, p2]`.
    pub(crate) fn opencv([k1, k2, p1, p2]: [f64; 4]) -> Distortion {
        Distortion {
            radial: [k1, k2, 0.0, 0.0],
            tangential: [p1, p2],
            ..Distortion::default()
        }
    }

    /// Takes OpenCV's fisheye model with `[k1, k2, k3, k4]`.
    pub(crate) fn fisheye(radial: [f64; 4]) -> Distortion {
        Distortion {
            fisheye: true,
            radial,
            ..Distortion::default()
        }
    }

    /// Returns the distortion, or `None` if it leaves every ray as it is. Coefficients that are not
    /// finite are refused.
    pub(crate) fn checked(self) -> Result<Option<Distortion>> {
        if let Some(bad) = self.coefficients().find(|k| !k.is_finite()) {
            return Err(Error::new(format!(
                "distortion coefficient {bad} is not finite"
            )));
        }
        let distorts = self.fisheye || self.coefficients().any(|k| k != 0.0);
        Ok(distorts.then_some(self))
    }

    fn coefficients(&self) -> impl Iterator<Item = f64> {
        let Distortion {
            radial,
            denominator,
            tangential,
            prism,
            ..
        } = *self;
        let (radial, ends) = (radial.into_iter(), tangential.into_iter().chain(prism));
        radial.chain(denominator).chain(ends)
    }

    /// Returns the place at which the ray through `p` on the plane at depth 1 ends.
    pub(crate) fn distort(&self, p: DVec2) -> DVec2 {
        let q = self.bent(p);
        let [p1, p2] = self.tangential;
        let r2 = q.length_squared();
        let xy = q.x * q.y;
        q * self.gain(r2).0
            + DVec2::new(
                2.0 * p1 * xy + p2 * (r2 + 2.0 * q.x * q.x),
                2.0 * p2 * xy + p1 * (r2 + 2.0 * q.y * q.y),
            )
            + r2 * DVec2::from(self.prism)
    }

    /// Returns the coordinates that the polynomials take: a fisheye's grow with the angle of the
    /// ray.
    fn bent(&self, p: DVec2) -> DVec2 {
        let r = p.length();
        if self.fisheye && r > 0.0 {
            p * (r.atan() / r)
        } else {
            p
        }
    }

    /// Undoes [`Distortion::bent`]; none where the ray does not go forward.
    fn straight(&self, q: DVec2) -> Option<DVec2> {
        let angle = q.length();
        if !self.fisheye || angle == 0.0 {
            return Some(q);
        }
        (angle < std::f64::consts::FRAC_PI_2).then(|| q * (angle.tan() / angle))
    }

    /// Returns `R` of the definition, and its derivative by `s`.
    fn gain(&self, s: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.radial;
        let [d1, d2, d3] = self.denominator;
        let above = 1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)));
        let above_slope = k1 + s * (2.0 * k2 + s * (3.0 * k3 + s * 4.0 * k4));
        let below = 1.0 + s * (d1 + s * (d2 + s * d3));
        let below_slope = d1 + s * (2.0 * d2 + s * 3.0 * d3);
        // A denominator that passes 0 tears the image: it counts as folded.
        if below <= 0.0 {
            return (f64::NAN, f64::NAN);
        }
        let gain = above / below;
        (gain, (above_slope - gain * below_slope) / below)
    }

    /// Returns the derivatives of `x'`, `y'` by the coordinates that the polynomials take.
    fn jacobian(&self, q: DVec2) -> DMat2 {
        let ([p1, p2], [sx, sy]) = (self.tangential, self.prism);
        let (radial, slope) = self.gain(q.length_squared());
        let slope = 2.0 * slope;
        let mixed = q.x * q.y * slope + 2.0 * (p1 * q.x + p2 * q.y);
        DMat2::from_cols(
            DVec2::new(
                radial + q.x * q.x * slope + 2.0 * p1 * q.y + 6.0 * p2 * q.x + 2.0 * sx * q.x,
                mixed + 2.0 * sy * q.x,
            ),
            DVec2::new(
                mixed + 2.0 * sx * q.y,
                radial + q.y * q.y * slope + 6.0 * p1 * q.y + 2.0 * p2 * q.x + 2.0 * sy * q.y,
            ),
        )
    }

    /// Returns, if the model is one-to-one on the way from the centre, the point on the plane at
    /// depth 1 that is distorted to `goal`.
    fn undistort(&self, goal: DVec2) -> Option<DVec2> {
        let mut q = DVec2::ZERO;
        for step in 1..=STEPS {
            let before = q;
            q = self.newton(before, goal * (f64::from(step) / f64::from(STEPS)))?;
            let is_open = |k: i32| {
                let between = before.lerp(q, f64::from(k) / 4.0);
                self.jacobian(between).determinant() > 0.0
            };
            if !(1..=4).all(is_open) {
                return None;
            }
        }
        self.straight(q)
    }

    /// Applies Newton's method from `start`, in the coordinates that the polynomials take.
    fn newton(&self, start: DVec2, goal: DVec2) -> Option<DVec2> {
        let unbent = Distortion {
            fisheye: false,
            ..*self
        };
        let mut q = start;
        for _ in 0..20 {
            let residual = unbent.distort(q) - goal;
            if residual.length() <= 1e-12 * (1.0 + goal.length()) {
                return Some(q);
            }
            let jacobian = self.jacobian(q);
            let is_open = jacobian.determinant() > 0.0;
            if !is_open {
                return None;
            }
            q -= jacobian.inverse() * residual;
        }
        None
    }
}

/// Finds the camera of a distorted image once it is undistorted. Focal lengths and pose stay, so
/// that the centre keeps its resolution; the image is bounded by the innermost point of each side
/// of the undistorted photograph, so that every pixel of it was photographed, and a fisheye's by
/// [`MAX_SLOPE`], too.
///
/// # Errors
///
/// A model that folds the image onto itself, or leaves next to nothing of it.
pub(super) fn pinhole(camera: &Camera, distortion: &Distortion) -> Result<Camera> {
    let impossible = |what: &str| {
        let all: Vec<String> = distortion.coefficients().map(|k| k.to_string()).collect();
        // Those behind the last that is not 0 are of models that have more.
        let n = all
            .iter()
            .rposition(|k| k != "0")
            .map_or(1, |last| last + 1);
        Error::new(format!("the distortion {} {what}", all[..n].join(" ")))
            .way_out("calibrate again, or undistort with `colmap image_undistorter`")
    };
    let (mut low, mut high) = inner_rectangle(camera, distortion);
    if distortion.fisheye {
        let (focal, _) = lens(camera);
        low = low.max(-MAX_SLOPE * focal);
        high = high.min(MAX_SLOPE * focal);
    }
    let (width, left) = side(camera.width, low.x, high.x)
        .ok_or_else(|| impossible("leaves less than a fifth of the width"))?;
    let (height, top) = side(camera.height, low.y, high.y)
        .ok_or_else(|| impossible("leaves less than a fifth of the height"))?;
    let undistorted = Camera {
        width,
        height,
        cx: -left,
        cy: -top,
        ..camera.clone()
    };
    if !is_covered(&undistorted, camera, distortion) {
        return Err(impossible("folds the image onto itself"));
    }
    Ok(undistorted)
}

/// Returns points around the border of a camera's image, pixels.
fn border(camera: &Camera) -> impl Iterator<Item = [DVec2; 4]> {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    (0..=BORDER_SAMPLES).map(move |i| {
        let along = size * (f64::from(i) / f64::from(BORDER_SAMPLES));
        [
            DVec2::new(0.0, along.y),
            DVec2::new(size.x, along.y),
            DVec2::new(along.x, 0.0),
            DVec2::new(along.x, size.y),
        ]
    })
}

/// Returns the corners of the undistorted image, in pixels from the principal point; without a
/// bound where no point of a side can be undistorted.
fn inner_rectangle(camera: &Camera, distortion: &Distortion) -> (DVec2, DVec2) {
    let (focal, principal) = lens(camera);
    let (mut low, mut high) = (DVec2::MIN, DVec2::MAX);
    for sides in border(camera) {
        let [left, right, top, bottom] =
            sides.map(|p| Some(distortion.undistort((p - principal) / focal)? * focal));
        low.x = left.map_or(low.x, |p| low.x.max(p.x));
        high.x = right.map_or(high.x, |p| high.x.min(p.x));
        low.y = top.map_or(low.y, |p| low.y.max(p.y));
        high.y = bottom.map_or(high.y, |p| high.y.min(p.y));
    }
    (low, high)
}

/// Returns whether the distortion is one-to-one on the pinhole image and takes it into the
/// photograph.
fn is_covered(pinhole: &Camera, camera: &Camera, distortion: &Distortion) -> bool {
    let (focal, principal) = lens(camera);
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let center = DVec2::new(pinhole.cx, pinhole.cy);
    border(pinhole).flatten().all(|p| {
        let ray = (p - center) / focal;
        let seen = distortion.distort(ray) * focal + principal;
        let is_open = |step| {
            let between = ray * (f64::from(step) / f64::from(STEPS));
            distortion.jacobian(distortion.bent(between)).determinant() > 0.0
        };
        seen.cmpge(DVec2::splat(-BORDER_SLACK)).all()
            && seen.cmple(size + BORDER_SLACK).all()
            && (1..=STEPS).all(is_open)
    })
}

/// Returns the share of a photograph's area that its pinhole image shows.
pub(super) fn shown(camera: &Camera, distortion: &Distortion, pinhole: &Camera) -> f64 {
    let (focal, principal) = lens(camera);
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let end = DVec2::new(f64::from(pinhole.width), f64::from(pinhole.height));
    let center = DVec2::new(pinhole.cx, pinhole.cy);
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
    let cells = (0..GRID).flat_map(|y| (0..GRID).map(move |x| DVec2::new(at(x), at(y))));
    let is_shown = |cell: &DVec2| {
        let ray = distortion.undistort((*cell * size - principal) / focal);
        let seen = ray.map(|ray| ray * focal + center);
        seen.is_some_and(|p| p.cmpge(DVec2::ZERO).all() && p.cmple(end).all())
    };
    cells.filter(is_shown).count() as f64 / f64::from(GRID * GRID)
}

/// Returns focal lengths and principal point, pixels.
fn lens(camera: &Camera) -> (DVec2, DVec2) {
    (
        DVec2::new(camera.fx, camera.fy),
        DVec2::new(camera.cx, camera.cy),
    )
}

/// Returns the number of whole pixels between `low` and `high` of an image that had `pixels`, and
/// where they begin.
fn side(pixels: u32, low: f64, high: f64) -> Option<(u32, f64)> {
    let bound = MAX_SCALE * f64::from(pixels);
    let whole = (high - low + PIXEL_SLACK).floor().min(bound);
    let begin = low + 0.5 * (high - low - whole);
    (whole >= 1.0 && whole >= MIN_SCALE * f64::from(pixels)).then_some((whole as u32, begin))
}
