//! This module writes evaluated runs for programs: JSON and CSV, every value with its unit in its
//! name.

use serde::Serialize;
use serde_json::{Value, json};

use super::comparison::ComparedRun;
use super::table::records_csv;
use crate::error::{Error, Result};
use crate::metrics::lpips::{InputRange, Net};
use crate::metrics::{Renders, ViewScore};
use crate::scene::PoseProtocol;

/// A run, flat: one line of the CSV. What was not measured is null, or empty.
#[derive(Serialize)]
struct RunRecord<'a> {
    run: &'a str,
    scene: &'a str,
    scene_source: &'a str,
    method: &'a str,
    preset: &'a str,
    /// `key=value` of what differs from the preset, separated by `; `.
    changes: String,
    seed: u64,
    iterations: u32,
    /// The cloud's source; null for the scene's own.
    cloud: Option<&'a str>,
    n_points: usize,
    max_points: Option<usize>,
    n_train_views: usize,
    n_test_views: usize,
    image_width_px: Option<u32>,
    image_height_px: Option<u32>,
    pose_protocol: PoseProtocol,
    renders: Renders,
    psnr_db: Option<f64>,
    ssim: Option<f64>,
    lpips: Option<f64>,
    lpips_net: Option<Net>,
    lpips_range: Option<InputRange>,
    lpips_weights_sha256: Option<&'a str>,
    fitted_psnr_db: Option<f64>,
    n_masked_views: usize,
    masked_psnr_db: Option<f64>,
    masked_ssim: Option<f64>,
    masked_lpips: Option<f64>,
    covered_psnr_db: Option<f64>,
    coverage: Option<f64>,
    point_splat_psnr_db: Option<f64>,
    point_splat_ssim: Option<f64>,
    point_splat_covered_psnr_db: Option<f64>,
    point_splat_coverage: Option<f64>,
    n_gaussians: usize,
    point_cloud_bytes: u64,
    point_cloud_sha256: &'a str,
    /// From loading the scene to the trained model.
    time_s: Option<f64>,
    load_s: Option<f64>,
    field_s: Option<f64>,
    carve_s: Option<f64>,
    sample_s: Option<f64>,
    splat_s: Option<f64>,
    train_s: Option<f64>,
    eval_s: Option<f64>,
    host_peak_bytes: Option<u64>,
    gpu_peak_bytes: Option<u64>,
    adapter: &'a str,
    version: &'a str,
}

impl<'a> RunRecord<'a> {
    fn new(run: &'a ComparedRun) -> RunRecord<'a> {
        let (metrics, evaluation, measured) = (&run.metrics, &run.evaluation, run.measured());
        let (scene, seconds, lpips) = (&metrics.scene, metrics.seconds, measured.lpips.as_ref());
        let masked = evaluation.mean_masked.as_ref();
        let covered = evaluation.mean_covered;
        let splat = evaluation.point_splat.as_ref();
        RunRecord {
            run: run.name(),
            scene: &scene.name,
            scene_source: &scene.source,
            method: &run.method,
            preset: &run.config.preset,
            changes: run.changes.join("; "),
            seed: run.config.seed,
            iterations: metrics.iterations,
            cloud: scene.cloud.as_deref(),
            n_points: scene.n_points,
            max_points: run.config.scene.max_points,
            n_train_views: scene.train_views.len(),
            n_test_views: scene.test_views.len(),
            image_width_px: measured.image_px.map(|[width, _]| width),
            image_height_px: measured.image_px.map(|[_, height]| height),
            pose_protocol: measured.pose_protocol,
            renders: measured.renders,
            psnr_db: evaluation.mean.psnr,
            ssim: evaluation.mean.ssim,
            lpips: evaluation.mean.lpips,
            lpips_net: lpips.map(|lpips| lpips.net),
            lpips_range: lpips.map(|lpips| lpips.range),
            lpips_weights_sha256: lpips.map(|lpips| lpips.weights_sha256.as_str()),
            fitted_psnr_db: evaluation.mean_fitted_psnr,
            n_masked_views: masked.map_or(0, |masked| masked.n_views),
            masked_psnr_db: masked.and_then(|masked| masked.mean.psnr),
            masked_ssim: masked.and_then(|masked| masked.mean.ssim),
            masked_lpips: masked.and_then(|masked| masked.mean.lpips),
            covered_psnr_db: covered.and_then(|covered| covered.psnr),
            coverage: covered.map(|covered| covered.coverage),
            point_splat_psnr_db: splat.and_then(|splat| splat.psnr),
            point_splat_ssim: splat.and_then(|splat| splat.ssim),
            point_splat_covered_psnr_db: splat.and_then(|splat| splat.psnr_covered),
            point_splat_coverage: splat.map(|splat| splat.coverage),
            n_gaussians: evaluation.n_gaussians,
            point_cloud_bytes: measured.point_cloud_bytes,
            point_cloud_sha256: &measured.point_cloud_sha256,
            time_s: seconds.to_model(),
            load_s: seconds.load,
            field_s: seconds.field,
            carve_s: seconds.carve,
            sample_s: seconds.sample,
            splat_s: seconds.splat,
            train_s: seconds.train,
            eval_s: seconds.eval,
            host_peak_bytes: metrics.memory.host_peak_bytes,
            gpu_peak_bytes: metrics.memory.gpu_peak_bytes,
            adapter: &metrics.adapter,
            version: &metrics.version,
        }
    }
}

/// Writes a line a run, under a header.
pub fn runs_csv(runs: &[ComparedRun]) -> Result<Vec<u8>> {
    records_csv("runs", runs.iter().map(RunRecord::new)).map(String::into_bytes)
}

/// Writes `{"runs": [...]}`: the fields of the CSV, the names of the training views and the errors
/// at every test view. JSON has no infinity: an infinite PSNR is null.
pub fn runs_json(runs: &[ComparedRun]) -> Result<Vec<u8>> {
    let failed = |e: serde_json::Error| Error::new(format!("cannot write as JSON: {e}"));
    let mut objects = Vec::with_capacity(runs.len());
    for run in runs {
        let mut object = serde_json::to_value(RunRecord::new(run)).map_err(failed)?;
        object["train_views"] = json!(run.metrics.scene.train_views);
        object["views"] = run.evaluation.views.iter().map(view).collect();
        objects.push(object);
    }
    let text = serde_json::to_string_pretty(&json!({ "runs": objects })).map_err(failed)?;
    Ok((text + "\n").into_bytes())
}

fn view(view: &ViewScore) -> Value {
    let masked = view.masked.as_ref();
    json!({
        "name": view.name,
        "psnr_db": view.psnr,
        "ssim": view.ssim,
        "lpips": view.lpips,
        "fitted_psnr_db": view.fitted_psnr,
        "masked_psnr_db": masked.and_then(|masked| masked.psnr),
        "masked_ssim": masked.and_then(|masked| masked.ssim),
        "masked_lpips": masked.and_then(|masked| masked.lpips),
        "mask_coverage": masked.map(|masked| masked.coverage),
        "covered_psnr_db": view.covered.and_then(|covered| covered.psnr),
        "coverage": view.covered.map(|covered| covered.coverage),
    })
}
