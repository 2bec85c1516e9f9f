//! The network as training has it, and how what it makes becomes Gaussians.

use glam::Vec3;
use nalgebra::DMatrix;

use super::Generator;
use crate::config::Config;
use crate::gaussians::Gaussians;

/// Share of the Gaussians that lie within the planes; those beyond see the border.
const WITHIN: f64 = 0.95;

/// The network, and how what it makes becomes Gaussians.
pub(in crate::train) struct Generated {
    pub(in crate::train) network: Generator<f32>,
    /// Half of a plane's side, in `R`.
    pub(in crate::train) reach: f32,
    /// The logarithms of the first scales.
    pub(in crate::train) scales_log: Vec<Vec3>,
    /// Centres as last made, in `R`.
    pub(in crate::train) means: Vec<Vec3>,
}

impl Generated {
    /// Draws a network for `start`.
    pub(in crate::train) fn new(start: &Gaussians, config: &Config) -> Generated {
        let reach = reach(&start.means);
        let places = DMatrix::from_fn(3, start.len(), |row, i| {
            f64::from(start.means[i][row] / reach)
        });
        let noise_side = config.generator.noise_side as usize;
        Generated {
            network: Generator::new(&places, noise_side, config.seed),
            reach,
            scales_log: start.scales_log.clone(),
            means: Vec::new(),
        }
    }

    /// Returns the number of the network's parameters.
    pub(in crate::train) fn n_parameters(&self) -> usize {
        self.network.parameters.len()
    }

    /// Returns the parameters and their moments as bytes.
    pub(in crate::train) fn buffers(&self) -> impl Iterator<Item = Vec<u8>> {
        let moments = self.network.moments.iter();
        let all = std::iter::once(&self.network.parameters).chain(moments);
        all.map(|values| bytemuck::cast_slice(values).to_vec())
    }

    /// Takes up what [`Generated::buffers`] has returned, in a row and whole.
    pub(in crate::train) fn refill(&mut self, bytes: &[u8]) {
        let network = &mut self.network;
        let [first, second] = &mut network.moments;
        let own = [&mut network.parameters, first, second];
        let parts = bytes.chunks_exact(bytes.len() / own.len());
        for (own, bytes) in own.into_iter().zip(parts) {
            bytemuck::cast_slice_mut(own).copy_from_slice(bytes);
        }
    }
}

/// Returns the half side of the cube about the focus in which most of the places lie.
fn reach(means: &[Vec3]) -> f32 {
    let mut sizes: Vec<f32> = means.iter().map(|mean| mean.abs().max_element()).collect();
    sizes.sort_by(f32::total_cmp);
    let within = (WITHIN * sizes.len() as f64) as usize;
    let reach = sizes.get(within).copied().unwrap_or(1.0);
    if reach > 0.0 { reach } else { 1.0 }
}

/// Returns what the network and its work take on the host, for `n` Gaussians.
pub fn generator_bytes(n: usize, config: &Config) -> u64 {
    match config.generator.enabled {
        true => Generator::<f32>::bytes(n, config.generator.noise_side as usize),
        false => 0,
    }
}
