//! This module prepares photographs as the network takes them: scaled to multiples of a patch,
//! cropped to one size and normalised. Scaling is that of OpenCV's `resize` on 8-bit images, which
//! the network was trained with: rounded to 8 bits after each of two steps.

use rayon::prelude::*;

use super::PATCH_PX;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::scene::Image;

const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// A photograph at the network's scale.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Both sides are multiples of a patch.
    pub image: Image,
    /// Width and height of the photograph, pixels.
    pub original: (u32, u32),
}

/// Images of one size, normalised: `[views][3][height][width]`.
#[derive(Clone, Debug)]
pub struct Images {
    /// Number of images.
    pub n_views: usize,
    /// Rows of each image, a multiple of [`PATCH_PX`].
    pub height: usize,
    /// Columns of each image, a multiple of [`PATCH_PX`].
    pub width: usize,
    /// Levels in [0, 1], less the training images' mean and over their deviation, by channel.
    pub values: Vec<f32>,
    placed: Vec<Placed>,
}

/// The way from a photograph to its image.
#[derive(Clone, Copy, Debug)]
struct Placed {
    original: (u32, u32),
    scaled: (u32, u32),
    /// What was cut off on the left and above, pixels after scaling.
    offset: (u32, u32),
}

/// Scales a photograph so that its longer side has `size` pixels and both are multiples of a patch.
pub fn prepare(photograph: &Image, size: u32) -> Prepared {
    let original = (photograph.width, photograph.height);
    let longer = original.0.max(original.1);
    let mut image = photograph.clone();
    if longer != size {
        let scale = f64::from(size) / f64::from(longer);
        let side = |n: u32| (f64::from(n) * scale).round_ties_even().max(1.0) as u32;
        image = resized(&image, (side(original.0), side(original.1)));
    }
    let whole = (whole_patches(image.width), whole_patches(image.height));
    Prepared {
        image: resized(&image, whole),
        original,
    }
}

/// Returns the nearest multiple of a patch, halves up, at least one.
fn whole_patches(n: u32) -> u32 {
    const SIDE: u32 = PATCH_PX as u32;
    let below = n / SIDE * SIDE;
    let nearest = if below + SIDE - n <= n - below {
        below + SIDE
    } else {
        below
    };
    nearest.max(SIDE)
}

impl Images {
    /// Crops images about their centres to the smallest height and width, and normalises them.
    ///
    /// # Errors
    /// No image at all.
    pub fn new(prepared: &[Prepared]) -> Result<Images> {
        let sides = |side: fn(&Image) -> u32| prepared.iter().map(move |p| side(&p.image)).min();
        let (Some(width), Some(height)) = (sides(|i| i.width), sides(|i| i.height)) else {
            return Err(Error::new("there are no photographs"));
        };
        let place = |p: &Prepared| Placed {
            original: p.original,
            scaled: (p.image.width, p.image.height),
            offset: ((p.image.width - width) / 2, (p.image.height - height) / 2),
        };
        let placed: Vec<Placed> = prepared.iter().map(place).collect();
        let (width, height) = (width as usize, height as usize);
        let mut values = vec![0.0; prepared.len() * 3 * height * width];
        let planes = values.chunks_exact_mut(height * width).enumerate();
        for (plane, out) in planes {
            let (view, channel) = (plane / 3, plane % 3);
            let (image, (left, above)) = (&prepared[view].image, placed[view].offset);
            for (y, row) in out.chunks_exact_mut(width).enumerate() {
                let begin = (y + above as usize) * image.width as usize + left as usize;
                let pixels = image.rgb[begin * 3..].chunks_exact(3);
                for (value, pixel) in row.iter_mut().zip(pixels) {
                    let level = f32::from(pixel[channel]) / 255.0;
                    *value = (level - MEAN[channel]) / DEVIATION[channel];
                }
            }
        }
        Ok(Images {
            n_views: prepared.len(),
            height,
            width,
            values,
            placed,
        })
    }

    /// Takes images that are normalised already, `[views][3][height][width]`.
    ///
    /// # Errors
    /// Values that do not fill views of this size, or sides that are no multiples of a patch.
    pub fn from_values(values: Vec<f32>, height: u32, width: u32) -> Result<Images> {
        let (h, w) = (height as usize, width as usize);
        let n_views = values.len().checked_div(3 * h * w).unwrap_or(0);
        let whole = h.is_multiple_of(PATCH_PX) && w.is_multiple_of(PATCH_PX);
        if n_views == 0 || n_views * 3 * h * w != values.len() || !whole {
            return Err(Error::new(format!(
                "{} values are not images of {width}x{height} pixels in patches of {PATCH_PX}",
                values.len()
            )));
        }
        let size = (width, height);
        let placed = Placed {
            original: size,
            scaled: size,
            offset: (0, 0),
        };
        Ok(Images {
            n_views,
            height: h,
            width: w,
            values,
            placed: vec![placed; n_views],
        })
    }

    /// Returns the rows and columns of patches.
    pub(super) fn patches(&self) -> (usize, usize) {
        (self.height / PATCH_PX, self.width / PATCH_PX)
    }

    /// Cuts the images into patches, `[views][patches][3][14][14]`.
    pub(super) fn unfolded(&self) -> Vec<f32> {
        let (rows, columns) = self.patches();
        let area = self.height * self.width;
        let mut out = vec![0.0; self.values.len()];
        out.par_chunks_exact_mut(3 * PATCH_PX * PATCH_PX)
            .enumerate()
            .for_each(|(at, patch)| {
                let (view, row, column) =
                    (at / (rows * columns), at / columns % rows, at % columns);
                for (i, line) in patch.chunks_exact_mut(PATCH_PX).enumerate() {
                    let (channel, y) = (i / PATCH_PX, row * PATCH_PX + i % PATCH_PX);
                    let begin = (view * 3 + channel) * area + y * self.width + column * PATCH_PX;
                    line.copy_from_slice(&self.values[begin..][..PATCH_PX]);
                }
            });
        out
    }

