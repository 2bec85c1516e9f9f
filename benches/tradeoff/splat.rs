//! The side of a splatted point's square against the images of the bare point splat.

use gspotential::camera::Camera;
use gspotential::cloud::splat::splat_views;
use gspotential::config::Config;
use gspotential::error::Result;
use gspotential::eval::score_point_splat;
use gspotential::field::Focus;
use gspotential::scene::Scene;

use super::Measured;
use super::clock::of_cpu;

pub const ALL: &str = "point splat, all pixels";
pub const COVERED: &str = "point splat, covered pixels";

/// Times a splat a view at the test views and scores it against the photographs there.
pub fn measure(scene: &Scene, config: &Config, rounds: usize) -> Result<Vec<Measured>> {
    let cameras = |views: &[gspotential::scene::View]| -> Vec<Camera> {
        views.iter().map(|view| view.camera.clone()).collect()
    };
    let frame = Focus::find(&cameras(&scene.train), &scene.cloud)?.frame();
    let test = cameras(&scene.test);
    let sizes = [1, 2, 3, 4, 6, 8];
    let with = |size_px: u32| {
        let mut config = config.clone();
        config.splat.size_px = size_px;
        config
    };
    let mut best = [f64::INFINITY; 6];
    for _ in 0..rounds {
        for (best, size_px) in best.iter_mut().zip(sizes) {
            let settings = with(size_px);
            let near = config.model.near;
            let seconds =
                of_cpu(|| splat_views(&scene.cloud, &frame, &test, &settings.splat, near))?;
            *best = best.min(seconds / test.len().max(1) as f64);
        }
    }
    let mut measured = Vec::new();
    for (size_px, seconds) in sizes.into_iter().zip(best) {
        let score = score_point_splat(&scene.cloud, &frame, &scene.test, &with(size_px))?;
        for (choice, psnr) in [(ALL, score.psnr), (COVERED, score.psnr_covered)] {
            let psnr = psnr.unwrap_or(f64::NAN);
            measured.push(Measured {
                choice,
                setting: format!("{size_px} px"),
                kept: size_px == config.splat.size_px,
                seconds,
                error: 10f64.powf(-psnr / 20.0),
                note: format!("{psnr:.2} dB, {:.1} % covered", 100.0 * score.coverage),
            });
        }
    }
    Ok(measured)
}
