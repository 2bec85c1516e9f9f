//! This module finds the cloud in a training view, and measures how far its colours are those of
//! the photograph.
//!
//! The points are drawn into an image so coarse that a surface of the cloud has few holes, and the
//! photograph is averaged over the same cells. Over the cells that a point is in,
//! `r = sum (q - mean q) (I - mean I) / sqrt(sum (q - mean q)^2 sum (I - mean I)^2)` of the nearest
//! points' colours `q` and the photograph's `I`, channels together, each about its own mean: an
//! exposure of its own changes nothing.
//!
//! Chance is what `r` is after the photograph is shifted against the points, cyclically, by eighths
//! of its sides: pixels next to each other are alike, so points shuffled one by one would make any
//! smooth pattern look surer than it is.

use glam::{DMat3, DVec3};
use serde::Serialize;

use crate::camera::{Camera, Frame};
use crate::cloud::splat::{Points, ZBuffer};
use crate::error::Result;
use crate::scene::{PointCloud, View};

/// Longer side of the photographs as they are compared, cells.
const MAX_CELLS: u32 = 128;
/// Points for each cell that is covered.
const POINTS_A_CELL: f64 = 3.0;
/// Fewer cells than these, or less contrast in them (standard deviation, 8-bit levels), tell
/// nothing.
const MIN_CELLS: usize = 48;
const MIN_CONTRAST: f64 = 3.0;
/// Neighbouring cells of a cloud that shows anything are more alike than this correlation.
const MIN_COHERENCE: f64 = 0.3;
/// Shifts along each side of the image.
const N_SHIFTS: usize = 8;

/// A photograph in cells.
pub(super) struct Photo {
    pub camera: Camera,
    /// Row by row; none where no pixel counts.
    cells: Vec<Option<[f64; 3]>>,
}

impl Photo {
    /// Reduces `view` to at most [`MAX_CELLS`] on its longer side. What a mask leaves out, by a
    /// background colour or for training, is no photograph of the cloud.
    pub(crate) fn new(view: &View) -> Photo {
        let camera = view.camera.at_most(MAX_CELLS);
        let (width, height) = (view.image.width as usize, view.image.height as usize);
        let pixel = |i: usize| {
            let rgb = &view.image.rgb[3 * i..][..3];
            view.shows(i).then(|| [0, 1, 2].map(|c| f64::from(rgb[c])))
        };
        Photo {
            cells: averaged((width, height), (camera.width, camera.height), pixel),
            camera,
        }
    }

    /// Returns the cells averaged down to the grid `size`.
    fn coarser(&self, size: (u32, u32)) -> Vec<Option<[f64; 3]>> {
        let own = (self.camera.width as usize, self.camera.height as usize);
        averaged(own, size, |i| self.cells[i])
    }

    /// Returns the photograph turned by 180 degrees.
    pub(crate) fn turned(&self) -> Photo {
        let mut cells = self.cells.clone();
        cells.reverse();
        self.with_cells(cells)
    }

    /// Returns the photograph with left and right exchanged.
    pub(crate) fn mirrored(&self) -> Photo {
        let mut cells = self.cells.clone();
        let rows = cells.chunks_exact_mut(self.camera.width as usize);
        rows.for_each(<[_]>::reverse);
        self.with_cells(cells)
    }

    fn with_cells(&self, cells: Vec<Option<[f64; 3]>>) -> Photo {
        Photo {
            camera: self.camera.clone(),
            cells,
        }
    }

    /// Returns the photograph as `camera`, of its size, would have taken it.
    pub(crate) fn from(&self, camera: Camera) -> Photo {
        Photo {
            camera,
            cells: self.cells.clone(),
        }
    }

    /// Returns this view with the photograph of `other`, which has its shape.
    pub(crate) fn with_cells_of(&self, other: &Photo) -> Option<Photo> {
        let same =
            (self.camera.width, self.camera.height) == (other.camera.width, other.camera.height);
        same.then(|| self.with_cells(other.cells.clone()))
    }
}

/// Returns the means over the cells of a coarser grid; none where nothing counts.
fn averaged(
    (width, height): (usize, usize),
    (columns, rows): (u32, u32),
    pixel: impl Fn(usize) -> Option<[f64; 3]>,
) -> Vec<Option<[f64; 3]>> {
    let (columns, rows) = (columns as usize, rows as usize);
    let mut sums = vec![([0.0; 3], 0_u32); columns * rows];
    for y in 0..height {
        let row = y * rows / height;
        for x in 0..width {
            if let Some(rgb) = pixel(y * width + x) {
                let (sum, n) = &mut sums[row * columns + x * columns / width];
                *sum = [0, 1, 2].map(|c| sum[c] + rgb[c]);
                *n += 1;
            }
        }
    }
    let mean = |(sum, n): ([f64; 3], u32)| (n > 0).then(|| sum.map(|s| s / f64::from(n)));
    sums.into_iter().map(mean).collect()
}

/// A cloud to look for in views.
#[derive(Clone)]
pub(super) struct Probe {
    points: Points,
    positions: Vec<DVec3>,
    colors: Vec<[u8; 3]>,
    /// About the cameras, so that nothing is lost far from the world's origin.
    frame: Frame,
}

/// The part of the cloud that a view sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sight {
    pub n_in_front: usize,
    pub n_in_image: usize,
    pub colors: Option<Colors>,
}