    /// Returns a photograph's camera as one of the image that the network sees of it.
    pub fn camera_of_image(&self, view: usize, camera: &Camera) -> Camera {
        let Placed { scaled, offset, .. } = self.placed[view];
        let scaled = camera.resized(scaled.0, scaled.1);
        Camera {
            width: self.width as u32,
            height: self.height as u32,
            cx: scaled.cx - f64::from(offset.0),
            cy: scaled.cy - f64::from(offset.1),
            ..scaled
        }
    }

    /// Undoes [`Images::camera_of_image`].
    pub fn camera_of_photograph(&self, view: usize, camera: &Camera) -> Camera {
        let Placed {
            original,
            scaled,
            offset,
        } = self.placed[view];
        let whole = Camera {
            width: scaled.0,
            height: scaled.1,
            cx: camera.cx + f64::from(offset.0),
            cy: camera.cy + f64::from(offset.1),
            ..camera.clone()
        };
        whole.resized(original.0, original.1)
    }

    /// Returns the 8-bit colours of a view, `[height][width]`.
    pub fn colors(&self, view: usize) -> Vec<[u8; 3]> {
        let area = self.height * self.width;
        let level = |channel: usize, pixel: usize| {
            let value = self.values[(view * 3 + channel) * area + pixel];
            ((value * DEVIATION[channel] + MEAN[channel]) * 255.0).round() as u8
        };
        (0..area)
            .map(|pixel| [0, 1, 2].map(|channel| level(channel, pixel)))
            .collect()
    }
}

/// For each pixel of a scaled row or column: its sources and their weights.
type Taps = Vec<Vec<(usize, f32)>>;

/// Resizes an image: bicubically if a side grows, else by areas.
fn resized(image: &Image, (width, height): (u32, u32)) -> Image {
    if (image.width, image.height) == (width, height) {
        return image.clone();
    }
    let grows = width > image.width || height > image.height;
    let taps = if grows { cubic_taps } else { area_taps };
    let (by_column, by_row) = (taps(image.width, width), taps(image.height, height));
    // OpenCV has a path of its own for halves, in whole numbers.
    let halved = !grows && image.width == 2 * width && image.height == 2 * height;
    let row_len = width as usize * 3;
    let across = |y: usize| -> Vec<f32> {
        let row = &image.rgb[y * image.width as usize * 3..];
        let value = |taps: &Vec<(usize, f32)>, channel: usize| -> f32 {
            taps.iter()
                .map(|(x, weight)| f32::from(row[x * 3 + channel]) * weight)
                .sum()
        };
        by_column
            .iter()
            .flat_map(|taps| [0, 1, 2].map(|channel| value(taps, channel)))
            .collect()
    };
    let mut rgb = vec![0; row_len * height as usize];
    rgb.par_chunks_exact_mut(row_len)
        .zip(&by_row)
        .for_each(|(out, taps)| {
            let mut sums = vec![0.0_f32; row_len];
            for (y, weight) in taps {
                sums.iter_mut()
                    .zip(across(*y))
                    .for_each(|(sum, x)| *sum += weight * x);
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                // Conversion bounds a value to those of 8 bits.
                *out = if halved {
                    (sum + 0.5).floor()
                } else {
                    sum.round_ties_even()
                } as u8;
            }
        });
    Image { width, height, rgb }
}

/// Returns the shares of the pixels that each pixel of a smaller image covers.
fn area_taps(n: u32, m: u32) -> Taps {
    const LEAST: f64 = 1e-3;
    let (n, ratio) = (f64::from(n), f64::from(n) / f64::from(m));
    let taps = |i: u32| {
        let (begin, end) = (f64::from(i) * ratio, (f64::from(i) + 1.0) * ratio);
        let cell = ratio.min(n - begin);
        let last = end.floor().min(n - 1.0);
        let first = begin.ceil().min(last);
        let mut taps = Vec::new();
        if first - begin > LEAST {
            taps.push((first as usize - 1, ((first - begin) / cell) as f32));
        }
        taps.extend((first as usize..last as usize).map(|at| (at, (1.0 / cell) as f32)));
        if end - last > LEAST {
            taps.push((
                last as usize,
                ((end - last).min(1.0).min(cell) / cell) as f32,
            ));
        }
        taps
    };
    (0..m).map(taps).collect()
}

/// Returns the four pixels around each, clamped to the border.
fn cubic_taps(n: u32, m: u32) -> Taps {
    const A: f32 = -0.75;
    let near = |d: f32| ((A + 2.0) * d - (A + 3.0)) * d * d + 1.0;
    let far = |d: f32| ((A * d - 5.0 * A) * d + 8.0 * A) * d - 4.0 * A;
    let taps = |i: u32| {
        let source = (f64::from(i) + 0.5) * f64::from(n) / f64::from(m) - 0.5;
        let source = source as f32;
        let t = source - source.floor();
        let weights = [far(t + 1.0), near(t), near(1.0 - t), far(2.0 - t)];
        let at = |tap: usize| (source.floor() + tap as f32 - 1.0).clamp(0.0, (n - 1) as f32);
        (0..4).map(|tap| (at(tap) as usize, weights[tap])).collect()
    };
    (0..m).map(taps).collect()
}
