//! Evaluation of a run at its scene's test views.

use super::prepare::carved;
use super::{focus_of, load_scene};
use crate::camera::Frame;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::eval;
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::render::Kernels;
use crate::report::{ContactSheet, write_png};
use crate::run::{Evaluation, Metrics, RunDir, file_names};
use crate::scene::{LoadOptions, PointCloud, Scene, SceneSource, View};

/// Renders the test views of a run from its model and measures them; writes `eval.json` and
/// `test/` anew.
pub fn evaluate(run: &RunDir) -> Result<Evaluation> {
    let config = run.config()?;
    let metrics = run.metrics()?;
    let scene = reload(&config, &metrics).map_err(|e| e.at_path(run.root()))?;
    let (_, frame) = focus_of(&scene)?;
    let carved = carved(&scene, &frame, &config)?;
    let cloud = carved.as_ref().map_or(&scene.cloud, |c| &c.cloud);
    let gpu = Gpu::open()?;
    let kernels = Kernels::new(&gpu);
    measure(
        (&gpu, &kernels),
        (&scene.test, cloud),
        &frame,
        &config,
        run,
        metrics.seconds.train,
    )
}

/// The scene as the run was trained on it.
fn reload(config: &Config, metrics: &Metrics) -> Result<Scene> {
    let source = metrics.scene.source.parse::<SceneSource>()?.resolved()?;
    let scene = load_scene(
        &source,
        &LoadOptions {
            train_views: Some(metrics.scene.train_views.clone()),
            test_views: Some(metrics.scene.test_views.clone()),
            cloud: match &metrics.scene.cloud {
                Some(cloud) => Some(cloud.parse()?),
                None => None,
            },
            ..LoadOptions::new(config)
        },
    );
    // What is wrong is the scene, not the command.
    scene.map_err(|e| {
        Error::new(format!("the scene is no longer as it was trained on: {e}"))
            .way_out("restore its files, or train again")
    })
}

/// Measures the model in `run` and the bare splat of `cloud` at the test `views` and writes what
/// it finds.
pub(super) fn measure(
    (gpu, kernels): (&Gpu, &Kernels),
    (views, cloud): (&[View], &PointCloud),
    frame: &Frame,
    config: &Config,
    run: &RunDir,
    train_s: Option<f64>,
) -> Result<Evaluation> {
    // The file, not the model in memory: what is measured is what others will open.
    let gaussians = read_ply(&run.point_cloud())?.to_canonical(frame);
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
        let splat = eval::score_point_splat(cloud, frame, views, config)?;
        evaluation.point_splat = Some(splat);
    }
    run.write_evaluation(&evaluation)?;
    Ok(evaluation)
}
