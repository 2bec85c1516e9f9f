//! This module tells the brightness of a view at any place, blurred.

use glam::DVec2;

use super::DepthMap;

/// `[height][width]` of squares that are averaged.
pub(super) struct Luma {
    values: Vec<f64>,
    width: usize,
    height: usize,
    side: f64,
}

impl Luma {
    /// Averages over squares of `side` pixels; what is left at the borders is not used.
    pub(crate) fn new(map: &DepthMap, side: usize) -> Luma {
        let row = map.camera.width as usize;
        let (width, height) = (row / side, map.camera.height as usize / side);
        let level = |[r, g, b]: [u8; 3]| {
            (0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)) / 255.0
        };
        let average = |x: usize, y: usize| {
            let pixels = (0..side * side).map(|i| (x * side + i % side, y * side + i / side));
            pixels
                .map(|(x, y)| level(map.colors[y * row + x]))
                .sum::<f64>()
                / (side * side) as f64
        };
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Luma {
            values: places.map(|(x, y)| average(x, y)).collect(),
            width,
            height,
            side: side as f64,
        }
    }

    /// Interpolates between the centres of four squares; `None` beyond the outermost centres.
    pub(crate) fn at(&self, place: DVec2) -> Option<f64> {
        let corner = place / self.side - DVec2::splat(0.5);
        if !(corner.x >= 0.0 && corner.y >= 0.0) {
            return None;
        }
        let (x, y) = (corner.x as usize, corner.y as usize);
        if x + 1 >= self.width || y + 1 >= self.height {
            return None;
        }
        let (s, t) = (corner.x - x as f64, corner.y - y as f64);
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
        Some((1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * c + s * d))
    }
}
