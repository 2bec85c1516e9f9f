//! This module has poses as the network has them: encoded in nine numbers, decoded, normalised.

use glam::{DMat3, DQuat, DVec3};

use super::block::{Block, BlockSpec};
use super::layers::{LayerNorm, Linear, relu};
use super::math::gelu;
use super::model::Model;
use super::weights::Weights;
use crate::camera::Camera;
use crate::error::{Error, Result};

/// Translation and quaternion (x y z w) of camera-to-world, then the vertical and the horizontal
/// field of view in radians.
pub type PoseEncoding = [f32; 9];

/// Distances from the first camera are never divided by less.
const MIN_SCALE: f64 = 0.1;
const EPSILON: f32 = 1e-5;
/// Heads of the camera encoder, whatever its width.
const ENCODER_HEADS: usize = 16;
const ENCODER_BLOCKS: usize = 4;
/// Least tangent of half a field of view.
const MIN_TANGENT: f64 = 1e-6;

/// Turns known cameras into tokens.
pub(super) struct CameraEncoder {
    fc1: Linear,
    fc2: Linear,
    token_norm: LayerNorm,
    trunk: Vec<Block>,
    trunk_norm: LayerNorm,
}

impl CameraEncoder {
    pub(crate) fn read(weights: &mut Weights, model: &Model) -> Result<CameraEncoder> {
        let c = model.channels;
        let spec = BlockSpec {
            channels: c,
            n_heads: ENCODER_HEADS,
            norm_epsilon: EPSILON,
            qk_norm: false,
        };
        let block = |weights: &mut Weights, i: usize| {
            Block::read(weights, &format!("cam_enc.trunk.{i}"), spec)
        };
        Ok(CameraEncoder {
            fc1: Linear::read(weights, "cam_enc.pose_branch.fc1", 9, c / 2)?,
            fc2: Linear::read(weights, "cam_enc.pose_branch.fc2", c / 2, c)?,
            token_norm: LayerNorm::read(weights, "cam_enc.token_norm", c, EPSILON)?,
            trunk: (0..ENCODER_BLOCKS)
                .map(|i| block(weights, i))
                .collect::<Result<_>>()?,
            trunk_norm: LayerNorm::read(weights, "cam_enc.trunk_norm", c, EPSILON)?,
        })
    }

    /// Encodes cameras to tokens, `[views][channels]`.
    pub(crate) fn apply(&self, encodings: &[PoseEncoding]) -> Vec<f32> {
        let mut hidden = self.fc1.apply(encodings.as_flattened());
        gelu(&mut hidden);
        let mut x = self.token_norm.apply(&self.fc2.apply(&hidden));
        for block in &self.trunk {
            block.apply(&mut x, encodings.len(), None);
        }
        self.trunk_norm.apply(&x)
    }
}

/// Turns the camera tokens of the last output block into poses.
pub(super) struct CameraDecoder {
    hidden: [Linear; 2],
    translation: Linear,
    quaternion: Linear,
    fov: Linear,
}

impl CameraDecoder {
    pub(crate) fn read(weights: &mut Weights, model: &Model) -> Result<CameraDecoder> {
        let c = 2 * model.channels;
        let mut linear = |name: &str, n| Linear::read(weights, &format!("cam_dec.{name}"), c, n);
        Ok(CameraDecoder {
            hidden: [linear("backbone.0", c)?, linear("backbone.2", c)?],
            translation: linear("fc_t", 3)?,
            quaternion: linear("fc_qvec", 4)?,
            fov: linear("fc_fov.0", 2)?,
        })
    }

    /// Decodes tokens to one encoding for each row of `[views][2 channels]`.
    pub(crate) fn apply(&self, tokens: &[f32]) -> Vec<PoseEncoding> {
        let mut x = tokens.to_vec();
        for layer in &self.hidden {
            x = layer.apply(&x);
            relu(&mut x);
        }
        let (translation, quaternion) = (self.translation.apply(&x), self.quaternion.apply(&x));
        let mut fov = self.fov.apply(&x);
        relu(&mut fov);
        let parts = translation.as_chunks::<3>().0.iter();
        let parts = parts
            .zip(quaternion.as_chunks::<4>().0)
            .zip(fov.as_chunks::<2>().0);
        parts
            .map(|((&[a, b, c], &[x, y, z, w]), &[v, h])| [a, b, c, x, y, z, w, v, h])
            .collect()
    }
}

