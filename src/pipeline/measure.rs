//! This module measures a trained model at the test views of its scene and writes what it finds.

use super::align::{self, Aligned};
use crate::camera::Frame;
use crate::config::Config;
use crate::error::Result;
use crate::eval::{self, EvalOptions};
use crate::files::digest::sha256;
use crate::files::read_file;
use crate::gaussians::ply::read_ply;
use crate::metrics::quantize;
use crate::render::Device;
use crate::report::{ContactSheet, write_png};
use crate::run::{Evaluation, Measured, RunDir, file_names};
use crate::scene::{PointCloud, PoseProtocol, View};
use crate::version::VERSION;

/// Test views and the canonical frame of what they show.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub views: &'a [View],
    pub frame: &'a Frame,
}

/// A scene's point cloud.
#[derive(Clone, Copy)]
pub(super) struct Clouds<'a> {
    /// As the scene has it. The pixels that it covers are those of every run on the scene.
    pub whole: &'a PointCloud,
    /// The cloud as the run used it, carved if its config asks for that.
    pub used: &'a PointCloud,
}

/// A run to be measured, and what it is measured against.
pub(super) struct Subject<'a> {
    pub run: &'a RunDir,
    pub config: &'a Config,
    pub options: &'a EvalOptions,
    /// The scene's test views.
    pub own: Seen<'a>,
    pub clouds: Clouds<'a>,
    /// The views as the model is seen from, if it does not share their frame.
    pub aligned: Option<Aligned>,
    /// Stamp of the scene's files when they were loaded.
    pub scene_stamp: Option<String>,
    pub pose_protocol: PoseProtocol,
    pub train_s: Option<f64>,
}

/// Measures the model of a run and the bare splat of the cloud at the scene's test views and writes
/// what it finds.
pub(super) fn measure(device: Device<'_>, subject: Subject<'_>) -> Result<Evaluation> {
    let Subject {
        run,
        config,
        options,
        own,
        clouds,
        aligned,
        scene_stamp,
        pose_protocol,
        train_s,
    } = subject;
    // The file, not the model in memory: what is measured is what others will open.
    let stored = read_ply(&run.point_cloud())?;
    let frame = aligned.as_ref().map_or(own.frame, |a| &a.frame);
    let gaussians = stored.to_canonical(frame);
    let fit = |aligned| align::fitted(device, &gaussians, config, options.align, aligned);
    let aligned = aligned.map(fit).transpose()?;
    let Seen { views, frame } = aligned.as_ref().map_or(own, |aligned| Seen {
        views: &aligned.views,
        frame: &aligned.frame,
    });
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
    let covered = eval::covered_pixels(clouds.whole, own.frame, own.views, config)?;
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
            let covered = covered.get(scores.len()).map(Vec::as_slice);
            scores.push(eval::score(rendered, view, covered, options)?);
            Ok(())
        },
    )?;
    if let Some(sheet) = sheet {
        write_png(&run.test_sheet(), &sheet.finish())?;
    }
    let mut evaluation = Evaluation::new(scores, gaussians.len(), train_s);
    if !views.is_empty() {
        let splat = eval::score_point_splat(clouds.used, own.frame, own.views, config)?;
        evaluation.point_splat = Some(splat);
    }
    let mut measured = measured(run, options, scene_stamp, pose_protocol)?;
    measured.image_px = views.first().map(|v| [v.image.width, v.image.height]);
    evaluation.measured = Some(measured);
    run.write_evaluation(&evaluation)?;
    Ok(evaluation)
}

/// Returns what an evaluation of `run` with `options` measures and how, but for the image size.
pub(super) fn measured(
    run: &RunDir,
    options: &EvalOptions,
    scene_stamp: Option<String>,
    pose_protocol: PoseProtocol,
) -> Result<Measured> {
    let point_cloud = read_file(&run.point_cloud())?;
    Ok(Measured {
        version: VERSION.to_owned(),
        point_cloud_sha256: sha256(&point_cloud),
        point_cloud_bytes: point_cloud.len() as u64,
        config_sha256: sha256(&read_file(&run.config_file())?),
        scene_stamp,
        image_px: None,
        pose_protocol,
        renders: options.renders,
        lpips: options.lpips_record(),
    })
}
