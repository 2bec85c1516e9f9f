//! Evaluation of a run at its scene's test views.

use super::{TrainJob, focus_of};
use crate::camera::Frame;
use crate::config::Config;
use crate::error::Result;
use crate::eval;
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::render::Kernels;
use crate::report::{ContactSheet, write_png};
use crate::run::{Evaluation, RunDir, file_names};
use crate::scene::Scene;

/// Renders the test views of a run from its model and measures them; writes `eval.json` and
/// `test/` anew.
pub fn evaluate(run: &RunDir) -> Result<Evaluation> {
    let config = run.config()?;
    let metrics = run.metrics()?;
    let scene = TrainJob::recorded(&metrics.scene, config.clone())
        .and_then(|job| job.load_again())
        .map_err(|e| e.at_path(run.root()))?;
    let (_, frame) = focus_of(&scene)?;
    let gpu = Gpu::open()?;
    let kernels = Kernels::new(&gpu);
    measure(
        (&gpu, &kernels),
        &scene,
        &frame,
        &config,
        run,
        metrics.seconds.train,
    )
}

/// Measures the model in `run` at the test views of `scene` and writes what it finds.
pub(super) fn measure(
    (gpu, kernels): (&Gpu, &Kernels),
    scene: &Scene,
    frame: &Frame,
    config: &Config,
    run: &RunDir,
    train_s: Option<f64>,
) -> Result<Evaluation> {
    // The file, not the model in memory: what is measured is what others will open.
    let gaussians = read_ply(&run.point_cloud())?.to_canonical(frame);
    let views = &scene.test;
    let renders = eval::render_views(gpu, kernels, &gaussians, frame, views, &config.model)?;
    let names: Vec<&str> = views.iter().map(|view| view.camera.name.as_str()).collect();
    for (render, file) in renders.iter().zip(file_names(&names, "png")) {
        write_png(&run.test_views().join(file), render)?;
    }
    if let Some(first) = renders.first() {
        let mut sheet = ContactSheet::new(renders.len(), 2, first.width, first.height)?;
        for (render, view) in renders.iter().zip(views) {
            sheet.add(&[render, &view.image])?;
        }
        write_png(&run.test_sheet(), &sheet.finish())?;
    }
    let mut evaluation = eval::score(&renders, views, gaussians.len(), train_s)?;
    if !views.is_empty() {
        let splat = eval::score_point_splat(&scene.cloud, frame, views, config)?;
        evaluation.point_splat = Some(splat);
    }
    run.write_evaluation(&evaluation)?;
    Ok(evaluation)
}
