//! Pinhole cameras: world-to-camera poses, +z forward, y down, pixel centres at +0.5.

pub mod compass;
pub mod json;
pub mod path;
mod similarity;

pub use similarity::Similarity;

use std::ops::RangeInclusive;

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::error::{Error, Result};

/// A posed pinhole camera: `p_camera = rotation * p_world + translation`,
/// `u = fx * x / z + cx`, `v = fy * y / z + cy` in pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The view's name: its image's file name, or `virtual_000`.
    pub name: String,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, pixels from the image's left edge.
    pub cx: f64,
    /// Principal point, pixels from the image's top edge.
    pub cy: f64,
    /// World-to-camera rotation.
    pub rotation: DMat3,
    /// World-to-camera translation, world units.
    pub translation: DVec3,
}

/// The distance between two poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Angle between the orientations, radians.
    pub turn: f64,
    /// Distance between the optical centres.
    pub shift: f64,
}

impl Camera {
    /// Returns the optical centre in the world, `o = -R^T t`.
    pub fn center(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// Returns the unit viewing direction in the world (the camera's +z).
    pub fn forward(&self) -> DVec3 {
        self.rotation.row(2)
    }

    /// Returns the unit up direction in the world (the camera's -y).
    pub fn up(&self) -> DVec3 {
        -self.rotation.row(1)
    }

    /// Returns the geometric mean of the focal lengths, pixels.
    pub fn mean_focal(&self) -> f64 {
        (self.fx * self.fy).sqrt()
    }

    /// Returns the place in the image that a point of the world falls on, pixels, and its depth,
    /// world units. The place means nothing unless the depth is positive.
    pub fn project(&self, p: DVec3) -> (DVec2, f64) {
        let q = self.rotation * p + self.translation;
        let pixel = DVec2::new(self.fx * q.x / q.z + self.cx, self.fy * q.y / q.z + self.cy);
        (pixel, q.z)
    }

    /// Returns how far the pose is from another camera's.
    pub fn difference(&self, other: &Camera) -> Motion {
        let [a, b] = [self, other].map(|camera| DQuat::from_mat3(&camera.rotation));
        Motion {
            turn: a.angle_between(b),
            shift: self.center().distance(other.center()),
        }
    }

    /// Returns a camera at `eye` that looks at `target` with `up` (world, any length) upwards in
    /// the image, and the intrinsics of `self`. `up` must not be parallel to the viewing direction.
    pub fn looking_at(&self, name: String, eye: DVec3, target: DVec3, up: DVec3) -> Camera {
        let z = (target - eye).normalize();
        let x = z.cross(up).normalize();
        let y = z.cross(x);
        let rotation = DMat3::from_cols(x, y, z).transpose();
        Camera {
            name,
            rotation,
            translation: -(rotation * eye),
            ..self.clone()
        }
    }

    /// Returns the camera after the motion `(w, v)`: what lies at `p` in its axes lies at
    /// `exp([w]x) p + v` afterwards. So what it sees turns by `w` (radians) about the optical
    /// centre and then shifts by `v` (world units, along the camera's axes); in the world the
    /// camera moves the other way.
    pub fn moved(&self, [x, y, z, shift @ ..]: [f64; 6]) -> Camera {
        let turn = DQuat::from_scaled_axis(DVec3::new(x, y, z));
        let rotation = DQuat::from_mat3(&self.rotation);
        Camera {
            // Through a unit quaternion, so that no number of motions distorts it.
            rotation: DMat3::from_quat((turn * rotation).normalize()),
            translation: turn * self.translation + DVec3::from_array(shift),
            ..self.clone()
        }
    }

    /// Returns the same camera for an image of another size, pixels; intrinsics scale with it.
    pub fn resized(&self, width: u32, height: u32) -> Camera {
        let (sx, sy) = (
            f64::from(width) / f64::from(self.width),
            f64::from(height) / f64::from(self.height),
        );
        Camera {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
            ..self.clone()
        }
    }

    /// Returns the same camera for an image whose longer side is at most `px`.
    pub fn at_most(&self, px: u32) -> Camera {
        let size = (self.width, self.height);
        let (width, height) = bounded_size(size, self.width.max(self.height), px);
        self.resized(width, height)
    }
}

/// Largest entry of `R^T R - I` that is taken for rounding: files hold few digits.
const ROTATION_TOLERANCE: f64 = 1e-3;
/// Up to here, which is f32's rounding, a matrix is taken as it is, so that what was written is
/// read.
const ROUNDING: f64 = 3e-7;

/// Returns the rotation that a matrix from a file stands for; `None` if it is no rotation.
pub fn nearest_rotation(matrix: DMat3) -> Option<DMat3> {
    let error = matrix.transpose() * matrix - DMat3::IDENTITY;
    let within = |bound| error.to_cols_array().iter().all(|v| v.abs() <= bound);
    if !within(ROTATION_TOLERANCE) || matrix.determinant() < 0.0 {
        return None;
    }
    Some(if within(ROUNDING) {
        matrix
    } else {
        DMat3::from_quat(DQuat::from_mat3(&matrix).normalize())
    })
}

/// Focal lengths that are accepted, pixels; beyond these, scaled images and squares in f32 lose
/// them.
const FOCAL_LENGTHS: RangeInclusive<f64> = 1e-3..=1e9;
/// Largest distance of the principal point from the image's corner along an axis, pixels.
const MAX_PRINCIPAL: f64 = 1e9;

/// Checks the focal lengths `[fx, fy]` and the principal point `[cx, cy]`, pixels.
///
/// # Errors
/// One of them is a value that no lens has, such as NaN: names it and what is allowed.
pub fn check_lens(focal: [f64; 2], principal: [f64; 2]) -> Result<()> {
    for (key, value) in ["fx", "fy"].iter().zip(focal) {
        if !FOCAL_LENGTHS.contains(&value) {
            let (least, most) = (FOCAL_LENGTHS.start(), FOCAL_LENGTHS.end());
            return Err(Error::new(format!(
                "the focal length {key} is {value:e} pixels, allowed are {least:e} to {most:e}"
            )));
        }
    }
    for (key, value) in ["cx", "cy"].iter().zip(principal) {
        if !(-MAX_PRINCIPAL..=MAX_PRINCIPAL).contains(&value) {
            return Err(Error::new(format!(
                "the principal point {key} is {value:e} pixels, allowed are at most \
                 {MAX_PRINCIPAL:e}"
            )));
        }
    }
    Ok(())
}

/// Returns a size scaled so that `side`, one of its lengths, comes down to `bound`; the size itself
/// if `side` is within. The other length is rounded to the nearest pixel and at least 1.
pub fn bounded_size((width, height): (u32, u32), side: u32, bound: u32) -> (u32, u32) {
    if side <= bound {
        return (width, height);
    }
    let scaled = |length: u32| {
        let exact = u64::from(length) * u64::from(bound);
        let rounded = (2 * exact + u64::from(side)) / (2 * u64::from(side));
        (rounded as u32).max(1)
    };
    (scaled(width), scaled(height))
}

/// A similarity without rotation that takes the scene's own frame to the canonical one, in which
/// the focus is the origin and the sphere's radius is 1: `x' = (x - center) / radius`.
///
/// Everything on the GPU lives in the canonical frame, so no constant there depends on the
/// scene's unit or on where its origin lies. Directions, and so SH, are the same in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Centre of the sphere, which is the focus, in the scene's own frame.
    pub center: DVec3,
    /// Radius `R` of the sphere, world units.
    pub radius: f64,
    /// The scene's extent, at most `radius`, world units:
    /// [`Focus::extent`](crate::field::Focus::extent).
    pub extent: f64,
}

