//! Every reader of files, each with a good file to start from.

use std::path::PathBuf;

use gspotential::camera::Frame;
use gspotential::camera::json::{read_cameras, write_cameras};
use gspotential::config::Config;
use gspotential::error::Error;
use gspotential::gaussians::ply::{read_ply, write_ply};
use gspotential::gaussians::{Gaussians, n_sh};
use gspotential::metrics::lpips::{InputRange, Lpips};
use gspotential::run::Checkpoints;
use gspotential::scene::{PointCloud, Scene, read_cloud, read_photograph};
use gspotential::train::State;

use crate::build::{Folder, SIZE, encoded, png};
use crate::fixtures::{
    OPENGL, blender, gaussianobject, instant_ngp, instantsplat, nerfstudio, still_life,
};

/// A file that is damaged, in a folder of files that are not.
pub struct Target {
    folder: Folder,
    file: &'static str,
    good: Vec<u8>,
    read: Read,
}

type Read = fn(PathBuf, &Folder) -> Result<(), Error>;

impl Target {
    pub fn undamaged(&self) -> &[u8] {
        &self.good
    }

    pub fn read(&self, bytes: &[u8]) {
        self.folder.write(self.file, bytes);
        let path = self.folder.path().join(self.file);
        if let Err(e) = (self.read)(path, &self.folder) {
            let text = e.to_string();
            assert!(!text.contains('\n'), "more than a line: {text}");
        }
    }
}

/// A reader's name, the folder that it reads from, the file in it that is damaged, the reader.
type Entry = (&'static str, fn() -> Folder, &'static str, Read);

const READERS: [Entry; 25] = [
    ("colmap-cameras-txt", small, "sparse/0/cameras.txt", scene),
    ("colmap-images-txt", small, "sparse/0/images.txt", scene),
    (
        "colmap-cameras-bin",
        small_binary,
        "sparse/0/cameras.bin",
        scene,
    ),
    (
        "colmap-images-bin",
        small_binary,
        "sparse/0/images.bin",
        scene,
    ),
    ("cloud-ply", small, "sparse/0/points3D.ply", cloud),
    ("cloud-txt", points_txt, "points3D.txt", cloud),
    ("cloud-bin", points_bin, "points3D.bin", cloud),
    ("split", with_split, "split.json", scene),
    ("image-png", small, "images/a.png", scene),
    ("image-jpeg", with_jpeg, "images/a.png", scene),
    ("image-webp", with_webp, "images/a.png", scene),
    ("image-bmp", with_bmp, "images/a.png", scene),
    ("mask", with_mask, "masks/a.png", scene),
    (
        "npy",
        || instantsplat(&still_life()),
        "sparse_4/0/confidence_dsp.npy",
        scene,
    ),
    (
        "gaussianobject",
        || gaussianobject(&still_life()),
        "dust3r_4.json",
        scene,
    ),
    (
        "nerfstudio",
        || nerfstudio(&still_life(), OPENGL),
        "transforms.json",
        scene,
    ),
    (
        "instant-ngp",
        || instant_ngp(&still_life()),
        "transforms.json",
        scene,
    ),
    (
        "blender",
        || blender(&still_life()),
        "transforms_train.json",
        scene,
    ),
    ("config", config_file, "config.json", config),
    ("gaussians", gaussians_file, "point_cloud.ply", gaussians),
    ("cameras-json", cameras_file, "cameras.json", cameras),
    ("checkpoint", checkpoint_file, "state", checkpoint),
    ("safetensors", weights_file, "weights.safetensors", weights),
    ("prior", prior_file, "model.safetensors", prior),
    ("exif", exif_file, "exif", exif),
];

pub fn names() -> Vec<&'static str> {
    READERS.iter().map(|(name, ..)| *name).collect()
}

pub fn target(name: &str) -> Option<Target> {
    let (_, folder, file, read) = READERS.iter().find(|(known, ..)| *known == name)?;
    let folder = folder();
    let good = std::fs::read(folder.path().join(file)).expect("the undamaged file");
    let target = Target {
        folder,
        file,
        good,
        read: *read,
    };
    Some(target)
}

fn scene(_: PathBuf, folder: &Folder) -> Result<(), Error> {
    folder.load().map(|scene| hold(&scene))
}

/// What every scene that loads is promised to be.
fn hold(scene: &Scene) {
    for view in scene.train.iter().chain(&scene.test) {
        let camera = &view.camera;
        let size = (camera.width, camera.height);
        assert_eq!(size, (view.image.width, view.image.height));
        assert_eq!(view.image.rgb.len(), 3 * size.0 as usize * size.1 as usize);
        assert!(camera.fx > 0.0 && camera.fy > 0.0);
        let numbers = [camera.fx, camera.fy, camera.cx, camera.cy];
        assert!(numbers.iter().all(|v| v.is_finite()));
        assert!(camera.rotation.is_finite() && camera.translation.is_finite());
        assert!((camera.rotation.determinant() - 1.0).abs() < 1e-6);
    }
    assert!(!scene.train.is_empty() && !scene.cloud.is_empty());
    hold_cloud(&scene.cloud);
}

