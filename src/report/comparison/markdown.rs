//! This module writes the comparison as a Markdown table with the best of each scene in bold.

use std::fmt;

use super::{Block, ComparedRun, Comparison, Row};
use crate::metrics::{CoveredScore, LpipsRecord, Mean};
use crate::report::evaluation::{COVERED, MASKED, how, lpips_hint};
use crate::report::stats::Figure;
use crate::terminal::table::{Table, escaped};

/// A column of figures.
struct Column {
    heading: String,
    better: Better,
    digits: usize,
    value: Value,
}

type Value = Box<dyn Fn(&ComparedRun) -> Option<f64>>;

#[derive(Clone, Copy, PartialEq)]
enum Better {
    Higher,
    Lower,
    Neither,
}

impl Column {
    fn new(
        heading: impl Into<String>,
        better: Better,
        digits: usize,
        value: impl Fn(&ComparedRun) -> Option<f64> + 'static,
    ) -> Column {
        let arrow = match better {
            Better::Higher => " ↑",
            Better::Lower => " ↓",
            Better::Neither => "",
        };
        Column {
            heading: heading.into() + arrow,
            better,
            digits,
            value: Box::new(value),
        }
    }

    fn printed(&self, figure: Option<Figure>) -> String {
        let digits = self.digits;
        match figure {
            None => "n/a".to_owned(),
            Some(Figure { mean, deviation }) => {
                let spread = deviation.map(|d| format!(" ± {d:.digits$}"));
                format!("{mean:.digits$}{}", spread.unwrap_or_default())
            }
        }
    }

    /// Returns the cells of rows that compare; what equals the best as printed is best, too.
    fn cells(&self, figures: &[Option<Figure>]) -> Vec<String> {
        let means = figures.iter().flatten().map(|figure| figure.mean);
        let best = match self.better {
            Better::Higher => means.max_by(f64::total_cmp),
            Better::Lower => means.min_by(f64::total_cmp),
            Better::Neither => None,
        };
        let digits = self.digits;
        let rounded = |value: f64| format!("{value:.digits$}");
        let compares = figures.iter().flatten().count() > 1;
        let is_best = |figure: &Option<Figure>| {
            let mean = figure.map(|figure| rounded(figure.mean));
            compares && mean.is_some() && mean == best.map(rounded)
        };
        let cell = |figure: &Option<Figure>| {
            let text = self.printed(*figure);
            if is_best(figure) {
                format!("**{text}**")
            } else {
                text
            }
        };
        figures.iter().map(cell).collect()
    }
}

fn columns(runs: &[ComparedRun]) -> Vec<Column> {
    use Better::{Higher, Lower, Neither};
    let mut columns = vec![
        Column::new("PSNR dB", Higher, 2, |run| run.evaluation.mean.psnr),
        Column::new("SSIM", Higher, 3, |run| run.evaluation.mean.ssim),
    ];
    columns.extend(lpips_columns(runs, "", |run| run.evaluation.mean.lpips));
    if any_masked(runs) {
        columns.extend([
            Column::new("masked PSNR dB", Higher, 2, |run| masked(run)?.psnr),
            Column::new("masked SSIM", Higher, 3, |run| masked(run)?.ssim),
        ]);
        columns.extend(lpips_columns(runs, "masked ", |run| masked(run)?.lpips));
    }
    if runs.iter().any(|run| covered(run).is_some()) {
        columns.push(Column::new("covered PSNR dB", Higher, 2, |run| {
            covered(run)?.psnr
        }));
    }
    columns.extend([
        Column::new("time s", Lower, 1, |run| run.metrics.seconds.to_model()),
        Column::new("Gaussians", Neither, 0, |run| {
            Some(run.evaluation.n_gaussians as f64)
        }),
        Column::new("MB", Neither, 1, |run| {
            Some(run.measured().point_cloud_bytes as f64 / 1e6)
        }),
    ]);
    columns
}

fn any_masked(runs: &[ComparedRun]) -> bool {
    runs.iter().any(|run| masked(run).is_some())
}

fn covered(run: &ComparedRun) -> Option<CoveredScore> {
    run.evaluation.mean_covered
}

fn masked(run: &ComparedRun) -> Option<Mean> {
    run.evaluation.mean_masked.map(|masked| masked.mean)
}