/// Rounding of stored positions that is allowed, as a share of the radius.
const MAX_ROUNDING: f64 = 1e-5;

impl Frame {
    /// The frame of a scene that is canonical as it is.
    pub const IDENTITY: Frame = Frame {
        center: DVec3::ZERO,
        radius: 1.0,
        extent: 1.0,
    };

    /// Returns the near plane, in canonical units, that lies at a `share` of the scene's extent.
    /// The extent counts and not `R`, so that one camera far away does not clip what the others
    /// see.
    pub fn near(&self, share: f64) -> f64 {
        share * (self.extent / self.radius)
    }

    /// Takes a position from the scene's own frame to the canonical one.
    pub fn to_canonical(&self, p: DVec3) -> DVec3 {
        (p - self.center) / self.radius
    }

    /// Takes a position from the canonical frame to the scene's own.
    pub fn to_world(&self, p: DVec3) -> DVec3 {
        p * self.radius + self.center
    }

    /// Returns what is taken out of positions before they are stored in f32: zero, and so nothing,
    /// if the scene lies near its origin; far from it (UTM coordinates, say) the centre, in round
    /// numbers.
    ///
    /// This is needed if f32 rounds positions about the centre by more than 1e-5 of the radius:
    /// pixels are about a thousandth of it, and Gaussians smaller.
    pub fn offset(&self) -> DVec3 {
        let rounding = self.center.abs().max_element() * f64::from(f32::EPSILON) / 2.0;
        if rounding <= MAX_ROUNDING * self.radius {
            return DVec3::ZERO;
        }
        let step = 10_f64.powf(self.radius.log10().floor());
        if step >= 1.0 {
            return (self.center / step).round() * step;
        }
        // A whole number of steps divided by their number in a unit has the shortest decimals.
        let n = (1.0 / step).round();
        (self.center * n).round() / n
    }

    /// Returns the camera seen from the canonical frame; its image is the same.
    pub fn camera_to_canonical(&self, camera: &Camera) -> Camera {
        let eye = self.to_canonical(camera.center());
        Camera {
            translation: -(camera.rotation * eye),
            ..camera.clone()
        }
    }
    /// Undoes [`Frame::camera_to_canonical`].
    pub fn camera_to_world(&self, camera: &Camera) -> Camera {
        let eye = self.to_world(camera.center());
        Camera {
            translation: -(camera.rotation * eye),
            ..camera.clone()
        }
    }
}
