//! This module fills the holes of a splatted image from around them.

use super::SplatImage;

/// Doublings of the power 16 of depths by which pixels count: one that is nearer by a tenth counts a fifth as much.
const DOUBLINGS: u32 = 4;

/// Returns `image` as RGBA8 rows in which every empty pixel has a colour and the alpha `weight`;
/// covered pixels are as they were. An image without a covered pixel stays empty.
///
/// Pull-push (Gortler et al. 1996, "The Lumigraph", section 3.4): with colours `c` weighted by
/// `w`, 1 where covered and 0 elsewhere, each coarser level has the mean of four pixels, with the sum of their
/// weights but at most 1; on the way back, `c <- c + (1 - w) up(c')` with the bilinearly enlarged coarser
/// colour `c'`. Small holes take the colour of their rim, large ones blend smoothly across.
///
/// A hole beside an edge of depth is what the nearer side has hidden from all photographs, so it continues the farther
/// side (as Oh et al. 2009 fill views between cameras, "Hole filling method using depth based in-painting"): in the mean of
/// four pixels and in the enlargement, each counts `(z / z_max)^16` times, where `z_max` is the greatest depth of the four. Depths are
/// carried along with the colours.
pub fn fill_holes(image: &SplatImage, weight: u8) -> Vec<u8> {
    let mut rgba = image.rgba.clone();
    let mut levels = vec![Level::of(image)];
    while let Some(coarser) = levels.last().and_then(Level::pull) {
        levels.push(coarser);
    }
    let Some(mut filled) = levels.pop().filter(|top| top.pixels[0].weight > 0.0) else {
        return rgba;
    };
    filled.pixels[0].weight = 1.0;
    while let Some(mut finer) = levels.pop() {
        finer.push(&filled);
        filled = finer;
    }
    for (pixel, filled) in rgba.chunks_exact_mut(4).zip(&filled.pixels) {
        if pixel[3] == 0 {
            let [r, g, b] = filled.color.map(|c| c.round() as u8);
            pixel.copy_from_slice(&[r, g, b, weight]);
        }
    }
    rgba
}

/// A pixel of a level.
#[derive(Clone, Copy, Default)]
struct Pixel {
    /// 0 to 255.
    color: [f32; 3],
    depth: f32,
    /// 0 to 1; without any, colour and depth mean nothing.
    weight: f32,
}

/// One level of the pyramid; the finest has the image's size.
struct Level {
    width: usize,
    height: usize,
    pixels: Vec<Pixel>,
}

impl Level {
    fn of(image: &SplatImage) -> Level {
        let pixel = |(p, depth): (&[u8], &f32)| match p[3] {
            0 => Pixel::default(),
            _ => Pixel {
                color: [p[0], p[1], p[2]].map(f32::from),
                depth: *depth,
                weight: 1.0,
            },
        };
        let pixels = image.rgba.chunks_exact(4).zip(&image.depths);
        Level {
            width: image.width as usize,
            height: image.height as usize,
            pixels: pixels.map(pixel).collect(),
        }
    }

    /// Returns the level half as large, or `None` from a single pixel.
    fn pull(&self) -> Option<Level> {
        if self.width.max(self.height) == 1 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let four = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            let places = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            mean(
                places.map(|(x, y)| match x < self.width && y < self.height {
                    true => (1.0, self.pixels[y * self.width + x]),
                    false => (0.0, Pixel::default()),
                }),
            )
        };
        Some(Level {
            width,
            height,
            pixels: (0..width * height).map(four).collect(),
        })
    }

    /// Completes every weight to 1 with the colours of the coarser level, whose weights are 1.
    fn push(&mut self, coarser: &Level) {
        for (y, row) in self.pixels.chunks_exact_mut(self.width).enumerate() {
            for (x, pixel) in row.iter_mut().enumerate() {
                if pixel.weight < 1.0 {
                    let (own, other) = (pixel.weight, coarser.enlarged(x, y));
                    let joined = |a: f32, b: f32| own * a + (1.0 - own) * b;
                    *pixel = Pixel {
                        color: std::array::from_fn(|i| joined(pixel.color[i], other.color[i])),
                        depth: joined(pixel.depth, other.depth),
                        weight: 1.0,
                    };
                }
            }
        }
    }

    /// Returns the value at pixel (x, y) of the level twice as large, bilinear, constant at the
    /// border.
    fn enlarged(&self, x: usize, y: usize) -> Pixel {
        // A fine pixel's centre lies a quarter of a coarse pixel off that of its own.
        let other = |v: usize, size: usize| match v % 2 {
            0 => (v / 2).saturating_sub(1),
            _ => (v / 2 + 1).min(size - 1),
        };
        let at = |x: usize, y: usize| self.pixels[y * self.width + x];
        let (x_0, x_1) = (x / 2, other(x, self.width));
        let (y_0, y_1) = (y / 2, other(y, self.height));
        mean([
            (9.0, at(x_0, y_0)),
            (3.0, at(x_1, y_0)),
            (3.0, at(x_0, y_1)),
            (1.0, at(x_1, y_1)),
        ])
    }
}

/// Returns the mean of four pixels, each with a factor of its weight, in which those far behind count most; the
/// weight is the sum of theirs, at most 1.
fn mean(four: [(f32, Pixel); 4]) -> Pixel {
    let covered = four.iter().filter(|(_, pixel)| pixel.weight > 0.0);
    let depths = covered.clone().map(|(_, pixel)| pixel.depth);
    let farthest = depths.fold(0.0, f32::max);
    let (mut mean, mut sum) = (Pixel::default(), 0.0);
    for (factor, pixel) in covered {
        // All count alike if no depth is known.
        let ratio = match pixel.depth < farthest {
            true => pixel.depth / farthest,
            false => 1.0,
        };
        let behind = (0..DOUBLINGS).fold(ratio, |power, _| power * power);
        let share = factor * pixel.weight * behind;
        mean.color = std::array::from_fn(|i| mean.color[i] + share * pixel.color[i]);
        mean.depth += share * pixel.depth;
        mean.weight += pixel.weight;
        sum += share;
    }
    match sum > 0.0 {
        true => Pixel {
            color: mean.color.map(|c| c / sum),
            depth: mean.depth / sum,
            weight: mean.weight.min(1.0),
        },
        false => Pixel::default(),
    }
}