/// Returns the camera that an encoding stands for, with its principal point in the middle of the
/// image.
///
/// # Errors
/// Values that are not finite, or a quaternion of no length.
pub fn decode(encoding: &PoseEncoding, name: &str, width: u32, height: u32) -> Result<Camera> {
    let [tx, ty, tz, x, y, z, w, fov_y, fov_x] = encoding.map(f64::from);
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let is_usable = encoding.iter().all(|value| value.is_finite()) && quaternion.length() > 1e-12;
    if !is_usable {
        return Err(Error::new(format!(
            "the network's pose of `{name}` is not a pose: {encoding:?}"
        ))
        .way_out("the photograph may show nothing to go by: leave it out"));
    }
    let rotation = DMat3::from_quat(quaternion.normalize()).transpose();
    let focal = |side: u32, fov: f64| f64::from(side) / 2.0 / (fov / 2.0).tan().max(MIN_TANGENT);
    Ok(Camera {
        name: name.to_owned(),
        width,
        height,
        fx: focal(width, fov_x),
        fy: focal(height, fov_y),
        cx: f64::from(width) / 2.0,
        cy: f64::from(height) / 2.0,
        rotation,
        translation: -(rotation * DVec3::new(tx, ty, tz)),
    })
}

/// Encodes a camera. Its principal point is not in it.
pub fn encode(camera: &Camera) -> PoseEncoding {
    let center = camera.center();
    let [x, y, z, w] = quaternion(camera.rotation.transpose());
    let fov = |side: u32, focal: f64| 2.0 * (f64::from(side) / 2.0 / focal).atan();
    let (v, h) = (fov(camera.height, camera.fy), fov(camera.width, camera.fx));
    [center.x, center.y, center.z, x, y, z, w, v, h].map(|value| value as f32)
}

/// Returns the quaternion (x y z w, w not negative) of a rotation, by the largest of its four
/// candidates.
fn quaternion(rotation: DMat3) -> [f64; 4] {
    let [a, b, c] = [rotation.row(0), rotation.row(1), rotation.row(2)];
    // Four times the square of w, x, y and z.
    let squares = [
        1.0 + a.x + b.y + c.z,
        1.0 + a.x - b.y - c.z,
        1.0 - a.x + b.y - c.z,
        1.0 - a.x - b.y + c.z,
    ];
    let (wx, wy, wz) = (c.y - b.z, a.z - c.x, b.x - a.y);
    let (xy, xz, yz) = (b.x + a.y, a.z + c.x, b.z + c.y);
    let products = [
        [squares[0], wx, wy, wz],
        [wx, squares[1], xy, xz],
        [wy, xy, squares[2], yz],
        [wz, xz, yz, squares[3]],
    ];
    let mut largest = 0;
    for i in 1..4 {
        if squares[i] > squares[largest] {
            largest = i;
        }
    }
    let size = 2.0 * squares[largest].max(0.0).sqrt().max(0.1);
    let [w, x, y, z] = products[largest].map(|product| product / size);
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    [x, y, z, w].map(|value| sign * value)
}

/// Returns the cameras in the frame of the first, and in a unit in which the median of their
/// distances from it is 1: the lower of two medians, the first camera's 0 among them.
pub fn normalized(cameras: &[Camera]) -> Vec<Camera> {
    let Some(first) = cameras.first() else {
        return Vec::new();
    };
    let turned = |camera: &Camera| {
        let rotation = camera.rotation * first.rotation.transpose();
        Camera {
            rotation,
            translation: camera.translation - rotation * first.translation,
            ..camera.clone()
        }
    };
    let mut cameras: Vec<Camera> = cameras.iter().map(turned).collect();
    let mut distances: Vec<f64> = cameras.iter().map(|c| c.center().length()).collect();
    distances.sort_by(f64::total_cmp);
    let scale = distances[(distances.len() - 1) / 2].max(MIN_SCALE);
    for camera in &mut cameras {
        camera.translation /= scale;
    }
    cameras
}