/// Makes a column for every LPIPS that was measured: distances of different nets, ranges or weights
/// do not compare.
fn lpips_columns(
    runs: &[ComparedRun],
    prefix: &str,
    value: fn(&ComparedRun) -> Option<f64>,
) -> Vec<Column> {
    let mut kinds: Vec<&LpipsRecord> = Vec::new();
    for kind in runs.iter().filter_map(|run| run.measured().lpips.as_ref()) {
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    if kinds.is_empty() {
        return vec![Column::new(
            format!("{prefix}LPIPS"),
            Better::Lower,
            3,
            value,
        )];
    }
    let column = |kind: &&LpipsRecord| {
        let name = kind.to_string();
        let mut heading = format!("{prefix}{name}");
        if kinds.iter().filter(|k| k.to_string() == name).count() > 1 {
            heading += &format!(" weights {:.8}", kind.weights_sha256);
        }
        let kind = (*kind).clone();
        Column::new(heading, Better::Lower, 3, move |run| {
            let is_it = run.measured().lpips.as_ref() == Some(&kind);
            value(run).filter(|_| is_it)
        })
    };
    kinds.iter().map(column).collect()
}

/// Adds a scene's rows: its name in the first, and the figures of each column.
fn add_rows(
    table: &mut Table,
    scene: &str,
    labels: &[&str],
    n_runs: Option<&[usize]>,
    columns: &[Vec<String>],
) {
    for (i, label) in labels.iter().enumerate() {
        let scene = if i == 0 { scene } else { "" };
        let mut cells = vec![scene.to_owned(), (*label).to_owned()];
        cells.extend(columns.iter().map(|column| column[i].clone()));
        cells.extend(n_runs.map(|n| n[i].to_string()));
        table.row(&cells);
    }
}

impl Comparison<'_> {
    fn table(&self) -> Table {
        let columns = columns(self.runs);
        let has_seeds = self.all_rows().any(|row| row.runs.len() > 1);
        let mut header = vec!["scene", "method"];
        header.extend(columns.iter().map(|column| column.heading.as_str()));
        header.extend(has_seeds.then_some("seeds"));
        let mut table = Table::with_text(2, &header);
        for block in &self.blocks {
            let labels: Vec<&str> = block.rows.iter().map(|row| row.label.as_str()).collect();
            let n_runs: Vec<usize> = block.rows.iter().map(|row| row.runs.len()).collect();
            let cells: Vec<Vec<String>> = columns
                .iter()
                .map(|column| {
                    let figures = block.rows.iter().map(|row| row.figure(&column.value));
                    column.cells(&figures.collect::<Vec<_>>())
                })
                .collect();
            let n_runs = has_seeds.then_some(n_runs.as_slice());
            add_rows(&mut table, &block.scene, &labels, n_runs, &cells);
        }
        let labels = self.labels_of_all();
        let cells: Vec<Vec<String>> = columns
            .iter()
            .map(|column| {
                let figures = labels
                    .iter()
                    .map(|label| self.mean_over_scenes(label, column));
                column.cells(&figures.collect::<Vec<_>>())
            })
            .collect();
        let scene = format!("mean of {} scenes", self.blocks.len());
        add_rows(&mut table, &scene, &labels, None, &cells);
        table
    }

    fn all_rows(&self) -> impl Iterator<Item = &Row<'_>> {
        self.blocks.iter().flat_map(|block| &block.rows)
    }

    /// Returns the mean of the scenes' means over seeds.
    fn mean_over_scenes(&self, label: &str, column: &Column) -> Option<Figure> {
        let mean = |block: &Block| Some(block.row(label)?.figure(&column.value)?.mean);
        let figure = Figure::of(self.blocks.iter().map(mean))?;
        // The deviation of scenes says nothing about a method.
        Some(Figure {
            deviation: None,
            ..figure
        })
    }

    /// Returns what a reader must know to compare the rows.
    fn notes(&self) -> Vec<String> {
        let first = &self.runs[0];
        let mut notes = Vec::new();
        notes.extend(self.shared_settings());
        notes.push(self.what_figures_are());
        if any_masked(self.runs) {
            notes.push(format!("{MASKED}."));
        }
        if self.runs.iter().any(|run| covered(run).is_some()) {
            notes.push(format!("{COVERED}."));
        }
        notes.extend(self.differing("adapters", |run| &run.metrics.adapter));
        notes.extend(self.differing("versions", |run| &run.metrics.version));
        if self.blocks.iter().any(|block| block.scene.ends_with(']')) {
            notes.extend(self.differing("scenes", |run| &run.metrics.scene.source));
        }
        notes.push(how(first.measured()));
        if self.runs.iter().any(|run| run.measured().lpips.is_none()) {
            notes.push(lpips_hint());
        }
        notes
    }

    fn shared_settings(&self) -> Option<String> {
        let first = &self.runs[0];
        let mut same = Vec::new();
        if self.agree(|run| run.config.iterations) {
            same.push(format!("{} iterations", first.config.iterations));
        }
        if self.agree(|run| run.config.scene.max_points) {
            same.push(first.points());
        }
        if self.agree(|run| run.metrics.scene.train_views.len()) {
            let n = first.metrics.scene.train_views.len();
            same.push(format!("{n} training views"));
        }
        (!same.is_empty()).then(|| format!("All runs: {}.", same.join(", ")))
    }

    fn what_figures_are(&self) -> String {
        let mut text = "Figures are means over the test views".to_owned();
        if self.all_rows().any(|row| row.runs.len() > 1) {
            text += ", then over seeds, ± standard deviation";
        }
        text += "; best of a scene in bold. Time is from loading the scene to the trained model.";
        if self.blocks.len() > 1 {
            text += if self.labels_of_all().is_empty() {
                " No mean over scenes: no method is in all of them, or a scene is here twice."
            } else {
                " Means over scenes are of the methods that are in all of them."
            };
        }
        text
    }

    /// Returns a line that says how runs differ in what they were trained with, if they do.
    fn differing(&self, what: &str, value: impl Fn(&ComparedRun) -> &str) -> Option<String> {
        let mut values: Vec<&str> = self.runs.iter().map(value).collect();
        values.sort_unstable();
        values.dedup();
        (values.len() > 1).then(|| {
            format!(
                "Runs are of different {what}: {}.",
                escaped(&values.join("; "))
            )
        })
    }
}

impl fmt::Display for Comparison<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.table())?;
        for note in self.notes() {
            write!(f, "\n{note}\n")?;
        }
        Ok(())
    }
}
