//! This module writes the comparison as a Markdown table with the best of each scene in bold.

use std::fmt;

use super::{Block, ComparedRun, Comparison, Row};
use crate::metrics::{CoveredScore, LpipsRecord, Mean};
use crate::report::evaluation::{COVERED, FITTED, MASKED, how, lpips_hint};
use crate::report::stats::Figure;
use crate::report::table::{Cell, Column, Table, escaped};

/// A run's figure in a column; `None` if it has none.
type Value = Box<dyn Fn(&ComparedRun) -> Option<f64>>;

/// A column of figures and what each run has in it.
struct Measure {
    column: Column,
    value: Value,
}

impl Measure {
    fn new(column: Column, value: impl Fn(&ComparedRun) -> Option<f64> + 'static) -> Measure {
        Measure {
            column,
            value: Box::new(value),
        }
    }
}

const PSNR: Column = Column::figure("psnr", "PSNR dB", 2).higher_is_better();
const SSIM: Column = Column::figure("ssim", "SSIM", 3).higher_is_better();
const LPIPS: Column = Column::figure("lpips", "LPIPS", 3).lower_is_better();
const FITTED_PSNR: Column = Column::figure("fitted_psnr", "fitted PSNR dB", 2).higher_is_better();
const MASKED_PSNR: Column = Column::figure("masked_psnr", "masked PSNR dB", 2).higher_is_better();
const MASKED_SSIM: Column = Column::figure("masked_ssim", "masked SSIM", 3).higher_is_better();
const COVERED_PSNR: Column =
    Column::figure("covered_psnr", "covered PSNR dB", 2).higher_is_better();
const TIME: Column = Column::figure("time_s", "time s", 1).lower_is_better();
const GAUSSIANS: Column = Column::figure("n_gaussians", "Gaussians", 0);
const MEGABYTES: Column = Column::figure("mb", "MB", 1);

fn measures(runs: &[ComparedRun]) -> Vec<Measure> {
    let mut measures = vec![
        Measure::new(PSNR, |run| run.evaluation.mean.psnr),
        Measure::new(SSIM, |run| run.evaluation.mean.ssim),
    ];
    measures.extend(lpips_measures(runs, "", |run| run.evaluation.mean.lpips));
    if any_fitted(runs) {
        measures.push(Measure::new(FITTED_PSNR, |run| {
            run.evaluation.mean_fitted_psnr
        }));
    }
    if any_masked(runs) {
        measures.extend([
            Measure::new(MASKED_PSNR, |run| masked(run)?.psnr),
            Measure::new(MASKED_SSIM, |run| masked(run)?.ssim),
        ]);
        measures.extend(lpips_measures(runs, "masked ", |run| masked(run)?.lpips));
    }
    if runs.iter().any(|run| covered(run).is_some()) {
        measures.push(Measure::new(COVERED_PSNR, |run| covered(run)?.psnr));
    }
    measures.extend([
        Measure::new(TIME, |run| run.metrics.seconds.to_model()),
        Measure::new(GAUSSIANS, |run| Some(run.evaluation.n_gaussians as f64)),
        Measure::new(MEGABYTES, |run| {
            Some(run.measured().point_cloud_bytes as f64 / 1e6)
        }),
    ]);
    measures
}

fn any_fitted(runs: &[ComparedRun]) -> bool {
    runs.iter()
        .any(|run| run.evaluation.mean_fitted_psnr.is_some())
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
fn lpips_measures(
    runs: &[ComparedRun],
    prefix: &str,
    value: fn(&ComparedRun) -> Option<f64>,
) -> Vec<Measure> {
    let mut kinds: Vec<&LpipsRecord> = Vec::new();
    for kind in runs.iter().filter_map(|run| run.measured().lpips.as_ref()) {
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    if kinds.is_empty() {
        let column = LPIPS.headed(format!("{prefix}LPIPS"));
        return vec![Measure::new(column, value)];
    }
    let measure = |kind: &&LpipsRecord| {
        let name = kind.to_string();
        let mut heading = format!("{prefix}{name}");
        if kinds.iter().filter(|k| k.to_string() == name).count() > 1 {
            heading += &format!(" weights {:.8}", kind.weights_sha256);
        }
        let kind = (*kind).clone();
        Measure::new(LPIPS.headed(heading), move |run| {
            let is_it = run.measured().lpips.as_ref() == Some(&kind);
            value(run).filter(|_| is_it)
        })
    };
    kinds.iter().map(measure).collect()
}

/// Returns the first cells of row `i` of a scene, which is named once.
fn head(i: usize, scene: &str, method: &str) -> [Cell; 2] {
    let scene = if i == 0 { scene } else { "" };
    [scene.into(), method.into()]
}

impl Comparison<'_> {
    fn table(&self) -> Table {
        let measures = measures(self.runs);
        let has_seeds = self.all_rows().any(|row| row.runs.len() > 1);
        let mut columns = vec![
            Column::text("scene", "scene"),
            Column::text("method", "method"),
        ];
        columns.extend(measures.iter().map(|measure| measure.column.clone()));
        columns.extend(has_seeds.then_some(Column::number("seeds", "seeds", 0)));
        let mut table = Table::new("comparison", &columns);
        for block in &self.blocks {
            let begin = table.n_rows();
            for (i, row) in block.rows.iter().enumerate() {
                let figures = measures.iter().map(|m| row.figure(&m.value).into());
                let n_runs = has_seeds.then(|| row.runs.len().into());
                let head = head(i, &block.scene, &row.label);
                table.row(head.into_iter().chain(figures).chain(n_runs));
            }
            table.mark_best(begin..table.n_rows());
        }
        let begin = table.n_rows();
        let scene = format!("mean of {} scenes", self.blocks.len());
        for (i, label) in self.labels_of_all().into_iter().enumerate() {
            let figures = measures
                .iter()
                .map(|measure| self.mean_over_scenes(label, measure).into());
            table.row(head(i, &scene, label).into_iter().chain(figures));
        }
        table.mark_best(begin..table.n_rows());
        table
    }

    fn all_rows(&self) -> impl Iterator<Item = &Row<'_>> {
        self.blocks.iter().flat_map(|block| &block.rows)
    }

    /// Returns the mean of the scenes' means over seeds.
    fn mean_over_scenes(&self, label: &str, measure: &Measure) -> Option<Figure> {
        let mean = |block: &Block| Some(block.row(label)?.figure(&measure.value)?.mean);
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
        if any_fitted(self.runs) {
            notes.push(format!("{FITTED}."));
        }
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
        if self.agree(ComparedRun::iterations) {
            same.push(first.iterations());
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
