//! Lens distortion, and the pinhole camera that an undistorted image has.

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

/// Distortion of Brown and Conrady, as OpenCV and COLMAP's `OPENCV` have it. With `x`, `y` the
/// coordinates on the plane at depth 1 and `r^2 = x^2 + y^2`:
///
/// ```text
/// x' = x (1 + k1 r^2 + k2 r^4) + 2 p1 x y + p2 (r^2 + 2 x^2)
/// y' = y (1 + k1 r^2 + k2 r^4) + 2 p2 x y + p1 (r^2 + 2 y^2)
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Distortion {
    k1: f64,
    k2: f64,
    p1: f64,
    p2: f64,
}

impl Distortion {
    /// From `[k1, k2, p1, p2]`; `None` where all are 0. Values that are not finite are refused.
    pub fn new(coefficients: [f64; 4]) -> Result<Option<Distortion>> {
        if let Some(bad) = coefficients.iter().find(|k| !k.is_finite()) {
            return Err(Error::new(format!(
                "distortion coefficient {bad} is not finite"
            )));
        }
        let [k1, k2, p1, p2] = coefficients;
        let none = coefficients.iter().all(|k| *k == 0.0);
        Ok((!none).then_some(Distortion { k1, k2, p1, p2 }))
    }

    pub fn distort(&self, p: DVec2) -> DVec2 {
        let Self { k1, k2, p1, p2 } = *self;
        let r2 = p.length_squared();
        let xy = p.x * p.y;
        let radial = 1.0 + r2 * (k1 + r2 * k2);
        p * radial
            + DVec2::new(
                2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x),
                2.0 * p2 * xy + p1 * (r2 + 2.0 * p.y * p.y),
            )
    }

    fn jacobian(&self, p: DVec2) -> DMat2 {
        let Self { k1, k2, p1, p2 } = *self;
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * k2);
        let slope = 2.0 * (k1 + 2.0 * r2 * k2);
        let mixed = p.x * p.y * slope + 2.0 * (p1 * p.x + p2 * p.y);
        DMat2::from_cols(
            DVec2::new(
                radial + p.x * p.x * slope + 2.0 * p1 * p.y + 6.0 * p2 * p.x,
                mixed,
            ),
            DVec2::new(
                mixed,
                radial + p.y * p.y * slope + 6.0 * p1 * p.y + 2.0 * p2 * p.x,
            ),
        )
    }

    /// Where the model is one-to-one on the way from the centre, the point that is distorted to
    /// `goal`.
    fn undistort(&self, goal: DVec2) -> Option<DVec2> {
        let mut p = DVec2::ZERO;
        for step in 1..=STEPS {
            let before = p;
            p = self.newton(before, goal * (f64::from(step) / f64::from(STEPS)))?;
            let is_open = |k: i32| {
                let between = before.lerp(p, f64::from(k) / 4.0);
                self.jacobian(between).determinant() > 0.0
            };
            if !(1..=4).all(is_open) {
                return None;
            }
        }
        Some(p)
    }

    /// Newton's method from `start`.
    fn newton(&self, start: DVec2, goal: DVec2) -> Option<DVec2> {
        let mut p = start;
        for _ in 0..20 {
            let residual = self.distort(p) - goal;
            if residual.length() <= 1e-12 * (1.0 + goal.length()) {
                return Some(p);
            }
            let jacobian = self.jacobian(p);
            let is_open = jacobian.determinant() > 0.0;
            if !is_open {
                return None;
            }
            p -= jacobian.inverse() * residual;
        }
        None
    }
}

/// The camera of a distorted image once it is undistorted. Focal lengths and pose stay, so that
/// the centre keeps its resolution; the image is bounded by the innermost point of each side of
/// the undistorted photograph, so that every pixel of it was photographed.
///
/// # Errors
///
/// A model that folds the image onto itself, or leaves next to nothing of it.
pub(super) fn pinhole(camera: &Camera, distortion: &Distortion) -> Result<Camera> {
    let impossible = |what: &str| {
        let Distortion { k1, k2, p1, p2 } = distortion;
        Error::new(format!("the distortion {k1} {k2} {p1} {p2} {what}"))
            .way_out("calibrate again, or undistort with `colmap image_undistorter`")
    };
    let (low, high) = inner_rectangle(camera, distortion);
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

/// Points around the border of a camera's image, pixels.
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

/// Corners of the undistorted image, in pixels from the principal point; without a bound where no
/// point of a side can be undistorted.
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

/// Whether the distortion is one-to-one on the pinhole image and takes it into the photograph.
fn is_covered(pinhole: &Camera, camera: &Camera, distortion: &Distortion) -> bool {
    let (focal, principal) = lens(camera);
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let center = DVec2::new(pinhole.cx, pinhole.cy);
    border(pinhole).flatten().all(|p| {
        let ray = (p - center) / focal;
        let seen = distortion.distort(ray) * focal + principal;
        let is_open = |step| {
            let between = ray * (f64::from(step) / f64::from(STEPS));
            distortion.jacobian(between).determinant() > 0.0
        };
        seen.cmpge(DVec2::splat(-BORDER_SLACK)).all()
            && seen.cmple(size + BORDER_SLACK).all()
            && (1..=STEPS).all(is_open)
    })
}

/// Focal lengths and principal point, pixels.
fn lens(camera: &Camera) -> (DVec2, DVec2) {
    (
        DVec2::new(camera.fx, camera.fy),
        DVec2::new(camera.cx, camera.cy),
    )
}

/// Whole pixels between `low` and `high`, of an image that had `pixels`, and where they begin.
fn side(pixels: u32, low: f64, high: f64) -> Option<(u32, f64)> {
    let bound = MAX_SCALE * f64::from(pixels);
    let whole = (high - low + PIXEL_SLACK).floor().min(bound);
    let begin = low + 0.5 * (high - low - whole);
    (whole >= 1.0 && whole >= MIN_SCALE * f64::from(pixels)).then_some((whole as u32, begin))
}
