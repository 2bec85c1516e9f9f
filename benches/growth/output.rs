//! CSV, Markdown and plots.

use std::path::Path;

use gspotential::error::Result;
use gspotential::files::{create_dir, write_file};
use gspotential::report::plot::{Axis, Plot, Point, Style};
use gspotential::report::{Column, Table};

use super::clock;
use super::fit::exponent;
use super::stages::RASTERIZE;
use super::{Figure, GAUSSIANS, PIXELS, POINTS, VIEWS};

/// Sweeps with the figures that are drawn.
const DRAWN: [(&str, &str, &[&str]); 4] = [
    (
        GAUSSIANS,
        "growth-gaussians.svg",
        &[
            "a step of two views",
            RASTERIZE,
            "rasterize backward",
            "project backward",
            "sort by tile",
            "a checkpoint, written",
            "GPU buffers",
        ],
    ),
    (
        PIXELS,
        "growth-pixels.svg",
        &[
            "a step of two views",
            RASTERIZE,
            "rasterize backward",
            "loss and its gradient",
            "GPU buffers",
        ],
    ),
    (
        VIEWS,
        "growth-views.svg",
        &["splatting", "their target images", "host peak"],
    ),
    (
        POINTS,
        "growth-points.svg",
        &[
            "loading a PLY",
            "first Gaussians",
            "splatting 16 views",
            "host peak",
        ],
    ),
];

/// Writes everything into `folder`, and the tables to stdout.
///
/// # Errors
/// A file that cannot be written.
pub(crate) fn write(folder: &Path, adapter: &str, figures: &[Figure]) -> Result<()> {
    create_dir(folder)?;
    write_file(
        &folder.join("growth.csv"),
        records(figures).to_csv()?.as_bytes(),
    )?;
    // A system that does not tell its load leaves the place empty.
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load
        .split_whitespace()
        .take(3)
        .collect::<Vec<_>>()
        .join(", ");
    let mut text = format!(
        "# Growth\n\n{adapter}. Times are {}, on other adapters than software ones by timestamps. Load of the machine at the end, over 1, 5 and 15 minutes: {load}.\n",
        clock::unit()
    );
    for (sweep, file, _) in DRAWN {
        text += &format!(
            "\n## Against {sweep}\n\n![{sweep}]({file})\n\n{}",
            table(figures, sweep)
        );
    }
    write_file(&folder.join("growth.md"), text.as_bytes())?;
    println!("{text}");
    for (sweep, file, whats) in DRAWN {
        if figures.iter().any(|f| f.sweep == sweep) {
            plot(figures, sweep, whats).write(&folder.join(file))?;
        }
    }
    Ok(())
}

/// Sizes and values of one figure, where they were long enough to be measured.
fn series(figures: &[Figure], sweep: &str, what: &str) -> Vec<(f64, f64)> {
    let of = figures
        .iter()
        .filter(|f| f.sweep == sweep && f.what == what && f.value > 0.0);
    of.map(|f| (f.size, f.value)).collect()
}

/// What a sweep measured, in the order in which it came.
fn whats<'a>(figures: &'a [Figure], sweep: &str) -> Vec<(&'a str, &'static str)> {
    let mut all = Vec::new();
    for f in figures.iter().filter(|f| f.sweep == sweep) {
        if !all.contains(&(f.what.as_str(), f.unit)) {
            all.push((f.what.as_str(), f.unit));
        }
    }
    all
}

fn table(figures: &[Figure], sweep: &str) -> Table {
    let sizes = figures.iter().filter(|f| f.sweep == sweep).map(|f| f.size);
    let (least, most) = sizes.fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), size| {
        (least.min(size), most.max(size))
    });
    let columns = [
        Column::text("what", ""),
        Column::quantity("least", "").headed(format!("at {least}")),
        Column::quantity("most", "").headed(format!("at {most}")),
        Column::number("ratio", "", 2).headed(format!("ratio, of {:.1}", most / least)),
        Column::number("exponent", "exponent", 2),
    ];
    let mut table = Table::new(sweep, &columns);
    for (what, unit) in whats(figures, sweep) {
        let points = series(figures, sweep, what);
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            continue;
        };
        table.row([
            what.into(),
            shown(first.1, unit).into(),
            shown(last.1, unit).into(),
            (last.1 / first.1).into(),
            exponent(&points).into(),
        ]);
    }
    table
}

fn shown(value: f64, unit: &str) -> String {
    match unit {
        "s" => format!("{:.2} ms", 1e3 * value),
        "B" => format!("{:.1} MiB", value / f64::from(1 << 20)),
        _ => format!("{value:.0}"),
    }
}

fn plot(figures: &[Figure], sweep: &str, whats: &[&str]) -> Plot {
    let (x, y) = (
        Axis::log(sweep),
        Axis::log("of the value at the least size"),
    );
    whats.iter().fold(
        Plot::new(&format!("Against {sweep}"), x, y),
        |plot, what| {
            let points = series(figures, sweep, what);
            let first = points.first().map_or(f64::NAN, |p| p.1);
            let name = format!("{what}: {:.2}", exponent(&points));
            let points = points
                .iter()
                .map(|(x, y)| Point::new(*x, y / first))
                .collect();
            plot.with(&name, Style::Curve, points)
        },
    )
}

fn records(figures: &[Figure]) -> Table {
    let columns = [
        Column::text("against", "against"),
        Column::number("size", "size", 0),
        Column::text("what", "what"),
        Column::text("unit", "unit"),
        Column::number("value", "value", 3),
    ];
    let mut table = Table::new("growth", &columns);
    for f in figures {
        table.row([
            f.sweep.into(),
            f.size.into(),
            (&f.what).into(),
            f.unit.into(),
            f.value.into(),
        ]);
    }
    table
}
