//! Alpha channels that are a window onto the photograph and not a subject that is cut out of it: rounded
//! corners, the circle of a lens, the border that undistorting or turning an image leaves.
//!
//! A window has no dents: what is opaque fills its bounding box at least as an ellipse does, and most of the
//! image. And it is the same in every photograph, since it is the camera's or a program's; a subject looks
//! different from everywhere.

use image::GrayImage;

use super::masks::THRESHOLD;

/// Share of its bounding box that an ellipse fills, `pi / 4`, less what pixels at its edge take.
const MIN_FILL: f64 = 0.77;
/// Share of each of the image's sides that a window spans.
const MIN_SPAN: f64 = 0.5;
/// Mean opacity of what a window shows: what is less so is a veil over a background.
const MIN_OPACITY: f64 = 0.98;
/// Windows are the same where their sides are as near as this, in shares of the image's.
const SAME: f64 = 0.05;

/// What is opaque, as shares of the image's sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    /// Share of the box between these that is opaque.
    fill: f64,
}

impl Window {
    /// Finds the window that an alpha channel may be.
    pub(crate) fn of(alpha: &GrayImage) -> Option<Window> {
        let (width, height) = alpha.dimensions();
        let (mut columns, mut rows) = ((width, 0), (height, 0));
        let (mut n, mut opacity) = (0_u64, 0_u64);
        for (x, y, level) in alpha.enumerate_pixels().filter(|p| p.2.0[0] >= THRESHOLD) {
            opacity += u64::from(level.0[0]);
            columns = (columns.0.min(x), columns.1.max(x + 1));
            rows = (rows.0.min(y), rows.1.max(y + 1));
            n += 1;
        }
        let spans = [columns, rows].map(|(first, end)| f64::from(end.saturating_sub(first)));
        let fill = n as f64 / (spans[0] * spans[1]);
        let is_clear = opacity as f64 >= MIN_OPACITY * 255.0 * n as f64;
        let [across, down] = [spans[0] / f64::from(width), spans[1] / f64::from(height)];
        // Nothing opaque fills nothing: not a number.
        (is_clear && fill >= MIN_FILL && across.min(down) >= MIN_SPAN).then(|| Window {
            left: f64::from(columns.0) / f64::from(width),
            right: f64::from(columns.1) / f64::from(width),
            top: f64::from(rows.0) / f64::from(height),
            bottom: f64::from(rows.1) / f64::from(height),
            fill,
        })
    }

    /// Whether there are alpha channels, all of them windows, and the same one.
    pub(crate) fn are_one(windows: &[Option<Window>]) -> bool {
        let same = |a: &Window, b: &Window| {
            let sides = |w: &Window| [w.left, w.right, w.top, w.bottom, w.fill];
            let mut pairs = sides(a).into_iter().zip(sides(b));
            pairs.all(|(a, b)| (a - b).abs() <= SAME)
        };
        let known: Option<Vec<&Window>> = windows.iter().map(Option::as_ref).collect();
        known.is_some_and(|all| !all.is_empty() && all.iter().all(|w| same(w, all[0])))
    }
}
