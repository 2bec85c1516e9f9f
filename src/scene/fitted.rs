//! This module fits cameras to photographs that have another size than their camera.
//!
//! DUSt3R, MASt3R and VGGT see photographs scaled to a size of their own and cropped or padded, and
//! what they say of the cameras is often handed on at that size. How they do it is known (DUSt3R's
//! `load_images`, VGGT's `load_and_preprocess_images` and its square sibling), so that a camera of
//! such a size is mapped to the whole photograph. Places are measured from the image's corner,
//! pixel centres at +0.5, in which scaling is a product and a crop a shift.

use super::image_file::same_aspect;
use crate::camera::Camera;

/// Longer side that DUSt3R and MASt3R scale photographs to, pixels; what they see has sides that
/// are multiples of their patch.
const DUST3R_SIDE: u32 = 512;
const DUST3R_PATCH: u32 = 16;
/// Side of the square that DUSt3R's small models see.
const DUST3R_SQUARE: u32 = 224;
/// VGGT's width and patch.
const VGGT_SIDE: u32 = 518;
const VGGT_PATCH: f64 = 14.0;
/// Sides of the squares that VGGT pads photographs to: its own and its tracker's.
const VGGT_SQUARES: [u32; 2] = [518, 1024];

/// A camera for a photograph, and what was done to it.
#[derive(Clone, Debug)]
pub(super) struct Fitted {
    pub camera: Camera,
    pub how: Fit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fit {
    /// The camera had the photograph's size.
    Same,
    /// It had the photograph's shape in another resolution.
    Rescaled,
    /// It was of what this program makes of the photograph.
    Seen(&'static str),
}

/// What a program sees of a photograph: `u_seen = u * scale - corner` on each axis.
#[derive(Clone, Copy, Debug)]
struct Window {
    program: &'static str,
    size: (u32, u32),
    scale: [f64; 2],
    corner: [f64; 2],
}

/// Finds the camera of a photograph of `size` pixels that `camera` stands for; none where the
/// shapes do not fit. If there are several ways to map it, that of the most nearly square pixels is
/// taken.
pub(super) fn fitted(camera: &Camera, size: (u32, u32)) -> Option<Fitted> {
    let (width, height) = (camera.width, camera.height);
    let rescaled = |how| Fitted {
        camera: camera.resized(size.0, size.1),
        how,
    };
    if (width, height) == size {
        return Some(rescaled(Fit::Same));
    }
    let is_exact = u64::from(width) * u64::from(size.1) == u64::from(height) * u64::from(size.0);
    if is_exact {
        return Some(rescaled(Fit::Rescaled));
    }
    let windows = windows(size).into_iter();
    let seen = windows
        .filter(|window| window.size == (width, height))
        .map(|window| (window, window.camera(camera, size)))
        .min_by(|(_, a), (_, b)| stretch(a).total_cmp(&stretch(b)));
    match seen {
        Some((window, camera)) => Some(Fitted {
            camera,
            how: Fit::Seen(window.program),
        }),
        None => same_aspect((width, height), size).then(|| rescaled(Fit::Rescaled)),
    }
}

/// Returns how far a camera's pixels are from square.
fn stretch(camera: &Camera) -> f64 {
    (camera.fx / camera.fy).ln().abs()
}

impl Window {
    /// Returns the camera of the whole photograph.
    fn camera(&self, seen: &Camera, (width, height): (u32, u32)) -> Camera {
        let ([sx, sy], [left, top]) = (self.scale, self.corner);
        Camera {
            width,
            height,
            fx: seen.fx / sx,
            fy: seen.fy / sy,
            cx: (seen.cx + left) / sx,
            cy: (seen.cy + top) / sy,
            ..seen.clone()
        }
    }
}

/// Lists all that the programs make of a photograph of `size`.
fn windows((width, height): (u32, u32)) -> Vec<Window> {
    let photograph = [f64::from(width), f64::from(height)];
    let longer = photograph[0].max(photograph[1]);
    let scales = |[w, h]: [u32; 2]| [f64::from(w) / photograph[0], f64::from(h) / photograph[1]];
    let mut windows = Vec::new();
    let mut add = |program, resized: [u32; 2], size: [u32; 2], corner: [f64; 2]| {
        windows.push(Window {
            program,
            size: (size[0], size[1]),
            scale: scales(resized),
            corner,
        });
    };

    // DUSt3R scales the longer side and crops around the middle pixel.
    let scaled_to = |side: f64| photograph.map(|s| (s * side / longer).round_ties_even() as u32);
    let cropped = |resized: [u32; 2], half: [u32; 2]| -> [f64; 2] {
        std::array::from_fn(|i| f64::from(resized[i] / 2) - f64::from(half[i]))
    };
    let resized = scaled_to(f64::from(DUST3R_SIDE));
    let half = resized.map(|s| s / 2 * 2 / DUST3R_PATCH * DUST3R_PATCH / 2);
    add(
        "DUSt3R",
        resized,
        half.map(|h| 2 * h),
        cropped(resized, half),
    );
    if resized[0] == resized[1] {
        let half = [half[0], 3 * half[0] / 4];
        add(
            "DUSt3R",
            resized,
            half.map(|h| 2 * h),
            cropped(resized, half),
        );
    }
    let shorter = photograph[0].min(photograph[1]);
    let resized = scaled_to((f64::from(DUST3R_SQUARE) * longer / shorter).round_ties_even());
    let half = [resized[0].min(resized[1]) / 2; 2];
    add(
        "DUSt3R",
        resized,
        half.map(|h| 2 * h),
        cropped(resized, half),
    );

    // VGGT sets the width, rounds the height to its patch, which stretches the image a little, and
    // crops what is higher than wide; or it pads to a square.
    let side = f64::from(VGGT_SIDE);
    let patched = |s: f64, other: f64| {
        let rounded = (s * (side / other) / VGGT_PATCH).round_ties_even() * VGGT_PATCH;
        rounded as u32
    };
    let resized = [VGGT_SIDE, patched(photograph[1], photograph[0])];
    let top = resized[1].saturating_sub(VGGT_SIDE) / 2;
    let size = [VGGT_SIDE, resized[1].min(VGGT_SIDE)];
    add("VGGT", resized, size, [0.0, f64::from(top)]);
    // The whole square without a stretch goes first: what the newer of its programs does.
    for square in VGGT_SQUARES {
        let scale = f64::from(square) / longer;
        let padding = [width, height].map(|s| (width.max(height) - s) / 2);
        windows.push(Window {
            program: "VGGT",
            size: (square, square),
            scale: [scale, scale],
            corner: padding.map(|p| -scale * f64::from(p)),
        });
    }
    let resized = if width >= height {
        [VGGT_SIDE, patched(photograph[1], photograph[0])]
    } else {
        [patched(photograph[0], photograph[1]), VGGT_SIDE]
    };
    let padding = resized.map(|s| -f64::from(VGGT_SIDE.saturating_sub(s) / 2));
    windows.push(Window {
        program: "VGGT",
        size: (VGGT_SIDE, VGGT_SIDE),
        scale: scales(resized),
        corner: padding,
    });
    windows
}
