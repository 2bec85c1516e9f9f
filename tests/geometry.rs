//! Cameras, clouds and random numbers for the geometric tests.

use glam::{DMat3, DVec3, dvec3};
use gspotential::camera::Camera;
use gspotential::config::Config;
use gspotential::scene::PointCloud;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A 64x48 camera at `eye` that looks at `target`, written without the crate's own look-at.
pub(crate) fn camera(eye: DVec3, target: DVec3) -> Camera {
    let forward = (target - eye).normalize();
    let helper = if forward.z.abs() < 0.9 {
        DVec3::Z
    } else {
        DVec3::X
    };
    let right = forward.cross(helper).normalize();
    let down = forward.cross(right);
    let rotation = DMat3::from_cols(right, down, forward).transpose();
    Camera {
        name: format!("{eye}"),
        width: 64,
        height: 48,
        fx: 50.0,
        fy: 52.0,
        cx: 32.0,
        cy: 24.0,
        rotation,
        translation: -(rotation * eye),
    }
}

/// `n` cameras on a slanted ring of radius 3 and height 2 around `focus`, looking at it.
pub(crate) fn ring(n: usize, focus: DVec3) -> Vec<Camera> {
    (0..n)
        .map(|i| {
            let (sin, cos) = (i as f64 * 1.1).sin_cos();
            camera(focus + dvec3(3.0 * cos, 3.0 * sin, 2.0), focus)
        })
        .collect()
}

pub(crate) fn cloud(positions: Vec<DVec3>) -> PointCloud {
    PointCloud {
        colors: (0..positions.len())
            .map(|i| [i as u8, (i >> 8) as u8, (i >> 16) as u8])
            .collect(),
        positions,
        confidence: None,
    }
}

/// The `paper` preset.
pub(crate) fn paper() -> Config {
    Config::default()
}

/// Seeded uniform numbers.
pub(crate) struct Random(ChaCha8Rng);

impl Random {
    pub(crate) fn new(seed: u64) -> Random {
        Random(ChaCha8Rng::seed_from_u64(seed))
    }

    pub(crate) fn index(&mut self, n: usize) -> usize {
        (self.0.next_u64() % n as u64) as usize
    }

    pub(crate) fn in_range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() as f64 / u64::MAX as f64)
    }

    pub(crate) fn in_cube(&mut self, half: f64) -> DVec3 {
        let mut draw = || self.in_range(-half, half);
        dvec3(draw(), draw(), draw())
    }
}

/// A path in a temporary folder of its own.
pub(crate) fn scratch(name: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}
