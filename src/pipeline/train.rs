//! Training a scene: the stages in a row, timed, into a run directory.

use std::time::Instant;

use super::{cameras, evaluate, focus_of};
use crate::camera::{Camera, Frame};
use crate::cameras_json::write_cameras;
use crate::config::Config;
use crate::error::Result;
use crate::field::{Coverage, Field, fibonacci_sphere};
use crate::gaussians::Gaussians;
use crate::gaussians::ply::write_ply;
use crate::gpu::Gpu;
use crate::progress::Progress;
use crate::render::Kernels;
use crate::report::{ContactSheet, mask_image, write_png};
use crate::run::{
    Evaluation, LossSample, Memory, Metrics, ModelSize, PoseProtocol, RunDir, SceneRecord, Seconds,
    peak_host_bytes,
};
use crate::scene::{Image, Scene, SceneSource, View, thin};
use crate::splat::{SplatImage, splat_views};
use crate::train::{self, Observer, Supervision, TrainingView};
use crate::views::{VirtualView, virtual_views};

/// Trains on `scene`, evaluates at its test views and writes all into `run`; `load_s` is how
/// long loading took.
pub fn train(
    scene: &Scene,
    source: &SceneSource,
    config: &Config,
    load_s: f64,
    run: &RunDir,
) -> Result<Evaluation> {
    let mut seconds = Seconds {
        load: Some(load_s),
        ..Seconds::default()
    };
    // Before anything takes time: a machine without an adapter is told at once.
    let gpu = Gpu::open()?;
    eprintln!("adapter: {}", gpu.describe());

    let train_cameras = cameras(&scene.train);
    let mut clock = Clock::start();
    let (focus, frame) = focus_of(scene)?;
    let field = Field::new(&train_cameras, &focus, &config.field);
    let coverage = Coverage::new(&field, &fibonacci_sphere(config.field.n_candidates));
    seconds.field = Some(clock.lap());
    if let Some(why) = &focus.fallback {
        eprintln!("warning: {why}");
    }
    let virtual_views = virtual_views(&train_cameras, &focus, &field, config)?;
    let virtual_cameras: Vec<Camera> = virtual_views.iter().map(|v| v.camera.clone()).collect();
    seconds.sample = Some(clock.lap());
    let near = config.model.near;
    let splats = splat_views(&scene.cloud, &frame, &virtual_cameras, &config.splat, near)?;
    seconds.splat = Some(clock.lap());
    write_virtual_sheet(run, &splats)?;
    let all = [train_cameras, cameras(&scene.test), virtual_cameras].concat();
    write_cameras(&run.cameras(), &all)?;

    clock.lap();
    let n_pixels: usize = scene.train.iter().map(|view| n_pixels(&view.image)).sum();
    let n_points = config.scene.max_points.unwrap_or(n_pixels);
    let cloud = thin(&scene.cloud, n_points, config.seed);
    let start = Gaussians::from_cloud(&cloud, &frame, &config.model)?;
    eprintln!(
        "{} Gaussians from {} points",
        start.len(),
        scene.cloud.len()
    );
    let supervision = supervision(scene, &frame, coverage, &virtual_views, splats);
    let kernels = Kernels::new(&gpu);
    let mut log = Log {
        progress: Progress::new(config.iterations),
    };
    let trained = train::train(&gpu, &kernels, &start, &supervision, config, &mut log)?;
    log.progress.finish();
    seconds.train = Some(clock.lap());
    write_ply(&run.point_cloud(), &trained.gaussians, &frame)?;

    clock.lap();
    let evaluation =
        evaluate::measure((&gpu, &kernels), scene, &frame, config, run, seconds.train)?;
    seconds.eval = Some(clock.lap());
    let names = |views: &[View]| views.iter().map(|view| view.camera.name.clone()).collect();
    run.write_metrics(&Metrics {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        adapter: gpu.describe(),
        seed: config.seed,
        iterations: config.iterations,
        scene: SceneRecord {
            source: source.to_string(),
            name: scene.name.clone(),
            train_views: names(&scene.train),
            test_views: names(&scene.test),
            n_points: scene.cloud.len(),
            pose_protocol: PoseProtocol::SharedFrame,
        },
        seconds,
        memory: Memory {
            host_peak_bytes: peak_host_bytes(),
            gpu_peak_bytes: Some(gpu.peak_bytes()),
        },
        loss: trained.samples,
        model_size: model_sizes(start.len(), &trained.plans),
    })?;
    Ok(evaluation)
}

