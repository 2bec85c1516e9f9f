//! This study sets the presets side by side: how good, how soon, and whether training on makes them
//! worse.

use super::plan::{Base, Variant};
use super::quality::{
    COVERED, LPIPS, PSNR, SCENE, SSIM, TO_MODEL, covered_psnr, gain, peak, quality, scenes,
};
use super::renders::Method;
use super::runs::{Finished, Results, Scope};
use super::{Picture, Report, Study, file_name};
use crate::error::Result;
use crate::pipeline::TrainJob;
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::report::stats::Figure;
use crate::report::{Column, Table};
use crate::run::CurvePoint;

/// The baseline first: gains are over it.
const PRESETS: [&str; 7] = [
    "3dgs",
    "instantsplat",
    "dropgaussian",
    "d2gs",
    "paper",
    "fast",
    "gspotential",
];

/// Points of a curve, the start aside.
const N_CURVE: u32 = 10;

const COLUMNS: [Column; 13] = [
    SCENE,
    Column::text("preset", "preset"),
    PSNR,
    SSIM,
    LPIPS,
    TO_MODEL,
    COVERED,
    Column::quantity("gain", "over 3dgs, dB"),
    Column::figure("best_psnr", "best PSNR dB", 2),
    Column::figure("lost", "best - last, dB", 2),
    Column::figure("iterations", "iterations", 0),
    Column::figure("n_gaussians", "Gaussians", 0),
    Column::figure("train_s", "training s", 1),
];

pub(crate) struct Presets;

impl Study for Presets {
    fn question(&self) -> &'static str {
        "How the presets compare on the same scenes: errors at the end, the best on the way and \
         what training on lost of it, and how soon PSNR is where."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let variants = base.presets(&PRESETS)?.into_iter();
        let with_curve = variants.map(|Variant { name, job }| {
            let name = with_curve(&name);
            measured_on_the_way(Variant { name, job })
        });
        Ok(with_curve.collect())
    }

    fn methods(&self, _results: &Results) -> Vec<Method> {
        let method = |preset: &&str| Method {
            label: (*preset).to_owned(),
            variant: with_curve(preset),
        };
        PRESETS.iter().map(method).collect()
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let mut table = Table::new("presets", &COLUMNS);
        for scope in results.scopes() {
            for preset in PRESETS {
                let variant = &with_curve(preset);
                let figure = |of: &dyn Fn(&Finished) -> Option<f64>| scope.figure(variant, of);
                let gained = match preset == PRESETS[0] {
                    true => String::new(),
                    false => gain(&scope, variant, &with_curve(PRESETS[0])),
                };
                let head = [scope.name.clone().into(), preset.into()];
                let cells = head.into_iter().chain(quality(&scope, variant)).chain([
                    figure(&covered_psnr).into(),
                    gained.into(),
                    figure(&|run| Some(peak(run)?.1)).into(),
                    figure(&|run| Some(peak(run)?.1 - run.evaluation.mean.psnr?)).into(),
                    figure(&|run| Some(f64::from(run.job.config.iterations))).into(),
                    figure(&|run| Some(run.evaluation.n_gaussians as f64)).into(),
                    figure(&|run| run.metrics.seconds.train).into(),
                ]);
                table.row(cells);
            }
        }
        let mut pictures = Vec::new();
        for scope in scenes(results) {
            for (by, label) in [("iterations", "iterations"), ("seconds", "training, s")] {
                let of = |point: &CurvePoint| match by {
                    "iterations" => Some(f64::from(point.iteration)),
                    _ => point.train_s,
                };
                pictures.push(Picture {
                    name: file_name(&["presets", by, &scope.name]),
                    svg: curves(results, &scope, (by, label), of)?,
                });
            }
        }
        Ok(Report {
            tables: vec![table],
            pictures,
            notes: vec![
                "Seconds are of training alone, without the measuring on the way; curves are \
                 means over the seeds."
                    .to_owned(),
            ],
        })
    }
}

/// Returns the name of a variant with a curve, which differs from that of studies without one.
pub(crate) fn with_curve(name: &str) -> String {
    format!("curve-{name}")
}

/// Has a variant measured on the way, for a curve.
pub(crate) fn measured_on_the_way(Variant { name, job }: Variant) -> Variant {
    let eval_every = Some((job.config.iterations / N_CURVE).max(1));
    let job = TrainJob { eval_every, ..job };
    Variant { name, job }
}

/// Plots the PSNR of every preset against what `at` says of a point.
fn curves(
    results: &Results,
    scope: &Scope,
    (by, label): (&str, &str),
    at: impl Fn(&CurvePoint) -> Option<f64>,
) -> Result<String> {
    let title = format!("PSNR by {by}, {}", scope.name);
    let mut plot = Plot::new(
        &title,
        Axis::linear(label),
        Axis::linear("PSNR at the test views, dB"),
    );
    for preset in PRESETS {
        let variant = with_curve(preset);
        let of_variant = |run: &&Finished| run.variant == variant;
        let n_points = results.runs.iter().find(of_variant);
        let n_points = n_points.map_or(0, |run| run.metrics.curve.len());
        let point = |i: usize| {
            let x = scope.figure(&variant, |run| at(run.metrics.curve.get(i)?))?;
            let y: Figure = scope.figure(&variant, |run| run.metrics.curve.get(i)?.psnr)?;
            Some(Point {
                x: x.mean,
                y: y.mean,
                spread: y.deviation,
            })
        };
        let points = (0..n_points).filter_map(point).collect();
        plot = plot.with(preset, Style::Curve, points);
    }
    plot.to_svg()
}
