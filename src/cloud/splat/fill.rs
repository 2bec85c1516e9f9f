//! This module fills the holes of a splatted image from around them.

use super::SplatImage;

/// Returns `image` as RGBA8 rows in which every empty pixel has a colour and the alpha `weight`;
/// covered pixels are as they were. An image without a covered pixel stays empty.
///
/// Pull-push (Gortler et al. 1996, "The Lumigraph", section 3.4): with colours `c` weighted by
/// `w`, 1 where covered and 0 elsewhere, each coarser level sums four pixels and bounds their
/// weight by 1; on the way back, `c <- c + (1 - w) up(c')` with the bilinearly enlarged coarser
/// colour `c'`. Small holes take the colour of their rim, large ones blend smoothly across.
pub fn fill_holes(image: &SplatImage, weight: u8) -> Vec<u8> {
    let mut rgba = image.rgba.clone();
    let mut levels = vec![Level::of(image)];
    while let Some(coarser) = levels.last().and_then(Level::pull) {
        levels.push(coarser);
    }
    let Some(mut filled) = levels.pop().filter(|top| top.pixels[0][3] > 0.0) else {
        return rgba;
    };
    filled.normalize();
    while let Some(mut finer) = levels.pop() {
        finer.push(&filled);
        filled = finer;
    }
    for (pixel, [r, g, b, _]) in rgba.chunks_exact_mut(4).zip(&filled.pixels) {
        if pixel[3] == 0 {
            let color = [r, g, b].map(|c| c.round() as u8);
            pixel.copy_from_slice(&[color[0], color[1], color[2], weight]);
        }
    }
    rgba
}

/// One level of the pyramid; the finest has the image's size.
struct Level {
    width: usize,
    height: usize,
    /// Colour times weight, 0 to 255, and weight, 0 to 1.
    pixels: Vec<[f32; 4]>,
}

impl Level {
    fn of(image: &SplatImage) -> Level {
        let pixel = |p: &[u8]| match p[3] {
            0 => [0.0; 4],
            _ => [f32::from(p[0]), f32::from(p[1]), f32::from(p[2]), 1.0],
        };
        Level {
            width: image.width as usize,
            height: image.height as usize,
            pixels: image.rgba.chunks_exact(4).map(pixel).collect(),
        }
    }

    /// Returns the level half as large, or `None` from a single pixel.
    fn pull(&self) -> Option<Level> {
        if self.width.max(self.height) == 1 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut pixels = vec![[0.0; 4]; width * height];
        for (y, row) in self.pixels.chunks_exact(self.width).enumerate() {
            for (x, pixel) in row.iter().enumerate() {
                let sum: &mut [f32; 4] = &mut pixels[y / 2 * width + x / 2];
                *sum = std::array::from_fn(|i| sum[i] + pixel[i]);
            }
        }
        for pixel in &mut pixels {
            let over = pixel[3].max(1.0);
            *pixel = pixel.map(|v| v / over);
        }
        Some(Level {
            width,
            height,
            pixels,
        })
    }

    /// Gives every pixel of some weight the weight 1.
    fn normalize(&mut self) {
        for pixel in &mut self.pixels {
            let weight = pixel[3];
            *pixel = pixel.map(|v| v / weight);
        }
    }

    /// Completes every weight to 1 with the colours of the coarser level, whose weights are 1.
    fn push(&mut self, coarser: &Level) {
        for (y, row) in self.pixels.chunks_exact_mut(self.width).enumerate() {
            for (x, pixel) in row.iter_mut().enumerate() {
                let missing = 1.0 - pixel[3];
                if missing > 0.0 {
                    let color = coarser.enlarged(x, y);
                    *pixel = std::array::from_fn(|i| pixel[i] + missing * color[i]);
                }
            }
        }
    }

    /// Returns the value at pixel (x, y) of the level twice as large, bilinear, constant at the
    /// border.
    fn enlarged(&self, x: usize, y: usize) -> [f32; 4] {
        // A fine pixel's centre lies a quarter of a coarse pixel off that of its own.
        let other = |v: usize, size: usize| match v % 2 {
            0 => (v / 2).saturating_sub(1),
            _ => (v / 2 + 1).min(size - 1),
        };
        let at = |x: usize, y: usize| self.pixels[y * self.width + x];
        let (x_0, x_1) = (x / 2, other(x, self.width));
        let (y_0, y_1) = (y / 2, other(y, self.height));
        let corners = [at(x_0, y_0), at(x_1, y_0), at(x_0, y_1), at(x_1, y_1)];
        std::array::from_fn(|i| {
            let [a, b, c, d] = corners.map(|corner| corner[i]);
            (9.0 * a + 3.0 * b + 3.0 * c + d) / 16.0
        })
    }
}
