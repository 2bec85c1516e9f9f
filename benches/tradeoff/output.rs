//! CSV, Markdown and plots.

use std::fmt::Write as _;
use std::path::Path;

use gspotential::error::Result;
use gspotential::files::{create_dir, write_file};
use gspotential::report::plot::{Axis, Plot, Point, Style};
use gspotential::terminal::Table;

use super::Measured;
use super::splat::{ALL, COVERED};
use super::variants::{ALPHA, DEPTH, EXP, SH, TILES};

/// Why each choice is as it is.
const REASONS: [(&str, &str); 8] = [
    (
        ALPHA,
        "3DGS's own, so that every viewer shows what was trained here",
    ),
    (TILES, "no pixel lost, and the shortest lists of the three"),
    (
        DEPTH,
        "the order of f32 depths exactly, as 32 bits give in as many passes; fewer bits save passes and mix what lies close",
    ),
    (
        EXP,
        "as exact as f32 on every driver; WGSL lets a driver's own be off by several ulp",
    ),
    (
        SH,
        "Adam's steps of higher degrees, 1e-4 and less, would be lost in half floats",
    ),
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
pub fn write(
    folder: &Path,
    headline: &str,
    kernels: &[Measured],
    grid: &[Measured],
    splat: &[Measured],
) -> Result<()> {
    create_dir(folder)?;
    let all: Vec<&Measured> = kernels.iter().chain(grid).chain(splat).collect();
    write_file(&folder.join("tradeoff.csv"), csv(&all).as_bytes())?;
    let markdown = markdown(headline, &all);
    write_file(&folder.join("tradeoff.md"), markdown.as_bytes())?;
    println!("{markdown}");
    let image = Axis::log("image error, RMSE");
    let time = || Axis::linear("time of a view, of that of the kept setting");
    plot("Kernels", time(), image, kernels).write(&folder.join("tradeoff-kernels.svg"))?;
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

fn csv(all: &[&Measured]) -> String {
    let mut out = String::from("choice,setting,kept,seconds,time_ratio,error,note\n");
    for m in all {
        let ratio = m.seconds / kept_seconds(all, m.choice);
        let _ = writeln!(
            out,
            "{},{},{},{:e},{ratio:.4},{:e},{}",
            m.choice, m.setting, m.kept, m.seconds, m.error, m.note
        );
    }
    out
}

/// What the figures are.
const EXPLANATION: &str = "\
Kernels: time of a view, forward and backward, mean of three test views. Error: root mean square over the
image, colours in [0, 1], off the pixels where f32 may decide otherwise, against the f64 reference; of
the alpha cut-off against 1/65536. Beside it the gradient's relative L2. Keys of fewer bits are sorted in
as many passes as the program has, and their time is counted for as many as they need. Half floats are
unpacked by integers, which every adapter can. Goal images are stored in 8 bit, as photographs and point
splats are: 16 or 32 would change nothing.

Candidate grid: time of weights and draw; error: total variation, over 128 cells of equal area, between
where 256 views are drawn and the density on an endless grid. Point splat: time of a view; error: that of
the mean PSNR at the test views, black where nothing is covered.
";

fn markdown(headline: &str, all: &[&Measured]) -> String {
    let mut out = format!("# Speed against error\n\n{headline}.\n\n{EXPLANATION}");
    for (choice, reason) in REASONS {
        let _ = write!(out, "\n### {choice}\n\n");
        let header = ["setting", "ms", "time ratio", "error", "also"];
        let mut table = Table::new(&header);
        for m in all.iter().filter(|m| m.choice == choice) {
            let name = if m.kept {
                format!("**{}**", m.setting)
            } else {
                m.setting.clone()
            };
            table.row(&[
                name,
                format!("{:.2}", 1e3 * m.seconds),
                format!("{:.3}", m.seconds / kept_seconds(all, choice)),
                format!("{:.1e}", m.error),
                m.note.clone(),
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
