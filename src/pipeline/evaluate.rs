//! Evaluation of a run at its scene's test views.

use super::{focus_of, load_scene};
use crate::camera::Frame;
use crate::config::Config;
use crate::digest::sha256;
use crate::error::{Error, Result, read_file};
use crate::eval::{self, EvalOptions};
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::metrics::quantize;
use crate::render::Kernels;
use crate::report::{ContactSheet, write_png};
use crate::run::{Evaluation, Measured, Metrics, RunDir, file_names};
use crate::scene::{LoadOptions, Scene, SceneSource, View};

/// Renders the test views of a run from its model and measures them; writes `eval.json` and
/// `test/` anew.
pub fn evaluate(run: &RunDir, options: &EvalOptions) -> Result<Evaluation> {
    let config = run.config()?;
    let metrics = run.metrics()?;
    let scene = reload(&config, &metrics).map_err(|e| e.at_path(run.root()))?;
    options
        .check(&scene.test)
        .map_err(|e| e.at_path(run.root()))?;
    let (_, frame) = focus_of(&scene)?;
    let gpu = Gpu::open()?;
    let kernels = Kernels::new(&gpu);
    measure(
        (&gpu, &kernels),
        &scene,
        &frame,
        &config,
        options,
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
    device: (&Gpu, &Kernels),
    scene: &Scene,
    frame: &Frame,
    config: &Config,
    options: &EvalOptions,
    run: &RunDir,
    train_s: Option<f64>,
) -> Result<Evaluation> {
    // The file, not the model in memory: what is measured is what others will open.
    let gaussians = read_ply(&run.point_cloud())?.to_canonical(frame);
    let views = &scene.test;
    let names: Vec<&str> = views.iter().map(|view| view.camera.name.as_str()).collect();
    let files = file_names(&names, "png");
    let mut sheet = match views.first() {
        Some(View { image, .. }) => Some(ContactSheet::new(
            views.len(),
            2,
            image.width,
            image.height,
        )?),
        None => None,
    };
    let mut scores = Vec::with_capacity(views.len());
    eval::render_views(
        device,
        &gaussians,
        frame,
        views,
        &config.model,
        |view, rendered| {
            let image = quantize(rendered.width, rendered.height, &rendered.rgb)?;
            write_png(&run.test_views().join(&files[scores.len()]), &image)?;
            if let Some(sheet) = &mut sheet {
                sheet.add(&[&image, &view.image])?;
            }
            scores.push(eval::score(rendered, view, options)?);
            Ok(())
        },
    )?;
    if let Some(sheet) = sheet {
        write_png(&run.test_sheet(), &sheet.finish())?;
    }
    let mut evaluation = Evaluation::new(scores, gaussians.len(), train_s);
    if !views.is_empty() {
        let splat = eval::score_point_splat(&scene.cloud, frame, views, config)?;
        evaluation.point_splat = Some(splat);
    }
    evaluation.measured = Some(measured(run, options)?);
    run.write_evaluation(&evaluation)?;
    Ok(evaluation)
}

/// What an evaluation of `run` with `options` is an evaluation of.
fn measured(run: &RunDir, options: &EvalOptions) -> Result<Measured> {
    Ok(Measured {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        point_cloud_sha256: sha256(&read_file(&run.point_cloud())?),
        renders: options.renders,
        lpips: options.lpips_record(),
    })
}
