//! This module puts several runs on one page: their figures, curves and renders.

use std::path::Path;

use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use super::curves::{self, Trained};
use super::picture::{MAX_PIXELS, Picture, picture, side_of};
use super::{document, json, table};
use crate::error::Result;
use crate::files::write_file;
use crate::report::{Column, Table, read_png};
use crate::run::{Evaluation, Metrics, RunDir, SceneRecord, file_names};
use crate::scene::View;
use crate::version::WITH_COMMIT;

/// Most test views of a scene, evenly over all of them: a run's own page has the rest. With many
/// runs there are fewer, so that they stay large enough to see.
const MAX_VIEWS: usize = 12;

/// Longer side that pictures should have for that, pixels.
const WANTED_SIDE: u32 = 240;

/// Most runs of a scene whose curves are drawn: that many colours can be told apart.
const MAX_CURVES: usize = 8;

const SCRIPTS: [&str; 2] = [include_str!("compare.js"), include_str!("comparison.js")];

/// Runs of one scene and its test views.
pub struct SceneRuns {
    scene: SceneRecord,
    /// Indices of the test views that are shown.
    shown: Vec<usize>,
    side: u32,
    photographs: Vec<Picture>,
    runs: Vec<ComparedRun>,
}

struct ComparedRun {
    name: String,
    preset: String,
    ssim_weight: f64,
    metrics: Metrics,
    evaluation: Evaluation,
    renders: Vec<Picture>,
}

/// The data of a scene that `comparison.js` reads: each picture is a URI.
#[derive(Serialize)]
struct Choices<'a> {
    /// The photograph, and the runs.
    names: Vec<&'a str>,
    /// One a view, each with one picture a name.
    views: Vec<Vec<&'a str>>,
}

impl SceneRuns {
    /// Starts a page's part for a scene with its test views; about `n_runs` runs are going to share
    /// the page.
    pub fn new(scene: &SceneRecord, test: &[View], n_runs: usize) -> Result<SceneRuns> {
        let room = (MAX_PIXELS / WANTED_SIDE.pow(2)) as usize / n_runs.max(1);
        let n_shown = test.len().min(room.clamp(1, MAX_VIEWS));
        let shown: Vec<usize> = (0..n_shown).map(|i| i * test.len() / n_shown).collect();
        let side = test
            .first()
            .map_or(0, |view| side_of(n_shown * n_runs, &view.image));
        let photographs = shown.iter().map(|&i| picture(&test[i].image, side));
        Ok(SceneRuns {
            scene: scene.clone(),
            photographs: photographs.collect::<Result<_>>()?,
            shown,
            side,
            runs: Vec::new(),
        })
    }

    /// Returns whether a run with this record compares with those here.
    pub fn is_of(&self, scene: &SceneRecord) -> bool {
        (&self.scene.source, &self.scene.test_views) == (&scene.source, &scene.test_views)
    }

    /// Adds a run that has been evaluated.
    ///
    /// # Errors
    /// A file of the run that is missing or cannot be read.
    pub fn add(&mut self, run: &RunDir) -> Result<()> {
        let config = run.config()?;
        let names: Vec<&str> = self.scene.test_views.iter().map(String::as_str).collect();
        let files = file_names(&names, "png");
        let read = |&i: &usize| picture(&read_png(&run.test_views().join(&files[i]))?, self.side);
        self.runs.push(ComparedRun {
            name: run.name(),
            preset: config.preset,
            ssim_weight: config.loss.ssim_weight,
            metrics: run.metrics()?,
            evaluation: run.evaluation()?,
            renders: self.shown.iter().map(read).collect::<Result<_>>()?,
        });
        Ok(())
    }

    fn choices(&self) -> Choices<'_> {
        let runs = || self.runs.iter();
        let views = self.photographs.iter().enumerate().map(|(i, photograph)| {
            let renders = runs().map(|run| run.renders[i].uri.as_str());
            std::iter::once(photograph.uri.as_str())
                .chain(renders)
                .collect()
        });
        Choices {
            names: std::iter::once("photograph")
                .chain(runs().map(|run| run.name.as_str()))
                .collect(),
            views: views.collect(),
        }
    }

    fn table(&self) -> Table {
        let columns = [
            Column::text("run", "run"),
            Column::text("preset", "preset"),
            Column::quantity("seed", "seed"),
            Column::number("psnr", "PSNR dB", 2),
            Column::number("ssim", "SSIM", 4),
            Column::number("lpips", "LPIPS", 4),
            Column::number("n_gaussians", "Gaussians", 0),
            Column::number("train_s", "train s", 1),
        ];
        let mut table = Table::new("runs", &columns);
        for run in &self.runs {
            let mean = &run.evaluation.mean;
            table.row([
                (&run.name).into(),
                (&run.preset).into(),
                run.metrics.seed.to_string().into(),
                mean.psnr.into(),
                mean.ssim.into(),
                mean.lpips.into(),
                run.evaluation.n_gaussians.into(),
                run.evaluation.train_s.into(),
            ]);
        }
        table
    }

    fn section(&self) -> Result<Markup> {
        let trained: Vec<Trained> = self
            .runs
            .iter()
            .map(|run| Trained::of(&run.name, &run.metrics, run.ssim_weight))
            .collect();
        let plots = match trained.len() {
            ..=MAX_CURVES => curves::plots(&trained)?,
            _ => Vec::new(),
        };
        Ok(html! {
            section.comparison {
                h2 { (self.scene.name) }
                p.quiet {
                    (self.scene.source) ": means over " (self.scene.test_views.len()) " test views."
                }
                (table(&self.table()))
                @if plots.is_empty() {
                    p.quiet { "Curves are drawn of at most " (MAX_CURVES) " runs." }
                }
                div.plots { @for plot in &plots { div { (PreEscaped(plot)) } } }
                @if !self.shown.is_empty() { (self.pictures()?) }
            }
        })
    }

    fn pictures(&self) -> Result<Markup> {
        Ok(html! {
            div.controls {
                label { "left " select.left aria-label="left of the slider" {} }
                label { "right " select.right aria-label="right of the slider" {} }
                span.quiet {
                    (self.shown.len()) " of " (self.scene.test_views.len())
                    " test views, JPEGs of at most " (self.side) " pixels"
                }
            }
            div.views {
                @for (&i, photograph) in self.shown.iter().zip(&self.photographs) {
                    figure {
                        div.compare {
                            @for side in ["left", "right"] {
                                img width=(photograph.width) height=(photograph.height) alt=(side);
                            }
                            input type="range" min="0" max="100" value="50" aria-label="cut";
                        }
                        figcaption { (self.scene.test_views[i]) }
                    }
                }
            }
            script type="application/json" { (json(&self.choices())?) }
        })
    }
}

/// Writes one page over runs of one scene or of several.
///
/// # Errors
/// Runs without any loss sample, or a path that cannot be written.
pub fn write_comparison(path: &Path, scenes: &[SceneRuns]) -> Result<()> {
    let sections: Vec<Markup> = scenes
        .iter()
        .map(SceneRuns::section)
        .collect::<Result<_>>()?;
    let n_runs: usize = scenes.iter().map(|scene| scene.runs.len()).sum();
    let title = match n_runs {
        1 => "1 run".to_owned(),
        n => format!("{n} runs"),
    };
    let body = html! {
        h1 { (title) }
        p.quiet { "gspotential " (WITH_COMMIT) }
        @for section in &sections { (section) }
    };
    let page = document(&format!("{title} - gspotential"), body, &SCRIPTS);
    write_file(path, page.as_bytes())
}