fn hold_cloud(cloud: &PointCloud) {
    assert_eq!(cloud.positions.len(), cloud.colors.len());
    let confidences = cloud.confidence.as_ref().map(Vec::len);
    assert!(confidences.is_none_or(|n| n == cloud.len()));
}

fn cloud(path: PathBuf, _: &Folder) -> Result<(), Error> {
    read_cloud(&path).map(|cloud| hold_cloud(&cloud))
}

fn config(path: PathBuf, _: &Folder) -> Result<(), Error> {
    Config::from_file(&path).map(|_| ())
}

fn gaussians(path: PathBuf, _: &Folder) -> Result<(), Error> {
    let gaussians = read_ply(&path)?.gaussians;
    let n = gaussians.len();
    assert_eq!(
        (gaussians.scales_log.len(), gaussians.rotations_wxyz.len()),
        (n, n)
    );
    assert_eq!(gaussians.opacity_logits.len(), n);
    assert_eq!(gaussians.sh.len(), 3 * n * n_sh(gaussians.sh_degree));
    Ok(())
}

fn cameras(path: PathBuf, _: &Folder) -> Result<(), Error> {
    read_cameras(&path).map(|_| ())
}

/// With the checksum put right: it would keep everything behind it from being reached.
fn checkpoint(path: PathBuf, folder: &Folder) -> Result<(), Error> {
    let mut bytes = std::fs::read(&path).expect("the file just written");
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    folder.write(CHECKPOINT, bytes);
    Checkpoints::new(folder.path().to_owned())
        .newest::<State>()
        .map(|_| ())
}

fn weights(path: PathBuf, _: &Folder) -> Result<(), Error> {
    Lpips::read(&path, InputRange::Unit).map(|_| ())
}

fn prior(path: PathBuf, _: &Folder) -> Result<(), Error> {
    gspotential::prior::check(&path).map(|_| ())
}

/// In a photograph that is otherwise in order.
fn exif(path: PathBuf, folder: &Folder) -> Result<(), Error> {
    use image::ImageEncoder;
    let exif = std::fs::read(&path).expect("the file just written");
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif).expect("PNGs have them");
    let picture = crate::build::picture(8, 4);
    encoder
        .write_image(&picture, 8, 4, image::ExtendedColorType::Rgb8)
        .expect("a picture");
    folder.write("photograph.png", bytes);
    let photograph = read_photograph(&folder.path().join("photograph.png"))?;
    let (width, height) = (photograph.image.width, photograph.image.height);
    assert_eq!((width * height, photograph.image.rgb.len()), (32, 96));
    assert!(
        photograph
            .focal_35mm
            .is_none_or(|mm| mm > 0.0 && mm.is_finite())
    );
    Ok(())
}

/// Six views on a line and three points.
fn small() -> Folder {
    Folder::with_views(&["a.png", "b.png", "c.png", "d.png", "e.png", "f.png"])
}

fn small_and(file: &str, bytes: impl AsRef<[u8]>) -> Folder {
    let folder = small();
    folder.write(file, bytes);
    folder
}

fn with_split() -> Folder {
    small_and(
        "split.json",
        r#"{"train": ["a.png", "c.png"], "test": ["b.png"]}"#,
    )
}

fn with_jpeg() -> Folder {
    with_photograph(image::ImageFormat::Jpeg)
}

fn with_webp() -> Folder {
    with_photograph(image::ImageFormat::WebP)
}

fn with_bmp() -> Folder {
    with_photograph(image::ImageFormat::Bmp)
}

fn with_photograph(format: image::ImageFormat) -> Folder {
    small_and("images/a.png", encoded(SIZE.0, SIZE.1, format))
}

fn with_mask() -> Folder {
    small_and("masks/a.png", png(SIZE.0, SIZE.1))
}

/// [`small`] as COLMAP's binary model.
fn small_binary() -> Folder {
    let folder = small();
    let number = |v: f64| v.to_le_bytes();
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend([1i32, 1].iter().flat_map(|v| v.to_le_bytes()));
    cameras.extend(
        [SIZE.0, SIZE.1]
            .iter()
            .flat_map(|v| u64::from(*v).to_le_bytes()),
    );
    cameras.extend([10.0, 11.0, 6.5, 3.5].into_iter().flat_map(number));
    let mut images = 6u64.to_le_bytes().to_vec();
    for (i, name) in ["a.png", "b.png", "c.png", "d.png", "e.png", "f.png"]
        .iter()
        .enumerate()
    {
        images.extend((i as i32).to_le_bytes());
        images.extend(
            [1.0, 0.0, 0.0, 0.0, -(i as f64), 0.0, 0.0]
                .into_iter()
                .flat_map(number),
        );
        images.extend(1i32.to_le_bytes());
        images.extend(name.bytes());
        images.push(0);
        images.extend(1u64.to_le_bytes());
        images.extend([0xee; 24]);
    }
    folder.write("sparse/0/cameras.bin", cameras);
    folder.write("sparse/0/images.bin", images);
    folder
}

fn points_txt() -> Folder {
    let folder = Folder::empty();
    folder.write(
        "points3D.txt",
        "# points\n1 0 0 5 1 2 3 0.5 1 0\n2 1 0 6 4 5 6 0.5\n",
    );
    folder
}

