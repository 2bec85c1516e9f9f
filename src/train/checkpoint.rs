//! This module takes and restores the state of a training run between two iterations.
//!
//! Whatever else an iteration does follows from its number, the config and the supervision:
//! view orders, learning rates and random numbers are functions of it ([`super::schedule`],
//! [`super::policy`]). So a run that goes on from a state is, bit for bit, the one that was not
//! interrupted.

use std::collections::BTreeMap;

use super::generator::Generated;
use super::optimizer::Optimizer;
use super::state::{SetSize, State};
use super::supervision::{Supervision, TrainingView};
use super::trainer::Trainer;
use crate::error::{Error, Result};
use crate::gaussians::Gaussians;
use crate::gpu::PORTION;
use crate::render::{Model, most_gaussians};

impl Trainer<'_> {
    /// Returns the state as it is now.
    pub fn state(&self) -> State {
        let model = &self.optimizer.model;
        State {
            done: self.done,
            n_gaussians: model.n,
            stride: model.stride,
            sh_degree: model.sh_degree,
            samples: self.samples.clone(),
            plans: self.plans.clone(),
            poses: self.poses().cloned(),
            guides: self.guides.clone(),
            signal: self.signal.clone(),
            trims: self.trims.clone(),
            partner: self.partner.as_ref().map(|partner| SetSize {
                n_gaussians: partner.optimizer.model.n,
                stride: partner.optimizer.model.stride,
            }),
            generator: self.generated.as_ref().map_or(0, Generated::n_parameters),
        }
    }

    /// Reads the optimizer's buffers, then the partner's and the generator's, as bytes in a row, in portions that are read from the GPU when
    /// it is their turn.
    ///
    /// # Errors
    /// An item may be a GPU fault.
    pub fn buffers(&self) -> impl Iterator<Item = Result<Vec<u8>>> {
        let lens = self.state().buffer_lens();
        let partner = self.partner.iter().flat_map(|p| p.optimizer.buffers());
        let buffers = self.optimizer.buffers().into_iter().chain(partner);
        let buffers = buffers.zip(lens);
        let network = self.generated.iter().flat_map(Generated::buffers);
        let buffers = buffers.flat_map(move |(buffer, len)| {
            let bytes = 16 * len;
            (0..bytes).step_by(PORTION).map(move |first| {
                let mut portion = vec![0; PORTION.min(bytes - first)];
                buffer.read_into(self.gpu, first as u64, &mut portion)?;
                Ok(portion)
            })
        });
        buffers.chain(network.map(Ok))
    }

    /// Goes back or on to a state of this run; `buffers` are those of [`Trainer::buffers`] in a
    /// row.
    ///
    /// # Errors
    /// A state of another model, not its number of bytes, or more than the adapter can hold.
    pub fn restore(&mut self, state: State, buffers: &[u8]) -> Result<()> {
        let most = most_gaussians(self.gpu, state.sh_degree);
        let fits = state
            .sets()
            .all(|set| set.n_gaussians <= set.stride && set.stride <= most)
            && state.sh_degree == self.optimizer.model.sh_degree
            && state.partner.is_some() == self.partner.is_some()
            && state.generator == self.state().generator
            && state.poses.as_ref().map(Vec::len) == self.poses().map(Vec::len);
        let (n, degree) = (state.n_gaussians, state.sh_degree);
        if !fits {
            return Err(Error::new(format!(
                "the checkpoint has {n} Gaussians of SH degree {degree} with room for {}, which \
                 do not fit this run or this adapter",
                state.stride
            )));
        }
        let lens = state.buffer_lens();
        let n_network = 3 * size_of::<f32>() * state.generator;
        let expected = 16 * lens.iter().sum::<usize>() + n_network;
        if buffers.len() != expected {
            return Err(Error::new(format!(
                "the checkpoint has {} bytes, expected {expected} for {n} Gaussians of SH degree {degree}",
                buffers.len(),
            )));
        }
        let own = state.own_set();
        let n_own = 16 * own.buffer_lens(degree).iter().sum::<usize>();
        let (sets, network_bytes) = buffers.split_at(expected - n_network);
        let (own_bytes, other_bytes) = sets.split_at(n_own);
        self.refill(own, own_bytes)?;
        if let Some(set) = state.partner {
            self.in_partner(|trainer| {
                trainer.refill(set, other_bytes)?;
                trainer.fit_model()
            })?;
        }
        if let Some(generated) = &mut self.generated {
            generated.refill(network_bytes);
        }
        self.done = state.done;
        self.samples = state.samples;
        self.guides = state.guides;
        self.signal = state.signal;
        self.trims = state.trims;
        self.settling = self.settles();
        self.plans = state.plans;
        if let Some(poses) = state.poses {
            self.set_poses(poses);
        }
        self.generate();
        self.fit_model()
    }

    /// Makes the set anew at this size and fills its buffers from bytes in a row.
    fn refill(&mut self, set: SetSize, mut rest: &[u8]) -> Result<()> {
        let degree = self.optimizer.model.sh_degree;
        // What there was is free before as much is made again.
        self.unbind();
        self.optimizer = Optimizer::new(self.gpu, Model::zeros(self.gpu, 0, 0, degree)?)?;
        self.gpu.wait()?;
        let model = Model::zeros(self.gpu, set.n_gaussians, set.stride, degree)?;
        self.optimizer = Optimizer::new(self.gpu, model)?;
        // Those of the start; the buffers have them as they are by now.
        let gains = &self.supervision.position_gains;
        let kept = &gains[..gains.len().min(set.n_gaussians)];
        self.optimizer.set_position_gains(self.gpu, kept);
        for (buffer, len) in self
            .optimizer
            .buffers()
            .into_iter()
            .zip(set.buffer_lens(degree))
        {
            let (bytes, after) = rest.split_at(16 * len);
            buffer.write(self.gpu, bytes);
            rest = after;
        }
        Ok(())
    }
}

