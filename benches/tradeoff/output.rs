//! CSV, Markdown and plots.

use std::fmt::Write as _;
use std::path::Path;

use gspotential::error::Result;
use gspotential::files::{create_dir, write_file};
use gspotential::report::plot::{Axis, Plot, Point, Style};
use gspotential::report::{Column, Table};

use super::Measured;
use super::splat::{ALL, COVERED};

/// Why each choice is as it is.
const REASONS: [(&str, &str); 3] = [
    (
        "candidate grid",
        "its error is small beside the scatter of the one draw that is made",
    ),
    (
        COVERED,
        "the paper's; training sees covered pixels alone, most exact with the smallest squares",
    ),
    (
        ALL,
        "as above; over all pixels a larger square gains, as it leaves less black",
    ),
];

/// Writes everything into `folder`, and the tables to stdout.
pub(crate) fn write(
    folder: &Path,
    headline: &str,
    grid: &[Measured],
    splat: &[Measured],
) -> Result<()> {
    create_dir(folder)?;
    let all: Vec<&Measured> = grid.iter().chain(splat).collect();
    write_file(
        &folder.join("tradeoff.csv"),
        records(&all).to_csv()?.as_bytes(),
    )?;
    let markdown = markdown(headline, &all);
    write_file(&folder.join("tradeoff.md"), markdown.as_bytes())?;
    println!("{markdown}");
    let (time, error) = (
        Axis::log("time, of that of the kept grid"),
        Axis::log("total variation"),
    );
    plot("Candidate grid", time, error, grid).write(&folder.join("tradeoff-grid.svg"))?;
    let (time, error) = (
        Axis::linear("time of a view, of that of the kept size"),
        Axis::linear("image error, RMSE"),
    );
    plot("Point splat", time, error, splat).write(&folder.join("tradeoff-splat.svg"))?;
    eprintln!("wrote {}", folder.display());
    Ok(())
}

/// Seconds of the kept setting of a choice.
fn kept_seconds(all: &[&Measured], choice: &str) -> f64 {
    let kept = all.iter().find(|m| m.choice == choice && m.kept);
    kept.map_or(f64::NAN, |m| m.seconds)
}

fn records(all: &[&Measured]) -> Table {
    let columns = [
        Column::text("choice", "choice"),
        Column::text("setting", "setting"),
        Column::text("kept", "kept"),
        Column::number("seconds", "s", 4),
        Column::number("time_ratio", "time ratio", 3),
        Column::number("error", "error", 4),
        Column::text("note", "also"),
    ];
    let mut table = Table::new("tradeoff", &columns);
    for m in all {
        table.row([
            m.choice.into(),
            (&m.setting).into(),
            m.kept.to_string().into(),
            m.seconds.into(),
            (m.seconds / kept_seconds(all, m.choice)).into(),
            m.error.into(),
            (&m.note).into(),
        ]);
    }
    table
}

/// What the figures are.
const EXPLANATION: &str = "\
Candidate grid: time of weights and draw; error: total variation, over 128 cells of equal area, between
where 256 views are drawn and the density on an endless grid. Point splat: time of a view; error: that of
the mean PSNR at the test views, black where nothing is covered.
";

fn markdown(headline: &str, all: &[&Measured]) -> String {
    let mut out = format!("# Speed against error\n\n{headline}.\n\n{EXPLANATION}");
    for (choice, reason) in REASONS {
        let _ = write!(out, "\n### {choice}\n\n");
        let columns = [
            Column::text("setting", "setting"),
            Column::number("ms", "ms", 2),
            Column::number("time_ratio", "time ratio", 3),
            Column::quantity("error", "error"),
            Column::quantity("note", "also"),
        ];
        let mut table = Table::new(choice, &columns);
        for m in all.iter().filter(|m| m.choice == choice) {
            let name = if m.kept {
                format!("**{}**", m.setting)
            } else {
                m.setting.clone()
            };
            table.row([
                name.into(),
                (1e3 * m.seconds).into(),
                (m.seconds / kept_seconds(all, choice)).into(),
                format!("{:.1e}", m.error).into(),
                (&m.note).into(),
            ]);
        }
        let _ = write!(out, "{table}\nKept: {reason}.\n");
    }
    out
}

/// One series a choice, and its kept setting apart.
fn plot(title: &str, x: Axis, y: Axis, measured: &[Measured]) -> Plot {
    let all: Vec<&Measured> = measured.iter().collect();
    let point = |m: &&Measured| Point::new(m.seconds / kept_seconds(&all, m.choice), m.error);
    let mut choices: Vec<&str> = all.iter().map(|m| m.choice).collect();
    choices.dedup();
    choices.sort_unstable();
    choices.dedup();
    let mut plot = Plot::new(title, x, y);
    for choice in choices {
        let own = all.iter().filter(|m| m.choice == choice && !m.kept);
        plot = plot.with(choice, Style::Marks, own.map(point).collect());
    }
    let kept = all.iter().filter(|m| m.kept);
    plot.with("kept", Style::Marks, kept.map(point).collect())
}
