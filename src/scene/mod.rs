//! A scene has posed photographs and a point cloud, from disk or built in.
//!
#![doc = include_str!("README.md")]

pub mod builtin;
mod cloud;
mod cut_out;
mod decode;
mod decoded;
mod exif;
mod fitted;
mod formats;
mod image_file;
mod images;
mod inverted;
mod jpeg;
mod layout;
mod lens;
mod load;
mod lookup;
mod masks;
mod origin;
mod own_cloud;
mod photographs;
mod ply;
mod priors;
mod protocol;
mod source;
mod split;
mod stamp;
mod undistort;
mod window;
mod write;

pub use source::{CloudSource, DEFAULT_BUILTIN_WIDTH, SceneSource};

use glam::DVec3;

use crate::camera::Camera;
use crate::config::{Config, OutsideMask};

pub use cloud::{random_like, read_cloud, thin};
pub use formats::other_clouds;
pub use load::{load, load_builtin, load_object};
pub use origin::n_cloud_views;
pub use photographs::{Photograph, PhotographFile, find_photographs, read_photograph};
pub use priors::{Prior, PriorFiles};
pub use protocol::PoseProtocol;
pub use write::{write_cloud, write_model};

/// A scene ready to train on. Images of the training and test views are decoded, at the size
/// the limits ask for; cameras match them.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Short name for tables: the folder's name, or `builtin`.
    pub name: String,
    /// The files that the scene was taken from, one line for the log.
    pub source: String,
    /// Training views, with their photographs.
    pub train: Vec<View>,
    /// Test views, which errors are measured at.
    pub test: Vec<View>,
    /// The cloud that training starts from, in the frame of the cameras.
    pub cloud: PointCloud,
    /// A sample of the cloud as it was where masks have dropped some of its points.
    pub whole_cloud: Option<PointCloud>,
    /// How the test cameras came into the frame of the training cameras.
    pub pose_protocol: PoseProtocol,
    /// Lines for the log that say what was dropped or assumed while loading.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Returns how many test views are training views, too: none, unless that was asked for.
    pub fn n_test_trained(&self) -> usize {
        let is_trained = |name: &str| self.train.iter().any(|view| view.camera.name == name);
        let test = self.test.iter();
        test.filter(|view| is_trained(&view.camera.name)).count()
    }
}

/// One photograph and its camera.
#[derive(Clone, Debug)]
pub struct View {
    /// Pose and intrinsics, at the image's size.
    pub camera: Camera,
    /// The photograph, decoded and at the size that the limits ask for.
    pub image: Image,
    /// The subject, if the scene says what it is.
    pub mask: Option<Mask>,
    /// What files say of its depths and normals, where training asks for them.
    pub prior: Option<Prior>,
}

impl View {
    /// Returns the target image: RGBA8, red in the lowest byte; alpha is 255, or 0 where a pixel
    /// does not count.
    pub fn goal(&self) -> Vec<u32> {
        let texels = self.image.texels().into_iter().enumerate();
        let counted = texels.map(|(i, texel)| if self.counts(i) { texel } else { 0 });
        counted.collect()
    }

    /// Returns whether training learns from a pixel, by its index.
    pub fn counts(&self, pixel: usize) -> bool {
        let ignored = self
            .mask
            .as_ref()
            .filter(|mask| mask.outside == Outside::Ignored);
        ignored.is_none_or(|mask| mask.set[pixel])
    }

    /// Returns whether a pixel, by its index, shows the photograph and is not left out by its mask.
    pub fn shows(&self, pixel: usize) -> bool {
        let mask = self.mask.as_ref();
        mask.is_none_or(|mask| mask.outside == Outside::Kept || mask.set[pixel])
    }

    /// Returns whether training learns from every pixel.
    pub fn counts_whole(&self) -> bool {
        self.mask
            .as_ref()
            .is_none_or(|mask| mask.outside != Outside::Ignored)
    }

