//! This study asks what each part of the method adds (Table 2).

use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, TO_MODEL, gain, psnr_at, quality, scenes};
use super::renders::Method;
use super::runs::Results;
use super::{Picture, Report, Study};
use crate::error::Result;
use crate::report::plot::{Axis, Plot, Style};
use crate::report::{Cell, Column, Table};

/// A row of Table 2: its preset, the parts that are on, and the row that it adds one to.
struct Row {
    preset: &'static str,
    /// `L_virt`, `U_info`, `Q_i`-P, `Q_i`-D, `U_conf`.
    parts: [bool; 5],
    over: usize,
}

const fn row(preset: &'static str, parts: [bool; 5], over: usize) -> Row {
    Row {
        preset,
        parts,
        over,
    }
}

const ROWS: [Row; 7] = [
    row("3dgs", [false; 5], 0),
    row("ablation-virtual", [true, false, false, false, false], 0),
    row("ablation-info", [true, true, false, false, false], 1),
    row("ablation-prune", [true, true, true, false, false], 2),
    row("ablation-densify", [true, true, false, true, false], 2),
    row("ablation-both", [true, true, true, true, false], 2),
    row("paper", [true; 5], 5),
];

const COLUMNS: [Column; 13] = [
    SCENE,
    Column::text("row", "row"),
    Column::text("preset", "preset"),
    Column::text("l_virt", "L_virt"),
    Column::text("u_info", "U_info"),
    Column::text("q_prune", "Q-P"),
    Column::text("q_densify", "Q-D"),
    Column::text("u_conf", "U_conf"),
    PSNR,
    SSIM,
    LPIPS,
    TO_MODEL,
    Column::quantity("gain", "PSNR gain dB"),
];

pub(crate) struct Ablation;

impl Study for Ablation {
    fn question(&self) -> &'static str {
        "What each part of the method adds: virtual views, drawn uniformly between the training \
         views or by the information potential, coverage-aware pruning and densification, and \
         the confidence term (the paper's Table 2)."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        base.presets(&ROWS.map(|row| row.preset))
    }

    fn methods(&self, _results: &Results) -> Vec<Method> {
        let method = |row: &Row| Method {
            label: row.preset.to_owned(),
            variant: row.preset.to_owned(),
        };
        ROWS.iter().map(method).collect()
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let mut table = Table::new("ablation", &COLUMNS);
        for scope in results.scopes() {
            for (i, row) in ROWS.iter().enumerate() {
                let on = row.parts.map(|on| Cell::from(if on { "x" } else { "" }));
                let over = &ROWS[row.over];
                let gained = match i {
                    0 => String::new(),
                    _ => format!(
                        "{} over row {}",
                        gain(&scope, row.preset, over.preset),
                        row.over + 1
                    ),
                };
                let head = [
                    scope.name.clone().into(),
                    (i + 1).to_string().into(),
                    row.preset.into(),
                ];
                let cells = head.into_iter().chain(on);
                let cells = cells.chain(quality(&scope, row.preset));
                table.row(cells.chain([gained.into()]));
            }
        }
        let names = ROWS.map(|row| row.preset.trim_start_matches("ablation-").to_owned());
        let mut plot = Plot::new(
            "PSNR at the test views as parts are added",
            Axis::categories("parts, row by row", names.to_vec()),
            Axis::linear("PSNR, dB"),
        );
        for scope in scenes(results) {
            let rows = ROWS.iter().enumerate();
            let points = rows.filter_map(|(i, row)| psnr_at(&scope, row.preset, i as f64));
            plot = plot.with(&scope.name, Style::Curve, points.collect());
        }
        Ok(Report {
            tables: vec![table],
            pictures: vec![Picture {
                name: "ablation".to_owned(),
                svg: plot.to_svg()?,
            }],
            notes: late_rules(results).into_iter().collect(),
        })
    }
}

/// Returns a warning if training ends before a rule that rows add has begun.
fn late_rules(results: &Results) -> Option<String> {
    let config = &results.runs.first()?.job.config;
    // Rows that it guides have it sooner in a short run.
    let starts = results.runs.iter().map(|run| run.job.config.coverage.start);
    let (densify, prune) = (config.densify.start, starts.min()?);
    (config.iterations <= densify.max(prune)).then(|| {
        format!(
            "Densification begins after {densify} iterations and coverage-aware pruning after \
             {prune}: rows that add what has not begun by iteration {} are equal to those that \
             they add it to.",
            config.iterations
        )
    })
}
