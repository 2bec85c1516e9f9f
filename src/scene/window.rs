//! An alpha channel may be a window onto the photograph and not a subject that is cut out of it:
//! rounded corners, the circle of a lens, the border that undistorting or turning an image leaves.
//!
//! A window has no dents: what is opaque has no gap in any row or column, fills its bounding box at
//! least as an ellipse does, and reaches across the image. And it is the same in every photograph,
//! since it is the camera's or a program's; a subject looks different from everywhere.

use image::GrayImage;

/// From this level on a pixel of a mask is set.
pub(super) const THRESHOLD: u8 = 128;

/// Share of its bounding box that an ellipse fills, `pi / 4`, less what pixels at its edge take.
const MIN_FILL: f64 = 0.77;
/// A window spans more than this share of each of the image's sides.
const MIN_SPAN: f64 = 0.5;
/// It spans at least this share of one of them: a ball has a margin where a lens's circle has none.
const MIN_REACH: f64 = 0.9;
/// Largest share of gaps, in rows and columns, of what is opaque.
const MAX_GAPS: f64 = 0.01;
/// Mean opacity of what a window shows: what is less so is a veil over a background.
const MIN_OPACITY: f64 = 0.98;
/// Windows are the same where their sides are as near as this, in shares of the image's.
const SAME: f64 = 0.05;

/// The opaque part, as shares of the image's sides.
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
        let mut in_rows = vec![Line::default(); height as usize];
        let mut in_columns = vec![Line::default(); width as usize];
        let mut opacity = 0_u64;
        for (x, y, level) in alpha.enumerate_pixels().filter(|p| p.2.0[0] >= THRESHOLD) {
            opacity += u64::from(level.0[0]);
            in_rows[y as usize].add(x);
            in_columns[x as usize].add(y);
        }
        let n: u64 = in_rows.iter().map(|line| u64::from(line.n)).sum();
        let gaps: u64 = in_rows.iter().chain(&in_columns).map(Line::gaps).sum();
        let [columns, rows] = [&in_columns, &in_rows].map(|lines| bounds(lines));
        let spans = [columns, rows].map(|(first, end)| f64::from(end.saturating_sub(first)));
        let fill = n as f64 / (spans[0] * spans[1]);
        let is_clear = opacity as f64 >= MIN_OPACITY * 255.0 * n as f64;
        let [across, down] = [spans[0] / f64::from(width), spans[1] / f64::from(height)];
        // Nothing opaque fills nothing: not a number.
        let is_whole = fill >= MIN_FILL && gaps as f64 <= MAX_GAPS * n as f64;
        let is_wide = across.min(down) > MIN_SPAN && across.max(down) >= MIN_REACH;
        (is_clear && is_whole && is_wide).then(|| Window {
            left: f64::from(columns.0) / f64::from(width),
            right: f64::from(columns.1) / f64::from(width),
            top: f64::from(rows.0) / f64::from(height),
            bottom: f64::from(rows.1) / f64::from(height),
            fill,
        })
    }

    /// Returns whether there are alpha channels and all of them are the same window.
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

/// The opaque pixels of a row or a column.
#[derive(Clone, Copy, Debug, Default)]
struct Line {
    first: u32,
    end: u32,
    n: u32,
}

impl Line {
    /// Adds a pixel beyond all that have been added.
    fn add(&mut self, place: u32) {
        if self.n == 0 {
            self.first = place;
        }
        self.end = place + 1;
        self.n += 1;
    }

    /// Returns the number of transparent pixels between opaque ones.
    fn gaps(&self) -> u64 {
        u64::from(self.end - self.first - self.n)
    }
}

/// Returns the first line that holds something, and one past the last.
fn bounds(lines: &[Line]) -> (u32, u32) {
    let first = lines.iter().position(|line| line.n > 0).unwrap_or(0);
    let end = lines
        .iter()
        .rposition(|line| line.n > 0)
        .map_or(0, |last| last + 1);
    (first as u32, end as u32)
}