/// Returns a CRC-32 of everything that a run learns from, by name.
pub fn fingerprint(supervision: &Supervision, start: &Gaussians) -> BTreeMap<String, u32> {
    let mut parts = BTreeMap::new();
    for view in supervision.views() {
        let name = &view.camera.name;
        parts.insert(format!("image of `{name}`"), sum(&view.goal.parts()));
        if let Some(depths) = &view.depths {
            parts.insert(format!("depths of `{name}`"), sum(&depths.parts()));
        }
        parts.insert(format!("camera of `{name}`"), camera_sum(view));
    }
    let cloud = [
        bytemuck::cast_slice(&start.means),
        bytemuck::cast_slice(&start.scales_log),
        bytemuck::cast_slice(&start.rotations_wxyz),
        bytemuck::cast_slice(&start.opacity_logits),
        bytemuck::cast_slice(&start.sh),
    ];
    parts.insert("point cloud".to_owned(), sum(&cloud));
    if !supervision.position_gains.is_empty() {
        let gains = bytemuck::cast_slice(&supervision.position_gains);
        parts.insert("confidences of the cloud".to_owned(), sum(&[gains]));
    }
    parts
}

fn camera_sum(view: &TrainingView) -> u32 {
    let camera = &view.camera;
    let intrinsics = [camera.fx, camera.fy, camera.cx, camera.cy, view.weight];
    sum(&[
        bytemuck::bytes_of(&[camera.width, camera.height]),
        bytemuck::bytes_of(&intrinsics),
        bytemuck::bytes_of(&camera.rotation.to_cols_array()),
        bytemuck::bytes_of(&camera.translation.to_array()),
    ])
}

fn sum(parts: &[&[u8]]) -> u32 {
    let mut sum = crc32fast::Hasher::new();
    parts.iter().for_each(|part| sum.update(part));
    sum.finalize()
}