/// The views that the optimiser learns from, in the canonical frame.
fn supervision(
    scene: &Scene,
    frame: &Frame,
    coverage: Coverage,
    virtual_views: &[VirtualView],
    splats: Vec<SplatImage>,
) -> Supervision {
    let real = scene.train.iter().map(|view| TrainingView {
        camera: frame.camera_to_canonical(&view.camera),
        goal: view
            .image
            .rgb
            .chunks_exact(3)
            .map(|p| u32::from_le_bytes([p[0], p[1], p[2], 255]))
            .collect(),
        masked: false,
        weight: 1.0,
    });
    let virtual_views = virtual_views
        .iter()
        .zip(splats)
        .map(|(view, splat)| TrainingView {
            camera: frame.camera_to_canonical(&view.camera),
            goal: bytemuck::pod_collect_to_vec(&splat.rgba),
            masked: true,
            weight: view.alpha,
        });
    let real: Vec<TrainingView> = real.collect();
    Supervision {
        extent: extent(&real),
        real,
        virtual_views: virtual_views.collect(),
        coverage,
    }
}

/// 3DGS's camera extent: 1.1 times the greatest distance of a camera from their mean.
fn extent(views: &[TrainingView]) -> f64 {
    let centers: Vec<_> = views.iter().map(|view| view.camera.center()).collect();
    let mean = centers.iter().sum::<glam::DVec3>() / centers.len().max(1) as f64;
    1.1 * centers.iter().map(|c| c.distance(mean)).fold(0.0, f64::max)
}

fn write_virtual_sheet(run: &RunDir, splats: &[SplatImage]) -> Result<()> {
    let Some(first) = splats.first() else {
        return Ok(());
    };
    let mut sheet = ContactSheet::new(splats.len(), 2, first.width, first.height)?;
    for splat in splats {
        let (width, height) = (splat.width, splat.height);
        let rgb = splat
            .rgba
            .chunks_exact(4)
            .flat_map(|p| [p[0], p[1], p[2]])
            .collect();
        let mask: Vec<bool> = splat.mask().collect();
        sheet.add(&[
            &Image { width, height, rgb },
            &mask_image(width, height, &mask),
        ])?;
    }
    write_png(&run.virtual_sheet(), &sheet.finish())
}

fn n_pixels(image: &Image) -> usize {
    image.width as usize * image.height as usize
}

fn model_sizes(start: usize, plans: &[train::PlanRecord]) -> Vec<ModelSize> {
    let first = ModelSize {
        iteration: 0,
        n_gaussians: start,
        plan: None,
    };
    let rest = plans.iter().map(|plan| ModelSize {
        iteration: plan.iteration,
        n_gaussians: plan.n_gaussians,
        plan: Some(plan.counts),
    });
    std::iter::once(first).chain(rest).collect()
}

/// Shows the training's progress.
struct Log {
    progress: Progress,
}

impl Observer for Log {
    fn look(&mut self, sample: &LossSample, n_gaussians: usize) {
        self.progress
            .update(sample.iteration, sample.loss, n_gaussians);
    }
}

/// Wall-clock time of stages in a row.
struct Clock(Instant);

impl Clock {
    fn start() -> Clock {
        Clock(Instant::now())
    }

    /// Seconds since the last lap.
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let lap = now.duration_since(self.0).as_secs_f64();
        self.0 = now;
        lap
    }
}