/// Correlations of colours, -1 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Colors {
    /// Agreement of the points with the photograph.
    pub agreement: f64,
    /// The agreement that nine in ten shifts of the photograph stay below.
    pub chance: f64,
}

impl Probe {
    pub(crate) fn new(cloud: &PointCloud, center: DVec3) -> Result<Probe> {
        let frame = Frame {
            center,
            radius: 1.0,
            extent: 1.0,
        };
        Ok(Probe {
            points: Points::new(cloud, &frame)?,
            positions: cloud.positions.clone(),
            colors: cloud.colors.clone(),
            frame,
        })
    }

    /// Returns the same points in other colours.
    pub(crate) fn recolored(&self, color: impl Fn([u8; 3]) -> [u8; 3]) -> Probe {
        Probe {
            colors: self.colors.iter().map(|c| color(*c)).collect(),
            ..self.clone()
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns what the camera of `photo` sees of the cloud after the motion `x -> turn x + shift`
    /// of it, world.
    pub(crate) fn look(&self, photo: &Photo, (turn, shift): (DMat3, DVec3)) -> Sight {
        let camera = &photo.camera;
        let moved = Camera {
            rotation: camera.rotation * turn,
            translation: camera.rotation * (turn * self.frame.center + shift - camera.center()),
            ..camera.clone()
        };
        let (mut n_in_front, mut n_in_image) = (0, 0);
        let [width, height] = [camera.width, camera.height].map(f64::from);
        for p in &self.positions {
            let (pixel, depth) = moved.project(*p - self.frame.center);
            if depth > 0.0 {
                n_in_front += 1;
                let inside = (0.0..width).contains(&pixel.x) && (0.0..height).contains(&pixel.y);
                n_in_image += usize::from(inside);
            }
        }
        Sight {
            n_in_front,
            n_in_image,
            colors: self.colors(photo, &moved, n_in_image),
        }
    }

    /// Returns how the colours agree; none where there is too little to tell by.
    fn colors(&self, photo: &Photo, camera: &Camera, n_in_image: usize) -> Option<Colors> {
        let most = (camera.width * camera.height) as f64;
        let mut z_buffer = ZBuffer::default();
        let mut wanted = n_in_image as f64 / POINTS_A_CELL;
        // Once more, finer, where the points are in a part of the image only.
        for _ in 0..2 {
            let side = (wanted.min(most) / most).sqrt();
            let scaled = |length: u32| ((f64::from(length) * side).round() as u32).max(1);
            let coarse = camera.resized(scaled(camera.width), scaled(camera.height));
            self.points.draw_pixels(&coarse, 0.0, &mut z_buffer);
            let n = z_buffer.winners().filter(Option::is_some).count().max(1);
            let covered = n as f64 / z_buffer.winners().len() as f64;
            if covered > 0.5 || wanted >= most {
                break;
            }
            wanted /= covered;
        }
        let width = z_buffer.width();
        let height = z_buffer.winners().len() / width;
        let drawn: Vec<Option<[f64; 3]>> = z_buffer
            .winners()
            .map(|w| w.map(|w| self.colors[w.point].map(f64::from)))
            .collect();
        let seen = photo.coarser((width as u32, height as u32));
        let shifted = |dx: usize, dy: usize| {
            let of = |(i, drawn): (usize, &Option<[f64; 3]>)| {
                let (x, y) = ((i % width + dx) % width, (i / width + dy) % height);
                Some(((*drawn)?, seen[y * width + x]?))
            };
            correlation(drawn.iter().enumerate().filter_map(of))
        };
        let beside = |(i, drawn_here): (usize, &Option<[f64; 3]>)| {
            let right = drawn.get(i + 1).filter(|_| (i + 1) % width != 0)?;
            Some(((*drawn_here)?, (*right)?))
        };
        let coherence = correlation(drawn.iter().enumerate().filter_map(beside))?;
        let agreement = shifted(0, 0).filter(|_| coherence >= MIN_COHERENCE)?;
        let steps = (0..N_SHIFTS).flat_map(|i| (0..N_SHIFTS).map(move |j| (i, j)));
        let shifts = steps
            .skip(1)
            .map(|(i, j)| (i * width / N_SHIFTS, j * height / N_SHIFTS));
        let mut by_chance: Vec<f64> = shifts.filter_map(|(dx, dy)| shifted(dx, dy)).collect();
        by_chance.sort_unstable_by(f64::total_cmp);
        let chance = *by_chance.get(9 * by_chance.len() / 10)?;
        Some(Colors { agreement, chance })
    }
}

/// Returns the correlation of colours, channels together; `None` for too few pairs, or if either
/// side hardly varies.
fn correlation(pairs: impl Iterator<Item = ([f64; 3], [f64; 3])>) -> Option<f64> {
    let pairs: Vec<_> = pairs.collect();
    if pairs.len() < MIN_CELLS {
        return None;
    }
    let n = pairs.len() as f64;
    let mut sums = [[0.0; 3]; 2];
    for (a, b) in &pairs {
        for c in 0..3 {
            sums[0][c] += a[c] / n;
            sums[1][c] += b[c] / n;
        }
    }
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in &pairs {
        for c in 0..3 {
            let (a, b) = (a[c] - sums[0][c], b[c] - sums[1][c]);
            aa += a * a;
            bb += b * b;
            ab += a * b;
        }
    }
    let least = 3.0 * n * MIN_CONTRAST * MIN_CONTRAST;
    (aa >= least && bb >= least).then(|| ab / (aa * bb).sqrt())
}
