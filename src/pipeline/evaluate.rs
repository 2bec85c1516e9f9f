//! Evaluation of a run at its scene's test views.

use std::path::Path;

use super::{focus_of, load_scene};
use crate::camera::Frame;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::eval;
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::render::Kernels;
use crate::report::{ContactSheet, SceneRuns, write_comparison, write_png, write_run_page};
use crate::run::{Evaluation, Metrics, RunDir, file_names};
use crate::scene::{LoadOptions, Scene, SceneSource, View};

/// Renders the test views of a run from its model and measures them; writes `eval.json` and
/// `test/` and `report.html` anew.
pub fn evaluate(run: &RunDir) -> Result<Evaluation> {
    let config = run.config()?;
    let metrics = run.metrics()?;
    let scene = reload(&config, &metrics).map_err(|e| e.at_path(run.root()))?;
    let (_, frame) = focus_of(&scene)?;
    let gpu = Gpu::open()?;
    let kernels = Kernels::new(&gpu);
    let train_s = metrics.seconds.train;
    let evaluation = measure((&gpu, &kernels), &scene, &frame, &config, run, train_s)?;
    write_run_page(run, &scene.test, &frame)?;
    Ok(evaluation)
}

/// Writes one page over several runs that have been evaluated.
///
/// # Errors
/// A scene that is no longer as a run was trained on it, or a file that cannot be read.
pub fn compare(runs: &[RunDir], path: &Path) -> Result<()> {
    let mut scenes: Vec<SceneRuns> = Vec::new();
    for run in runs {
        let (config, metrics) = (run.config()?, run.metrics()?);
        if let Some(scene) = scenes.iter_mut().find(|s| s.is_of(&metrics.scene)) {
            scene.add(run)?;
            continue;
        }
        let loaded = reload(&config, &metrics).map_err(|e| e.at_path(run.root()))?;
        let mut scene = SceneRuns::new(&metrics.scene, &loaded.test, runs.len())?;
        scene.add(run)?;
        scenes.push(scene);
    }
    write_comparison(path, &scenes)
}

/// The scene as the run was trained on it.
fn reload(config: &Config, metrics: &Metrics) -> Result<Scene> {
    let source = metrics.scene.source.parse::<SceneSource>()?.resolved()?;
    let scene = load_scene(
        &source,
        &LoadOptions {
            train_views: match source {
                SceneSource::Folder(_) => Some(metrics.scene.train_views.clone()),
                SceneSource::Builtin { .. } => None,
            },
            max_width: config.scene.max_width_px,
            max_size: config.scene.max_size_px,
            n_train: config.scene.n_train,
            n_test: config.scene.n_test,
        },
    )?;
    let names = |views: &[View]| -> Vec<String> {
        views.iter().map(|view| view.camera.name.clone()).collect()
    };
    if names(&scene.test) != metrics.scene.test_views {
        return Err(Error::new(format!(
            "the test views of {} are no longer those of the run",
            metrics.scene.source
        ))
        .way_out("restore the scene's images and split, or train again"));
    }
    Ok(scene)
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
