//! Scenes: posed photographs and a point cloud, from disk or built in.

pub mod builtin;
mod bytes;
mod cloud;
mod colmap;
mod decode;
mod images;
mod load;
mod masks;
mod ply;
mod source;
mod split;
mod stamp;

pub use source::{DEFAULT_BUILTIN_WIDTH, SceneSource};

use glam::DVec3;

use crate::camera::Camera;

pub use cloud::{read_cloud, thin};
pub use load::load;

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
}

/// What bounds a scene while it is loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadOptions {
    /// Images wider than this are scaled down to it (3DGS: 1600), unless `max_size` is given.
    pub max_width: u32,
    /// Bounds the longer side instead.
    pub max_size: Option<u32>,
    /// Names of the training views; otherwise `split.json`, otherwise `n_train` uniformly.
    pub train_views: Option<Vec<String>>,
    /// Without a split file: this many training views, uniformly over the sorted names.
    pub n_train: usize,
    /// Without a split file: at most this many of the remaining views, uniformly.
    pub n_test: usize,
}
