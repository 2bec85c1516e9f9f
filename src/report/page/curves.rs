//! This module plots training over its iterations.

use crate::error::Result;
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::run::{CurvePoint, Metrics, ModelSize};
use crate::train::{ImageLoss, LossSample, SignalPoint};

/// Most points of a curve: a sample is of one view and jumps with it, a mean over many does not.
const MAX_POINTS: usize = 60;

type Measure = fn(&CurvePoint) -> Option<f64>;

/// What is plotted of a run, finished or not.
pub(crate) struct Trained<'a> {
    pub name: &'a str,
    /// Weight of the SSIM term.
    pub ssim_weight: f64,
    /// Iterations so far.
    pub iterations: u32,
    pub loss: &'a [LossSample],
    pub model_size: &'a [ModelSize],
    pub curve: &'a [CurvePoint],
    pub signal: &'a [SignalPoint],
}

impl<'a> Trained<'a> {
    /// Takes a finished run of that name.
    pub(crate) fn of(name: &'a str, metrics: &'a Metrics, ssim_weight: f64) -> Trained<'a> {
        Trained {
            name,
            ssim_weight,
            iterations: metrics.iterations,
            loss: &metrics.loss,
            model_size: &metrics.model_size,
            curve: &metrics.curve,
            signal: &metrics.signal,
        }
    }
}

/// Draws the plots of `runs` as SVG; series are named after the runs where there are several.
///
/// # Errors
/// Runs without any loss sample.
pub(crate) fn plots(runs: &[Trained]) -> Result<Vec<String>> {
    let mut plots = vec![loss(runs).to_svg()?, size(runs).to_svg()?];
    // The test views on the way are measured on request alone.
    let points = || runs.iter().flat_map(|run| run.curve);
    let has_signal = runs.iter().any(|run| !run.signal.is_empty());
    if has_signal || points().any(|p| p.psnr.is_some()) {
        plots.push(psnr(runs).to_svg()?);
    }
    if points().any(|p| p.ssim.is_some()) {
        let mut plot = over_iterations("Test views", "SSIM");
        for run in runs {
            plot = plot.with(label(runs, run), Style::Curve, tested(run, |p| p.ssim));
        }
        plots.push(plot.to_svg()?);
    }
    Ok(plots)
}

fn over_iterations(title: &str, label: &str) -> Plot {
    Plot::new(title, Axis::linear("iteration"), Axis::linear(label))
}

/// Returns a run's name for the legend, which is empty if there is one run.
fn label<'a>(runs: &[Trained<'a>], run: &Trained<'a>) -> &'a str {
    if runs.len() == 1 { "" } else { run.name }
}

fn loss(runs: &[Trained]) -> Plot {
    let title = if runs.len() == 1 {
        "Loss"
    } else {
        "Loss of the photographs"
    };
    let mut plot = over_iterations(title, "(1 - w) L1 + w (1 - SSIM)");
    for run in runs {
        let w = run.ssim_weight;
        let total = |part: ImageLoss| (1.0 - w) * part.l1 + w * (1.0 - part.ssim);
        let samples = run.loss;
        let real = means(samples, |s| Some(total(s.real)));
        let virt = means(samples, |s| s.virt.map(total));
        // That of virtual views says nothing from run to run: each has its own.
        let alone = runs.len() == 1;
        let name = if alone { "photographs" } else { run.name };
        plot = plot.with(name, Style::Curve, real);
        if alone && !virt.is_empty() {
            plot = plot.with("virtual views", Style::Curve, virt);
        }
    }
    plot
}

fn size(runs: &[Trained]) -> Plot {
    let mut plot = over_iterations("Size", "Gaussians");
    for run in runs {
        let sizes = run.model_size.iter();
        let mut points: Vec<Point> = sizes
            .map(|s| Point::new(s.iteration.into(), s.n_gaussians as f64))
            .collect();
        if let Some(last) = points.last() {
            points.push(Point::new(run.iterations.into(), last.y));
        }
        plot = plot.with(label(runs, run), Style::Curve, points);
    }
    plot
}

/// Draws PSNR of the test views beside that of the virtual views held out and, of one run, of the photographs.
fn psnr(runs: &[Trained]) -> Plot {
    let mut plot = over_iterations("Views on the way", "PSNR (dB)");
    let alone = runs.len() == 1;
    for run in runs {
        let name = |what: &str| match alone {
            true => what.to_owned(),
            false => format!("{}, {what}", run.name),
        };
        let measured = |value: fn(&SignalPoint) -> Option<f64>| -> Vec<Point> {
            let point = |p: &SignalPoint| Some(Point::new(p.iteration.into(), value(p)?));
            run.signal.iter().filter_map(point).collect()
        };
        let mut series = vec![
            ("test views", tested(run, |p| p.psnr)),
            ("virtual views held out", measured(|p| Some(p.held_out))),
        ];
        if alone {
            series.push(("photographs", measured(|p| p.photographs)));
        }
        for (what, points) in series.into_iter().filter(|(_, points)| !points.is_empty()) {
            plot = plot.with(&name(what), Style::Curve, points);
        }
    }
    plot
}

/// Lists a run's errors at the test views.
fn tested(run: &Trained, value: Measure) -> Vec<Point> {
    let point = |p: &CurvePoint| Some(Point::new(p.iteration.into(), value(p)?));
    run.curve.iter().filter_map(point).collect()
}

/// Returns means over stretches of samples of one length, each at its stretch's end.
fn means(samples: &[LossSample], value: impl Fn(&LossSample) -> Option<f64>) -> Vec<Point> {
    let values: Vec<(u32, f64)> = samples
        .iter()
        .filter_map(|s| Some((s.iteration, value(s)?)))
        .collect();
    let stretch = values.len().div_ceil(MAX_POINTS).max(1);
    let mean = |part: &[(u32, f64)]| {
        let sum: f64 = part.iter().map(|(_, v)| v).sum();
        Some(Point::new(part.last()?.0.into(), sum / part.len() as f64))
    };
    values.chunks(stretch).filter_map(mean).collect()
}