fn points_bin() -> Folder {
    let mut bytes = 2u64.to_le_bytes().to_vec();
    for (id, n_tracks) in [(1u64, 2usize), (2, 0)] {
        bytes.extend(id.to_le_bytes());
        bytes.extend([0.5f64, 1.0, 5.0].iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend([1, 2, 3]);
        bytes.extend(0.5f64.to_le_bytes());
        bytes.extend((n_tracks as u64).to_le_bytes());
        bytes.resize(bytes.len() + 8 * n_tracks, 0);
    }
    let folder = Folder::empty();
    folder.write("points3D.bin", bytes);
    folder
}

fn config_file() -> Folder {
    let config = Config::preset("paper").expect("a preset");
    let folder = Folder::empty();
    folder.write("config.json", serde_json::to_vec(&config).expect("JSON"));
    folder
}

fn gaussians_file() -> Folder {
    let folder = Folder::empty();
    let config = Config::preset("paper").expect("a preset").model;
    let cloud = still_life().cloud;
    let frame = Frame::IDENTITY;
    let mut few = cloud.clone();
    few.retain(&(0..cloud.len()).map(|i| i < 2).collect::<Vec<_>>());
    let gaussians = Gaussians::from_cloud(&few, &frame, &config).expect("Gaussians");
    write_ply(&folder.path().join("point_cloud.ply"), &gaussians, &frame).expect("a file");
    folder
}

fn cameras_file() -> Folder {
    let folder = Folder::empty();
    let cameras: Vec<_> = small()
        .scene()
        .train
        .into_iter()
        .map(|v| v.camera)
        .collect();
    write_cameras(
        &folder.path().join("cameras.json"),
        &cameras,
        glam::DVec3::ZERO,
    )
    .expect("a file");
    folder
}

const CHECKPOINT: &str = "0000000007.ckpt";

/// But for its checksum.
fn checkpoint_file() -> Folder {
    let folder = Folder::empty();
    let state = State {
        done: 7,
        n_gaussians: 1,
        stride: 1,
        sh_degree: 0,
        samples: Vec::new(),
        plans: Vec::new(),
        poses: None,
        guides: Vec::new(),
        signal: Vec::new(),
        trims: Vec::new(),
        partner: None,
        generator: 0,
    };
    Checkpoints::new(folder.path().to_owned())
        .save(7, &state, std::iter::once(Ok(vec![1, 2, 3, 4])))
        .expect("a checkpoint");
    let mut bytes = std::fs::read(folder.path().join(CHECKPOINT)).expect("a checkpoint");
    bytes.truncate(bytes.len() - 4);
    folder.write("state", bytes);
    folder
}

/// The first tensors that are looked for; a whole file would be megabytes.
fn weights_file() -> Folder {
    let header = r#"{"scaling_layer.shift":{"dtype":"F32","shape":[1,3,1,1],"data_offsets":[0,12]},"scaling_layer.scale":{"dtype":"F32","shape":[1,3,1,1],"data_offsets":[12,24]},"lin0.model.1.weight":{"dtype":"F32","shape":[1,64,1,1],"data_offsets":[24,280]},"net.slice1.0.weight":{"dtype":"F32","shape":[1],"data_offsets":[280,284]}}"#;
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.bytes());
    let values = [-0.030f32, -0.088, -0.188, 0.458, 0.448, 0.450];
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes.resize(bytes.len() + 260, 0);
    let folder = Folder::empty();
    folder.write("weights.safetensors", bytes);
    folder
}

/// The first tensors that tell the model; a whole file would be megabytes.
fn prior_file() -> Folder {
    let header = r#"{"model.backbone.pretrained.cls_token":{"dtype":"F32","shape":[1,1,16],"data_offsets":[0,64]},"model.backbone.pretrained.blocks.7.attn.q_norm.weight":{"dtype":"BF16","shape":[8],"data_offsets":[64,80]},"model.head.projects.0.weight":{"dtype":"F16","shape":[4,2,1,1],"data_offsets":[80,96]},"model.backbone.pretrained.blocks.0.norm1.weight":{"dtype":"F32","shape":[16],"data_offsets":[96,160]}}"#;
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.bytes());
    bytes.resize(bytes.len() + 160, 0);
    let folder = Folder::empty();
    folder.write("model.safetensors", bytes);
    folder
}

/// An orientation and a focal length on 35 mm film.
fn exif_file() -> Folder {
    let mut bytes = b"II*\0\x08\0\0\0\x02\0".to_vec();
    bytes.extend([0x12, 1, 3, 0, 1, 0, 0, 0, 6, 0, 0, 0]);
    bytes.extend([0x69, 0x87, 4, 0, 1, 0, 0, 0, 38, 0, 0, 0]);
    bytes.extend([0, 0, 0, 0, 1, 0]);
    bytes.extend([0x05, 0xa4, 3, 0, 1, 0, 0, 0, 35, 0, 0, 0]);
    bytes.extend([0; 4]);
    let folder = Folder::empty();
    folder.write("exif", bytes);
    folder
}
