//! Scenes: posed photographs and a point cloud, from disk or built in.

pub mod builtin;
mod bytes;
mod cloud;
mod decode;
mod formats;
mod images;
mod layout;
mod lens;
mod load;
mod masks;
mod npy;
mod ply;
mod protocol;
mod source;
mod split;
mod stamp;
mod undistort;

pub use source::{DEFAULT_BUILTIN_WIDTH, SceneSource};

use glam::DVec3;

use crate::camera::Camera;

pub use cloud::{read_cloud, thin};
pub use load::load;
pub use protocol::PoseProtocol;

/// A scene ready to train on. Images of the training and test views are decoded, at the size
/// the limits ask for; cameras match them.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Short name for tables: the folder's name, or `builtin`.
    pub name: String,
    /// What was taken from where, one line for the log.
    pub source: String,
    pub train: Vec<View>,
    pub test: Vec<View>,
    pub cloud: PointCloud,
    /// How the test cameras came into the frame of the training cameras.
    pub pose_protocol: PoseProtocol,
    /// What was dropped or assumed while loading, one line each, for the log.
    pub warnings: Vec<String>,
}

/// One photograph and its camera.
#[derive(Clone, Debug)]
pub struct View {
    pub camera: Camera,
    pub image: Image,
    /// Which pixels show the subject (`height * width`, row 0 on top), where the scene says.
    pub mask: Option<Vec<bool>>,
}

/// An 8-bit RGB image, row 0 on top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    pub width: u32,
    pub height: u32,
    /// `height * width * 3` bytes, sRGB as stored.
    pub rgb: Vec<u8>,
}

/// A DUSt3R-style point cloud in the scene's own frame; all arrays have one entry a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    pub positions: Vec<DVec3>,
    /// 8-bit sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Larger is surer; absent where the file has none.
    pub confidence: Option<Vec<f32>>,
}

impl PointCloud {
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// `clamp(c_i / median(c), 0, 1)` of the confidences `c`, one a point: their scale differs
    /// between the programs that write them, but half of a cloud counts as sure in all. Where
    /// the median is 0, points are sure or not at all.
    pub fn relative_confidence(&self) -> Option<Vec<f64>> {
        let confidence = self.confidence.as_ref().filter(|c| !c.is_empty())?;
        let mut sorted = confidence.clone();
        let middle = sorted.len() / 2;
        let median = f64::from(*sorted.select_nth_unstable_by(middle, f32::total_cmp).1);
        let relative = |c: &f32| match f64::from(*c) {
            c if median > 0.0 => (c / median).clamp(0.0, 1.0),
            c if c > 0.0 => 1.0,
            _ => 0.0,
        };
        Some(confidence.iter().map(relative).collect())
    }
}

/// What bounds a scene while it is loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadOptions {
    /// Images wider than this are scaled down to it (3DGS: 1600), unless `max_size` is given.
    pub max_width: u32,
    /// Bounds the longer side instead.
    pub max_size: Option<u32>,
    /// Names of the training views; otherwise `split.json`, otherwise the format's own, otherwise
    /// `n_train` uniformly.
    pub train_views: Option<Vec<String>>,
    /// Without a split file: this many training views, uniformly over the sorted names.
    pub n_train: usize,
    /// Without a split file: at most this many of the remaining views, uniformly.
    pub n_test: usize,
}
