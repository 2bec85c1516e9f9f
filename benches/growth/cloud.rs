//! Scenes of any size.

use glam::DVec3;
use gspotential::config::Config;
use gspotential::doctor::twin::random::Random;
use gspotential::error::Result;
use gspotential::pipeline::load_scene;
use gspotential::scene::{LoadOptions, PointCloud, Scene, SceneSource};

/// Points of the built-in scene's cloud that copies are scattered around, in the scene's unit.
const SCATTER: f64 = 0.02;

/// The built-in scene of this width with a cloud of `n_points`.
pub(crate) fn scene(config: &Config, width: u32, n_points: usize) -> Result<Scene> {
    let options = LoadOptions {
        n_test: 1,
        ..LoadOptions::new(config)
    };
    let mut scene = load_scene(&SceneSource::Builtin { width }, &options)?;
    scene.cloud = of_size(&scene.cloud, n_points);
    Ok(scene)
}

/// `n` points: those of `cloud` spread over its order, or all and copies scattered around them.
pub(crate) fn of_size(cloud: &PointCloud, n: usize) -> PointCloud {
    let mut random = Random::new(3);
    let base = |i: usize| match n > cloud.len() {
        true => i % cloud.len(),
        false => i * cloud.len() / n,
    };
    let scatter = |i: usize, random: &mut Random| match i < cloud.len() {
        true => DVec3::ZERO,
        false => DVec3::from_array([(); 3].map(|()| random.uniform(-SCATTER, SCATTER))),
    };
    PointCloud {
        positions: (0..n)
            .map(|i| cloud.positions[base(i)] + scatter(i, &mut random))
            .collect(),
        colors: (0..n).map(|i| cloud.colors[base(i)]).collect(),
        confidence: None,
    }
}

/// A PLY file of `cloud`.
pub(crate) fn ply(cloud: &PointCloud) -> Vec<u8> {
    let names = ["x", "y", "z"]
        .map(|name| format!("property float {name}\n"))
        .concat();
    let colors = ["red", "green", "blue"]
        .map(|name| format!("property uchar {name}\n"))
        .concat();
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{names}{colors}end_header\n",
        cloud.len()
    )
    .into_bytes();
    for (position, color) in cloud.positions.iter().zip(&cloud.colors) {
        bytes.extend(
            position
                .to_array()
                .iter()
                .flat_map(|v| (*v as f32).to_le_bytes()),
        );
        bytes.extend(color);
    }
    bytes
}
