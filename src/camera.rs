//! Pinhole cameras. World-to-camera, +z forward, y down, pixel centres at +0.5.

use glam::{DMat3, DVec3};

/// A posed pinhole camera: `p_camera = rotation * p_world + translation`,
/// `u = fx * x / z + cx`, `v = fy * y / z + cy` in pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The view's name: its image's file name, or `virtual_000`.
    pub name: String,
    pub width: u32,
    pub height: u32,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    /// World-to-camera rotation.
    pub rotation: DMat3,
    /// World-to-camera translation, world units.
    pub translation: DVec3,
}

impl Camera {
    /// The optical centre in the world, `o = -R^T t`.
    pub fn center(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// Unit viewing direction in the world (the camera's +z).
    pub fn forward(&self) -> DVec3 {
        self.rotation.row(2)
    }

    /// Unit up direction in the world (the camera's -y).
    pub fn up(&self) -> DVec3 {
        -self.rotation.row(1)
    }

    /// A camera at `eye` that looks at `target` with `up` (world, any length) upwards in the
    /// image, and the intrinsics of `self`. `up` must not be parallel to the viewing direction.
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

    /// The same camera for an image of another size: intrinsics scale with it.
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

    /// The same camera for an image whose longer side is at most `px`.
    pub fn at_most(&self, px: u32) -> Camera {
        let size = (self.width, self.height);
        let (width, height) = bounded_size(size, self.width.max(self.height), px);
        self.resized(width, height)
    }
}

/// A size scaled so that `side`, one of its lengths, comes down to `bound`; as it is where it is
/// within. The other length is rounded to the nearest pixel and at least 1.
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
    pub center: DVec3,
    pub radius: f64,
}

impl Frame {
    pub const IDENTITY: Frame = Frame {
        center: DVec3::ZERO,
        radius: 1.0,
    };

    pub fn to_canonical(&self, p: DVec3) -> DVec3 {
        (p - self.center) / self.radius
    }

    pub fn to_world(&self, p: DVec3) -> DVec3 {
        p * self.radius + self.center
    }

    /// The camera seen from the canonical frame; its image is the same.
    pub fn camera_to_canonical(&self, camera: &Camera) -> Camera {
        let eye = self.to_canonical(camera.center());
        Camera {
            translation: -(camera.rotation * eye),
            ..camera.clone()
        }
    }
}
