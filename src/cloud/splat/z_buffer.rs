//! The z-buffer keeps the nearest point of every pixel of one view.

use crate::camera::Camera;

/// A pixel's key where nothing was drawn.
const EMPTY: u64 = u64::MAX;

/// The nearest point of every pixel, row by row.
#[derive(Default)]
pub(crate) struct ZBuffer {
    /// Pixels.
    width: usize,
    /// f32 depth bits above, index below, so that the smaller number is the nearer point or, at
    /// equal depth, the lower index.
    keys: Vec<u64>,
}

/// A point in a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Winner {
    /// Index in the cloud.
    pub point: usize,
    /// Along the optical axis, canonical.
    pub depth: f32,
}

impl ZBuffer {
    /// Empties it for an image of `camera`'s size.
    pub(crate) fn clear(&mut self, camera: &Camera) {
        self.width = camera.width as usize;
        self.keys.clear();
        self.keys.resize(self.width * camera.height as usize, EMPTY);
    }

    /// Puts a point into a pixel, where it stays as long as it is the nearest there.
    pub(crate) fn put(&mut self, pixel: usize, candidate: Winner) {
        let depth = u64::from(candidate.depth.to_bits());
        let key = depth << 32 | candidate.point as u64;
        self.keys[pixel] = key.min(self.keys[pixel]);
    }

    /// Returns the image's width in pixels.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Returns the nearest point of every pixel, row by row.
    pub(crate) fn winners(&self) -> impl ExactSizeIterator<Item = Option<Winner>> + '_ {
        self.keys.iter().map(|key| winner(*key))
    }

    /// Returns whether something of this depth lies at most at `share` times the depth of the pixel's
    /// nearest point.
    pub(crate) fn is_front(&self, pixel: usize, depth: f32, share: f64) -> bool {
        let nearest = self.winner(pixel);
        nearest.is_some_and(|front| f64::from(depth) <= f64::from(front.depth) * share)
    }

    /// Returns the nearest point of a pixel.
    pub(crate) fn winner(&self, pixel: usize) -> Option<Winner> {
        winner(self.keys[pixel])
    }
}

fn winner(key: u64) -> Option<Winner> {
    (key != EMPTY).then(|| Winner {
        point: (key & u64::from(u32::MAX)) as usize,
        depth: f32::from_bits((key >> 32) as u32),
    })
}