    /// Returns whether the subject stands before the background colour.
    pub fn is_cut_out(&self) -> bool {
        self.mask
            .as_ref()
            .is_some_and(|mask| mask.outside == Outside::Background)
    }
}

/// The pixels of a photograph that show the subject.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// `height * width`, row 0 on top.
    pub set: Vec<bool>,
    /// How the pixels that are not set are treated.
    pub outside: Outside,
}

/// The use of the pixels that a mask leaves out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outside {
    /// The photograph's.
    Kept,
    /// The photograph's, but not for training.
    Ignored,
    /// They have the background colour.
    Background,
}

/// An 8-bit RGB image, row 0 on top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Columns of pixels.
    pub width: u32,
    /// Rows of pixels.
    pub height: u32,
    /// `height * width * 3` bytes, sRGB as stored.
    pub rgb: Vec<u8>,
}

impl Image {
    /// Returns the image as RGBA8 with alpha 255, red in the lowest byte.
    pub fn texels(&self) -> Vec<u32> {
        let pixels = self.rgb.chunks_exact(3);
        pixels
            .map(|p| u32::from_le_bytes([p[0], p[1], p[2], 255]))
            .collect()
    }
}

/// A DUSt3R-style point cloud in the scene's own frame; all arrays have one entry a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Places in the scene's own frame and unit.
    pub positions: Vec<DVec3>,
    /// 8-bit sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Larger is surer; absent where the file has none.
    pub confidence: Option<Vec<f32>>,
}

impl PointCloud {
    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Returns a checksum of all that a point has, in its order, the same on every platform.
    pub fn crc32(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        for position in &self.positions {
            position
                .to_array()
                .iter()
                .for_each(|v| hasher.update(&v.to_le_bytes()));
        }
        hasher.update(self.colors.as_flattened());
        for confidence in self.confidence.iter().flatten() {
            hasher.update(&confidence.to_le_bytes());
        }
        hasher.finalize()
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

/// Options that bound a scene while it is loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadOptions {
    /// Images wider than this are scaled down to it (3DGS: 1600), unless `max_size` is given.
    pub max_width: u32,
    /// Images whose longer side is longer than this are scaled down to it, whatever `max_width`
    /// says.
    pub max_size: Option<u32>,
    /// Names of the training views; otherwise `split.json`, otherwise the format's own, otherwise
    /// `n_train` uniformly.
    pub train_views: Option<Vec<String>>,
    /// Names of the test views; otherwise `split.json`, otherwise `n_test` uniformly.
    pub test_views: Option<Vec<String>>,
    /// Whether a view may be named in both lists. Errors at it say what a model can hold, not what
    /// it can tell of places that it has not seen.
    pub overlap: bool,
    /// The cloud to take; `None`: the scene's own.
    pub cloud: Option<CloudSource>,
    /// Whether a scene without a usable point is refused; a cloud that is there must be readable.
    pub needs_cloud: bool,
    /// Without a split file: this many training views, uniformly over the sorted names.
    pub n_train: usize,
    /// Without a split file: at most this many of the remaining views, uniformly.
    pub n_test: usize,
    /// Seed of a random cloud.
    pub seed: u64,
    /// The use of the pixels that a mask leaves out.
    pub outside_mask: OutsideMask,
    /// Colour of those pixels if they show the background, RGB in [0, 1].
    pub background: [f64; 3],
    /// The files of depths and normals that are read beside the training photographs.
    pub priors: Option<PriorFiles>,
}

impl LoadOptions {
    /// Takes what `config` says, with the scene's own split and cloud and without depths and normals.
    pub fn new(config: &Config) -> LoadOptions {
        LoadOptions {
            max_width: config.scene.max_width_px,
            max_size: config.scene.max_size_px,
            train_views: None,
            test_views: None,
            overlap: false,
            cloud: None,
            needs_cloud: true,
            n_train: config.scene.n_train,
            n_test: config.scene.n_test,
            seed: config.seed,
            outside_mask: config.scene.outside_mask,
            background: config.model.background,
            priors: None,
        }
    }
}
