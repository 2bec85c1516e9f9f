//! `report.html`: what is in it, that names are escaped, and that it lives in a browser.

pub(crate) mod browser;
mod comparison;
pub(crate) mod content;

use std::path::Path;

use glam::{DMat3, DVec3, Vec3};
use gspotential::camera::json::write_cameras;
use gspotential::camera::{Camera, Frame};
use gspotential::config::Config;
use gspotential::gaussians::Gaussians;
use gspotential::gaussians::ply::write_ply;
use gspotential::metrics::ViewScore;
use gspotential::report::{write_png, write_run_page};
use gspotential::run::{
    CurvePoint, Evaluation, Memory, Metrics, ModelSize, RunDir, SceneRecord, Seconds, file_names,
};
use gspotential::scene::PoseProtocol;
use gspotential::scene::{Image, View};
use gspotential::train::{ImageLoss, LossSample};

const SIZE: (u32, u32) = (60, 40);

/// Not the centre.
const PRINCIPAL: (f64, f64) = (33.0, 18.0);

pub(crate) fn camera(name: &str, azimuth: f64) -> Camera {
    let any = Camera {
        name: String::new(),
        width: SIZE.0,
        height: SIZE.1,
        fx: 60.0,
        fy: 60.0,
        cx: PRINCIPAL.0,
        cy: PRINCIPAL.1,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let eye = DVec3::new(azimuth.cos(), -0.3, azimuth.sin());
    any.looking_at(name.to_owned(), eye, DVec3::ZERO, DVec3::NEG_Y)
}

fn plain(color: [u8; 3]) -> Image {
    Image {
        width: SIZE.0,
        height: SIZE.1,
        rgb: color.repeat((SIZE.0 * SIZE.1) as usize),
    }
}

/// One opaque red ball at the focus.
pub(crate) fn ball() -> Gaussians {
    Gaussians {
        means: vec![Vec3::ZERO],
        scales_log: vec![Vec3::splat(0.1f32.ln())],
        rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![6.0],
        sh: vec![1.7, -1.7, -1.7],
        sh_degree: 0,
    }
}

/// The page of a finished run with one test view named `name`.
fn run_with(root: &Path, name: &str) -> String {
    std::fs::read_to_string(finished(root, name).report()).unwrap()
}

/// The photograph at the test view.
pub(crate) fn photograph(name: &str) -> View {
    View {
        camera: camera(name, 0.4),
        image: plain([10, 10, 200]),
        mask: None,
        prior: None,
    }
}

/// A finished run with one test view named `name`, and its page in it.
pub(crate) fn finished(root: &Path, name: &str) -> RunDir {
    let config = Config::preset("paper").unwrap();
    let run = RunDir::create(root, &config, false).unwrap();
    let cameras = [
        camera("a.png", 0.0),
        camera("b.png", 0.8),
        photograph(name).camera,
        camera("virtual_000", 2.0),
    ];
    write_cameras(&run.cameras(), &cameras, DVec3::ZERO).unwrap();
    write_ply(&run.point_cloud(), &ball(), &Frame::IDENTITY).unwrap();
    write_png(&run.virtual_sheet(), &plain([90; 3])).unwrap();
    let file = &file_names(&[name], "png")[0];
    write_png(&run.test_views().join(file), &plain([200, 10, 10])).unwrap();
    run.write_metrics(&metrics(name)).unwrap();
    let score = ViewScore {
        name: name.to_owned(),
        psnr: Some(12.34),
        ssim: Some(0.5),
        lpips: None,
        fitted_psnr: None,
        masked: None,
        covered: None,
    };
    run.write_evaluation(&Evaluation::new(vec![score], 1, Some(7.0)))
        .unwrap();
    write_run_page(&run, &[photograph(name)], &Frame::IDENTITY).unwrap();
    run
}

pub(crate) fn metrics(name: &str) -> Metrics {
    let part = ImageLoss { l1: 0.1, ssim: 0.7 };
    let sample = |iteration| LossSample {
        iteration,
        loss: 0.2,
        real: part,
        virt: Some(part),
        depths: None,
    };
    let curve = |iteration, psnr| CurvePoint {
        iteration,
        n_gaussians: 1,
        train_s: None,
        psnr: Some(psnr),
        ssim: Some(0.5),
    };
    Metrics {
        version: "0".to_owned(),
        commit: None,
        adapter: name.to_owned(),
        rasterizer: None,
        seed: 0,
        iterations: 20,
        scene: SceneRecord {
            source: name.to_owned(),
            name: name.to_owned(),
            train_views: vec!["a.png".to_owned(), "b.png".to_owned()],
            test_views: vec![name.to_owned()],
            n_test_trained: 0,
            cloud: None,
            n_points: 1,
            cloud_crc32: None,
            thumbnails: None,
            virtual_images: None,
            carved_points: None,
            pose_protocol: PoseProtocol::SharedFrame,
        },
        seconds: Seconds::default(),
        memory: Memory::default(),
        loss: vec![sample(10), sample(20)],
        model_size: vec![ModelSize {
            iteration: 0,
            n_gaussians: 1,
            plan: None,
        }],
        refined_poses: Vec::new(),
        curve: vec![curve(10, 11.0), curve(20, 12.34)],
        signal: Vec::new(),
        trims: Vec::new(),
        lowering: None,
        energy_j: None,
        chosen: vec!["1,000 iterations: enough & no more".into()],
    }
}
