//! The connectivity filter drops covered pixels that have few covered neighbours.

use super::{Winner, ZBuffer};
use crate::config::SplatConfig;

/// Buffers of the connectivity filter, reused from view to view.
#[derive(Default)]
pub(crate) struct Filter {
    /// 1 where covered, before the filter.
    mask: Vec<u8>,
    /// Covered pixels of each column within the filter window's rows.
    columns: Vec<u32>,
}

impl Filter {
    /// Visits, row by row, the covered pixels that have at least `config.filter_min_neighbors`
    /// other covered pixels in their window, all decided on the unfiltered mask.
    ///
    /// The image must have pixels, and the window be odd.
    pub(crate) fn kept(
        &mut self,
        z_buffer: &ZBuffer,
        config: &SplatConfig,
        mut visit: impl FnMut(usize, Winner),
    ) {
        let width = z_buffer.width();
        let Filter { mask, columns } = self;
        mask.clear();
        mask.extend(z_buffer.winners().map(|w| u8::from(w.is_some())));
        columns.clear();
        columns.resize(width, 0);
        let reach = (config.filter_window_px / 2) as usize;
        // The first row's window reaches `reach` rows down.
        for row in mask.chunks_exact(width).take(reach) {
            columns
                .iter_mut()
                .zip(row)
                .for_each(|(c, m)| *c += u32::from(*m));
        }
        for y in 0..mask.len() / width {
            if let Some(row) = mask.chunks_exact(width).nth(y + reach) {
                columns
                    .iter_mut()
                    .zip(row)
                    .for_each(|(c, m)| *c += u32::from(*m));
            }
            if y > reach {
                let row = &mask[(y - reach - 1) * width..][..width];
                columns
                    .iter_mut()
                    .zip(row)
                    .for_each(|(c, m)| *c -= u32::from(*m));
            }
            let mut in_window: u32 = columns.iter().take(reach).sum();
            for x in 0..width {
                if let Some(column) = columns.get(x + reach) {
                    in_window += column;
                }
                if x > reach {
                    in_window -= columns[x - reach - 1];
                }
                // The window counts the pixel itself.
                if in_window > config.filter_min_neighbors
                    && let Some(winner) = z_buffer.winner(y * width + x)
                {
                    visit(y * width + x, winner);
                }
            }
        }
    }
}
