//! Tile lists, found by looking at every pixel centre.

use rayon::prelude::*;

use super::model::TwinSplat;
use super::raster::depth_order;

/// Tiles of `tile_width * tile_height` pixels over an image, row-major.
#[derive(Clone, Copy, Debug)]
pub struct TileGrid {
    /// Width of the image, pixels.
    pub width: usize,
    /// Height of the image, pixels.
    pub height: usize,
    /// Width of a tile, pixels.
    pub tile_width: usize,
    /// Height of a tile, pixels.
    pub tile_height: usize,
}

impl TileGrid {
    /// Returns the number of tiles in a row; the last may reach beyond the image.
    pub fn columns(&self) -> usize {
        self.width.div_ceil(self.tile_width)
    }

    /// Returns the number of tiles.
    pub fn n_tiles(&self) -> usize {
        self.columns() * self.height.div_ceil(self.tile_height)
    }
}

/// Returns the tiles, ascending, with at least one pixel centre where the splat's alpha is
/// `min_alpha` or more. A tile list is right if it contains these; `min_alpha` a little above 1/255
/// leaves out what hangs on rounding.
pub fn tiles_of(splat: &TwinSplat, grid: &TileGrid, min_alpha: f64) -> Vec<usize> {
    let mut hit = vec![false; grid.n_tiles()];
    if splat.valid {
        let [xx, xy, yy] = splat.cov2d;
        let det = xx * yy - xy * xy;
        // Alpha is `min_alpha` on q = 2 ln(opacity / min_alpha), whose box is sqrt(q cov).
        let q_max = 2.0 * (splat.opacity / min_alpha).ln().max(0.0);
        let pixels = |center: f64, variance: f64, n: usize| {
            let reach = (q_max * variance).sqrt() + 1.0;
            let bound = |x: f64| x.clamp(0.0, n as f64) as usize;
            bound((center - reach).floor())..bound((center + reach).ceil())
        };
        for y in pixels(splat.mean2d[1], yy, grid.height) {
            for x in pixels(splat.mean2d[0], xx, grid.width) {
                let dx = x as f64 + 0.5 - splat.mean2d[0];
                let dy = y as f64 + 0.5 - splat.mean2d[1];
                let q = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / det;
                if splat.opacity * (-0.5 * q).exp() >= min_alpha {
                    hit[y / grid.tile_height * grid.columns() + x / grid.tile_width] = true;
                }
            }
        }
    }
    (0..hit.len()).filter(|&tile| hit[tile]).collect()
}

/// Returns for each tile the splats that reach it, by increasing depth, equal depths by index.
pub fn tile_lists(splats: &[TwinSplat], grid: &TileGrid, min_alpha: f64) -> Vec<Vec<usize>> {
    let order = depth_order(splats);
    let tiles: Vec<Vec<usize>> = order
        .par_iter()
        .map(|&i| tiles_of(&splats[i], grid, min_alpha))
        .collect();
    let mut lists = vec![Vec::new(); grid.n_tiles()];
    for (&splat, tiles) in order.iter().zip(&tiles) {
        for &tile in tiles {
            lists[tile].push(splat);
        }
    }
    lists
}
