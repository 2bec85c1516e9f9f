//! This module finds depth, confidence and cameras from photographs alone. It is an independent
//! implementation of the inference of Depth Anything 3 (Lin et al. 2025, arXiv 2511.10647; its
//! program is under Apache-2.0), whose backbone is after DINOv2 (Oquab et al. 2023, Apache-2.0).
//! Weights are not included and have their own licences.
//!
//! Everything is f32, and the same bytes for any number of threads on one machine. Images are
//! `[views][3][height][width]`, everything inside is `[token][channel]` or
//! `[height][width][channel]`. Extrinsics are world-to-camera, pixel centres at +0.5, and depth is
//! along the viewing direction in the unit of the cameras' centres.

mod backbone;
mod block;
mod head;
mod images;
mod layers;
mod maps;
mod math;
mod memory;
mod model;
mod pose;
mod rays;
mod reference_view;
mod rope;
mod weights;

use std::path::Path;

pub use images::{Images, Prepared, prepare};
pub use memory::{Memory, memory};
pub use model::Model;
pub use pose::{PoseEncoding, decode, encode, normalized};
pub use rays::camera_of_rays;

use crate::camera::Camera;
use crate::error::Result;
use backbone::Backbone;
use head::{Dense, Head};
use pose::{CameraDecoder, CameraEncoder};
use weights::Weights;

/// Side of the patches that become tokens.
pub const PATCH_PX: usize = 14;

/// What to do without weights.
pub const DOWNLOAD: &str = "download model.safetensors of depth-anything/DA3-SMALL (137 MB) or \
    depth-anything/DA3-BASE (541 MB) from huggingface.co, both under Apache-2.0";

/// Is shown every stage by name and values: those of all views, or those of one view after the
/// other.
pub type Watch<'a> = &'a mut dyn FnMut(&str, &[f32]);

/// The network with its weights.
pub struct Network {
    model: Model,
    backbone: Backbone,
    head: Head,
    encoder: CameraEncoder,
    decoder: CameraDecoder,
}

/// The network's predictions for all views.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// In the order of the images.
    pub views: Vec<ViewPrediction>,
    /// The view near whose frame the cameras are.
    pub reference: usize,
}

/// The network's predictions for one view.
#[derive(Clone, Debug)]
pub struct ViewPrediction {
    /// Camera as the network encodes it; [`decode`] makes a camera of it.
    pub pose: PoseEncoding,
    /// `[height][width]`, above 0.
    pub depth: Vec<f32>,
    /// `[height][width]`, above 1.
    pub confidence: Vec<f32>,
    /// The rays, if they were asked for.
    pub rays: Option<Rays>,
}

/// A coarser grid of rays, `[height][width]`.
#[derive(Clone, Debug)]
pub struct Rays {
    /// Rows of the grid.
    pub height: usize,
    /// Columns of the grid.
    pub width: usize,
    /// Direction, on the plane at depth 1 after division, and origin of each.
    pub rays: Vec<[f32; 6]>,
    /// Above 1.
    pub confidence: Vec<f32>,
}

/// The outputs of the network that are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outputs {
    /// Depth, confidence and poses.
    Depth,
    /// A ray for each pixel of a coarser grid, too: half as much again of the head's work.
    DepthAndRays,
}

/// Tells which model a file of weights holds, all of whose tensors the network needs have the
/// right shapes, without reading them.
///
/// # Errors
/// A file that is none, that is cut short or of another model; what is wrong and what to do.
pub fn check(path: &Path) -> Result<Model> {
    let mut weights = Weights::open(path)?;
    weights.set_dry(true);
    Ok(Network::build(&mut weights, Outputs::DepthAndRays)?.model)
}

impl Network {
    /// Reads the weights that the outputs need.
    ///
    /// # Errors
    /// As [`check`], and values that are not finite.
    pub fn read(path: &Path, outputs: Outputs) -> Result<Network> {
        let mut weights = Weights::open(path)?;
        // Everything that is wrong with names and shapes is found before seconds of reading.
        weights.set_dry(true);
        Self::build(&mut weights, Outputs::DepthAndRays)?;
        weights.set_dry(false);
        Self::build(&mut weights, outputs)
    }

    fn build(weights: &mut Weights, outputs: Outputs) -> Result<Network> {
        let model = Model::of(weights)?;
        Ok(Network {
            backbone: Backbone::read(weights, &model)?,
            head: Head::read(weights, &model, outputs == Outputs::DepthAndRays)?,
            encoder: CameraEncoder::read(weights, &model)?,
            decoder: CameraDecoder::read(weights, &model)?,
            model,
        })
    }

    /// Returns the sizes of the network, told from its weights.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Predicts depth, confidence and pose of every image. `cameras`, one an image at the images'
    /// size, are what is known of them; poses are predicted all the same. `watch` sees every stage
    /// by its name: `block_0` and so on, then `depth` for each view.
    pub fn predict(
        &self,
        images: &Images,
        cameras: Option<&[Camera]>,
        watch: Watch<'_>,
    ) -> Prediction {
        let tokens = cameras.map(|cameras| {
            let encodings: Vec<PoseEncoding> = normalized(cameras).iter().map(encode).collect();
            watch("input_pose_enc", encodings.as_flattened());
            let tokens = self.encoder.apply(&encodings);
            watch("cam_token", &tokens);
            tokens
        });
        let features = self.backbone.apply(images, tokens.as_deref(), watch);
        let poses = self.decoder.apply(&features.camera);
        watch("pose_enc", poses.as_flattened());
        let patches = images.patches();
        let n = patches.0 * patches.1 * 2 * self.model.channels;
        let views = poses.into_iter().enumerate().map(|(view, pose)| {
            let maps: [&[f32]; 4] = std::array::from_fn(|k| &features.maps[k][view * n..][..n]);
            let Dense {
                depth,
                confidence,
                rays,
            } = self.head.apply(maps, patches, watch);
            ViewPrediction {
                pose,
                depth,
                confidence,
                rays,
            }
        });
        Prediction {
            views: views.collect(),
            reference: features.reference,
        }
    }
}
