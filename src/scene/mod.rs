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

pub use source::{CloudSource, DEFAULT_BUILTIN_WIDTH, SceneSource};

use glam::DVec3;

use crate::camera::Camera;
use crate::config::Config;

pub use cloud::{random_like, read_cloud, thin};
pub use colmap::other_clouds;
pub use load::{load, load_builtin};

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

    /// Keeps the points that `kept`, one entry a point, says true of, in their order.
    pub fn retain(&mut self, kept: &[bool]) {
        fn filter<T: Copy>(values: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            values.retain(|_| kept.next().copied().unwrap_or(false));
        }
        filter(&mut self.positions, kept);
        filter(&mut self.colors, kept);
        if let Some(confidence) = &mut self.confidence {
            filter(confidence, kept);
        }
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
    /// Names of the test views; otherwise `split.json`, otherwise `n_test` uniformly.
    pub test_views: Option<Vec<String>>,
    /// Otherwise the scene's own.
    pub cloud: Option<CloudSource>,
    /// Without a split file: this many training views, uniformly over the sorted names.
    pub n_train: usize,
    /// Without a split file: at most this many of the remaining views, uniformly.
    pub n_test: usize,
    /// Of a random cloud.
    pub seed: u64,
}

impl LoadOptions {
    /// What `config` says, and the scene's own split and cloud.
    pub fn new(config: &Config) -> LoadOptions {
        LoadOptions {
            max_width: config.scene.max_width_px,
            max_size: config.scene.max_size_px,
            train_views: None,
            test_views: None,
            cloud: None,
            n_train: config.scene.n_train,
            n_test: config.scene.n_test,
            seed: config.seed,
        }
    }
}
