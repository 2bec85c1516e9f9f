//! This module finds fronts: the variants that no other beats in quality and cost at once (Pareto), and where the chosen one lies.

use super::Picture;
use super::file_name;
use super::quality::{lpips, psnr, scenes, ssim};
use super::runs::{Finished, Results, Scope};
use crate::error::Result;
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::report::{Cell, Column, Table};

/// Something of a run that a front is about.
struct Measure {
    key: &'static str,
    label: &'static str,
    of: fn(&Finished) -> Option<f64>,
}

const COSTS: [Measure; 3] = [
    Measure {
        key: "mb",
        label: "file, MB",
        of: file_mb,
    },
    Measure {
        key: "s",
        label: "training, s",
        of: |run| run.metrics.seconds.train,
    },
    Measure {
        key: "j",
        label: "training, J",
        of: |run| run.metrics.energy_j,
    },
];

/// Less is better in the last alone.
const QUALITIES: [Measure; 3] = [
    Measure {
        key: "psnr",
        label: "PSNR, dB",
        of: psnr,
    },
    Measure {
        key: "ssim",
        label: "SSIM",
        of: ssim,
    },
    Measure {
        key: "lpips",
        label: "LPIPS",
        of: lpips,
    },
];

const COLUMNS: [Column; 5] = [
    Column::text("scene", "scene"),
    Column::text("quality", "quality"),
    Column::text("cost", "cost"),
    Column::text("front", "on the front, the cheapest first"),
    Column::text("chosen", "chosen, below the front at its cost by"),
];

/// A variant's place.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Name of the variant.
    pub variant: String,
    /// Mean cost over the seeds, in the unit of its measure; less is better.
    pub cost: f64,
    /// More is better.
    pub quality: f64,
}

/// Returns the indices of the places on the front, the cheapest first: none costs as little or less and is better, or costs
/// less and is as good. The first of equals stands for them.
pub fn front(places: &[Place]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|&a, &b| {
        let (a_place, b_place) = (&places[a], &places[b]);
        let by_cost = a_place.cost.total_cmp(&b_place.cost);
        let by_quality = b_place.quality.total_cmp(&a_place.quality);
        by_cost.then(by_quality).then(a.cmp(&b))
    });
    let mut best = f64::NEG_INFINITY;
    order.retain(|&i| {
        let is_better = places[i].quality > best;
        best = best.max(places[i].quality);
        is_better
    });
    order
}

/// Returns how far `chosen` lies below the best quality that its cost buys; 0 on the front.
pub fn below(places: &[Place], chosen: &Place) -> f64 {
    let affordable = places.iter().filter(|place| place.cost <= chosen.cost);
    let best = affordable
        .map(|place| place.quality)
        .fold(chosen.quality, f64::max);
    best - chosen.quality
}

/// Makes the fronts of every scene in each quality over each cost: a table, and a picture each.
///
/// # Errors
/// A picture that cannot be drawn.
pub(super) fn fronts(results: &Results, chosen: &str) -> Result<(Table, Vec<Picture>)> {
    let mut table = Table::new("need-fronts", &COLUMNS);
    let mut pictures = Vec::new();
    for scope in scenes(results) {
        for quality in &QUALITIES {
            for cost in &COSTS {
                let places = places(results, &scope, (quality, cost));
                if places.is_empty() {
                    continue;
                }
                table.row(row(&scope, (quality, cost), &places, chosen));
                pictures.push(picture(&scope, (quality, cost), &places, chosen)?);
            }
        }
    }
    Ok((table, pictures))
}

/// Lists every variant that was measured so.
fn places(results: &Results, scope: &Scope, (quality, cost): (&Measure, &Measure)) -> Vec<Place> {
    let mut places: Vec<Place> = Vec::new();
    for run in &results.runs {
        if places.iter().any(|place| place.variant == run.variant) {
            continue;
        }
        let mean = |of| Some(scope.figure(&run.variant, of)?.mean);
        if let (Some(measured), Some(cost)) = (mean(quality.of), mean(cost.of)) {
            places.push(Place {
                variant: run.variant.clone(),
                cost,
                quality: sign(quality) * measured,
            });
        }
    }
    places
}

fn sign(quality: &Measure) -> f64 {
    if quality.key == "lpips" { -1.0 } else { 1.0 }
}

fn row(
    scope: &Scope,
    (quality, cost): (&Measure, &Measure),
    places: &[Place],
    chosen: &str,
) -> Vec<Cell> {
    let names: Vec<&str> = front(places)
        .into_iter()
        .map(|i| places[i].variant.as_str())
        .collect();
    let own = places.iter().find(|place| place.variant == chosen);
    let distance = own.map_or("n/a".to_owned(), |own| format!("{:.3}", below(places, own)));
    vec![
        scope.name.clone().into(),
        quality.label.into(),
        cost.label.into(),
        names.join(", ").into(),
        distance.into(),
    ]
}

fn picture(
    scope: &Scope,
    (quality, cost): (&Measure, &Measure),
    places: &[Place],
    chosen: &str,
) -> Result<Picture> {
    let point = |place: &Place| Point::new(place.cost, sign(quality) * place.quality);
    let on_front = front(places)
        .into_iter()
        .map(|i| point(&places[i]))
        .collect();
    let own = places.iter().filter(|place| place.variant == chosen);
    let title = format!("{}: {} over {}", scope.name, quality.label, cost.label);
    let plot = Plot::new(&title, Axis::log(cost.label), Axis::linear(quality.label))
        .with("all", Style::Marks, places.iter().map(point).collect())
        .with("front", Style::Curve, on_front)
        .with("chosen", Style::Marks, own.map(point).collect());
    Ok(Picture {
        name: file_name(&["need-front", &scope.name, quality.key, cost.key]),
        svg: plot.to_svg()?,
    })
}

/// Returns the size of a run's trained file, MB of 10^6 bytes.
pub(super) fn file_mb(run: &Finished) -> Option<f64> {
    let file = std::fs::metadata(run.run.point_cloud()).ok()?;
    Some(file.len() as f64 / 1e6)
}
