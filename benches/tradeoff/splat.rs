//! The footprint of a splatted point against the images of the bare point splat.

use gspotential::camera::Camera;
use gspotential::cloud::splat::splat_views;
use gspotential::config::{Config, Footprint, SplatConfig};
use gspotential::error::Result;
use gspotential::eval::score_splats;
use gspotential::field::Focus;
use gspotential::scene::Scene;

use super::Measured;
use super::clock::of_cpu;

pub(crate) const ALL: &str = "point splat, all pixels";
pub(crate) const COVERED: &str = "point splat, covered pixels";

/// Times a splat a view at the test views and scores it against the photographs there.
pub(crate) fn measure(scene: &Scene, config: &Config, rounds: usize) -> Result<Vec<Measured>> {
    let cameras = |views: &[gspotential::scene::View]| -> Vec<Camera> {
        views.iter().map(|view| view.camera.clone()).collect()
    };
    let frame = Focus::find(&cameras(&scene.train), &scene.cloud)?.frame();
    let test = cameras(&scene.test);
    let train = cameras(&scene.train);
    let footprints = [("pixel", Footprint::Pixel), ("disc", Footprint::Disc)];
    let splat = |footprint: Footprint| {
        let settings = SplatConfig {
            footprint,
            ..config.splat.clone()
        };
        let near = config.model.near;
        splat_views(&scene.cloud, &frame, (&test, &train), &settings, near)
    };
    let mut best = [f64::INFINITY; 2];
    for _ in 0..rounds {
        for (best, (_, footprint)) in best.iter_mut().zip(footprints) {
            let seconds = of_cpu(|| splat(footprint))?;
            *best = best.min(seconds / test.len().max(1) as f64);
        }
    }
    let mut measured = Vec::new();
    for ((name, footprint), seconds) in footprints.into_iter().zip(best) {
        let score = score_splats(&splat(footprint)?, &scene.test)?;
        for (choice, psnr) in [(ALL, score.psnr), (COVERED, score.psnr_covered)] {
            let psnr = psnr.unwrap_or(f64::NAN);
            measured.push(Measured {
                choice,
                setting: name.to_owned(),
                kept: footprint == config.splat.footprint,
                seconds,
                error: 10f64.powf(-psnr / 20.0),
                note: format!("{psnr:.2} dB, {:.1} % covered", 100.0 * score.coverage),
            });
        }
    }
    Ok(measured)
}
