//! What the CPU does before training, against virtual views and points.

use gspotential::camera::Camera;
use gspotential::cloud::splat::splat_views;
use gspotential::config::Config;
use gspotential::error::{Error, Result};
use gspotential::files::write_file;
use gspotential::gaussians::Gaussians;
use gspotential::pipeline::{Prepared, focus_of, prepare};
use gspotential::run::{Seconds, peak_host_bytes};
use gspotential::scene::read_cloud;

use super::clock::of_cpu;
use super::{Args, Figure, POINTS, VIEWS, cloud, sizes};

const WIDTH: u32 = 320;
const N_POINTS: usize = 100_000;
const N_VIEWS: usize = 16;

/// Lets the greatest memory of the process be measured anew, where the system does (Linux).
pub(crate) fn forget_peak() {
    // A system that cannot do so keeps the greatest so far.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Seconds of `work` on the CPU, on average over so many times that the system's count, in steps of
/// some milliseconds, can tell them.
///
/// # Errors
/// One of `work`.
pub(crate) fn often(mut work: impl FnMut() -> Result<()>) -> Result<f64> {
    let mut times = 1;
    loop {
        let seconds = of_cpu(|| (0..times).try_for_each(|_| work()))?;
        if seconds >= 0.05 || times >= 1024 {
            return Ok(seconds / f64::from(times));
        }
        times *= 4;
    }
}

/// Against the number of virtual views.
///
/// # Errors
/// A scene without a sphere.
pub(crate) fn views(args: &Args, figures: &mut Vec<Figure>) -> Result<()> {
    let mut config = Config::preset("paper")?;
    config.scene.max_points = Some(1000);
    let scene = cloud::scene(&config, WIDTH, N_POINTS)?;
    for n in [16, 32, 64, 128, 256]
        .into_iter()
        .filter(|n| *n <= args.most_views)
    {
        config.views.count = n;
        forget_peak();
        let mut least = f64::INFINITY;
        for _ in 0..args.rounds.max(1) {
            // The whole preparation is timed; splatting is nearly all of it.
            let seconds = of_cpu(|| prepare(&scene, &config, &mut Seconds::default()))?;
            least = least.min(seconds);
        }
        let Prepared { supervision, .. } = prepare(&scene, &config, &mut Seconds::default())?;
        let goals = supervision
            .virtual_views
            .iter()
            .map(|view| view.goal.bytes());
        let goals: usize = goals.sum();
        let mut figure = |what: &str, unit, value| {
            figures.push(Figure {
                sweep: VIEWS,
                size: n as f64,
                what: what.to_owned(),
                unit,
                value,
            });
        };
        figure("splatting", "s", least);
        figure("their target images", "B", goals as f64);
        if let Some(bytes) = peak_host_bytes() {
            figure("host peak", "B", bytes as f64);
        }
    }
    Ok(())
}

/// Against the points of the cloud.
///
/// # Errors
/// A file that cannot be written or read back.
pub(crate) fn points(args: &Args, figures: &mut Vec<Figure>) -> Result<()> {
    let mut config = Config::preset("paper")?;
    config.views.count = N_VIEWS;
    config.scene.max_points = Some(1000);
    let base = cloud::scene(&config, WIDTH, 10_000)?;
    let virtual_cameras = prepare(&base, &config, &mut Seconds::default())?.virtual_cameras;
    let (_, frame) = focus_of(&base)?;
    let train: Vec<Camera> = base.train.iter().map(|v| v.camera.clone()).collect();
    let folder = tempfile::tempdir().map_err(|e| Error::new(e.to_string()))?;
    let file = folder.path().join("points3D.ply");
    for n in sizes(10_000, args.most_points) {
        let points = cloud::of_size(&base.cloud, n);
        write_file(&file, &cloud::ply(&points))?;
        forget_peak();
        let mut least = [f64::INFINITY; 3];
        for _ in 0..args.rounds.clamp(1, 3) {
            let load = often(|| {
                assert_eq!(read_cloud(&file)?.len(), n, "points are lost");
                Ok(())
            })?;
            let start = often(|| Gaussians::from_cloud(&points, &frame, &config.model).map(drop))?;
            let (config, near) = (&config.splat, config.model.near);
            let splat = often(|| {
                splat_views(&points, &frame, (&virtual_cameras, &train), config, near).map(drop)
            })?;
            for (least, seconds) in least.iter_mut().zip([load, start, splat]) {
                *least = least.min(seconds);
            }
        }
        eprintln!("  {n} points");
        let mut figure = |what: &str, unit, value| {
            figures.push(Figure {
                sweep: POINTS,
                size: n as f64,
                what: what.to_owned(),
                unit,
                value,
            });
        };
        figure("loading a PLY", "s", least[0]);
        figure("first Gaussians", "s", least[1]);
        figure("splatting 16 views", "s", least[2]);
        if let Some(bytes) = peak_host_bytes() {
            figure("host peak", "B", bytes as f64);
        }
    }
    Ok(())
}
