//! This module has the columns that most studies share: PSNR, SSIM, LPIPS, seconds and what a
//! change gains.

use super::runs::{Finished, Results, Scope};
use crate::report::plot::Point;
use crate::report::stats::Figure;
use crate::report::{Cell, Column};

pub(crate) const SCENE: Column = Column::text("scene", "scene");
pub(crate) const PSNR: Column = Column::figure("psnr", "PSNR dB", 2);
pub(crate) const SSIM: Column = Column::figure("ssim", "SSIM", 3);
pub(crate) const LPIPS: Column = Column::figure("lpips", "LPIPS", 3);
/// From loading the scene to the written model.
pub(crate) const TO_MODEL: Column = Column::figure("to_model_s", "end to end s", 1);
pub(crate) const COVERED: Column = Column::figure("psnr_covered", "covered PSNR dB", 2);

/// Returns the mean PSNR of a run, dB.
pub(crate) fn psnr(run: &Finished) -> Option<f64> {
    run.evaluation.mean.psnr
}

/// Returns the mean PSNR over the pixels that the scene's cloud covers, dB.
pub(crate) fn covered_psnr(run: &Finished) -> Option<f64> {
    run.evaluation.mean_covered?.psnr
}

pub(crate) fn ssim(run: &Finished) -> Option<f64> {
    run.evaluation.mean.ssim
}

pub(crate) fn lpips(run: &Finished) -> Option<f64> {
    run.evaluation.mean.lpips
}

/// Returns the seconds from loading the scene to the written model, without any evaluation.
pub(crate) fn to_model(run: &Finished) -> Option<f64> {
    run.metrics.seconds.to_model()
}

/// Returns iteration and PSNR of a curve's highest point.
pub(crate) fn peak(run: &Finished) -> Option<(f64, f64)> {
    let points = run.metrics.curve.iter();
    let points = points.filter_map(|point| Some((f64::from(point.iteration), point.psnr?)));
    points.reduce(|a, b| if b.1 > a.1 { b } else { a })
}

/// Returns the cells under [`PSNR`], [`SSIM`], [`LPIPS`] and [`TO_MODEL`].
pub(crate) fn quality(scope: &Scope, variant: &str) -> [Cell; 4] {
    [
        scope.figure(variant, psnr).into(),
        scope.figure(variant, ssim).into(),
        scope.figure(variant, lpips).into(),
        scope.figure(variant, to_model).into(),
    ]
}

/// Returns how much more PSNR `variant` has than `over`: `+0.42`, or `+0.05 (within noise)`.
pub(crate) fn gain(scope: &Scope, variant: &str, over: &str) -> String {
    difference(scope.figure(variant, psnr), scope.figure(over, psnr))
}

/// Returns the difference of two figures in words; `n/a` where one is missing.
pub(crate) fn difference(a: Option<Figure>, b: Option<Figure>) -> String {
    let (Some(a), Some(b)) = (a, b) else {
        return "n/a".to_owned();
    };
    let noise = match a.is_within_noise_of(&b) {
        Some(true) => " (within noise)",
        _ => "",
    };
    format!("{:+.2}{noise}", a.mean - b.mean)
}

/// Returns the variant's PSNR at `x` of a plot; `None` if it was not measured.
pub(crate) fn psnr_at(scope: &Scope, variant: &str, x: f64) -> Option<Point> {
    let figure = scope.figure(variant, psnr)?;
    Some(Point {
        x,
        y: figure.mean,
        spread: figure.deviation,
    })
}

/// Returns the scopes that a plot has a series for: every scene, as means hide them.
pub(crate) fn scenes(results: &Results) -> Vec<Scope<'_>> {
    let n = results.scenes().len();
    results.scopes().into_iter().take(n).collect()
}
