//! Training over its iterations.

use crate::error::Result;
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::run::{ImageLoss, LossSample, Metrics};

/// Most points of a curve: a sample is of one view and jumps with it, a mean over many does not.
const MAX_POINTS: usize = 60;

/// A run's name, metrics and weight of the SSIM term.
pub struct Trained<'a> {
    pub name: &'a str,
    pub metrics: &'a Metrics,
    pub ssim_weight: f64,
}

/// The plots of `runs` as SVG; series are named after the runs where there are several.
///
/// # Errors
/// Runs without any loss sample.
pub fn plots(runs: &[Trained]) -> Result<Vec<String>> {
    let iterations = || Axis::linear("iteration");
    let mut loss = Plot::new(
        "Loss",
        iterations(),
        Axis::linear("(1 - w) L1 + w (1 - SSIM)"),
    );
    let mut size = Plot::new("Size", iterations(), Axis::linear("Gaussians"));
    for run in runs {
        let samples = &run.metrics.loss;
        let total = |part: ImageLoss| {
            (1.0 - run.ssim_weight) * part.l1 + run.ssim_weight * (1.0 - part.ssim)
        };
        let name = |what: &str| match runs {
            [_] => what.to_owned(),
            _ => format!("{}, {what}", run.name),
        };
        let real = means(samples, |s| Some(total(s.real)));
        loss = loss.with(&name("photographs"), Style::Curve, real);
        let virt = means(samples, |s| s.virt.map(total));
        if !virt.is_empty() {
            loss = loss.with(&name("virtual views"), Style::Curve, virt);
        }
        let sizes = run.metrics.model_size.iter();
        let mut sizes: Vec<Point> = sizes
            .map(|s| Point::new(s.iteration.into(), s.n_gaussians as f64))
            .collect();
        if let Some(last) = sizes.last() {
            sizes.push(Point::new(run.metrics.iterations.into(), last.y));
        }
        let label = if runs.len() == 1 { "" } else { run.name };
        size = size.with(label, Style::Curve, sizes);
    }
    Ok(vec![loss.to_svg()?, size.to_svg()?])
}

/// Means over stretches of samples of one length, each at its stretch's end.
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
