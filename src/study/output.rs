//! This module writes a study's files.

use std::collections::BTreeSet;

use serde_json::json;

use super::plan::{Base, Options};
use super::runs::Results;
use super::{Report, StudyName};
use crate::error::{Error, Result};
use crate::files::{create_dir, write_file};
use crate::report::write_png;
use crate::scene::Image;
use crate::version::VERSION;

/// Writes `STUDY.md`, `STUDY.json`, a CSV file a table, an SVG file a picture and, where methods
/// were put side by side, `STUDY-renders.png`; returns the Markdown.
pub(super) fn write(
    name: StudyName,
    question: &str,
    options: &Options,
    results: &Results,
    (report, renders): (&Report, Option<&Image>),
) -> Result<String> {
    let name = name.name();
    let caption = caption(options, results)?;
    let mut markdown = format!("# {name}\n\n{question}\n\n{caption}\n");
    for table in &report.tables {
        markdown += &format!("\n{table}");
    }
    for note in &report.notes {
        markdown += &format!("\n{note}\n");
    }
    for picture in &report.pictures {
        markdown += &format!("\n![{0}]({0}.svg)\n", picture.name);
    }
    let renders = renders.map(|image| (format!("{name}-renders.png"), image));
    if let Some((file, _)) = &renders {
        markdown += &format!(
            "\n![renders]({file})\n\nRenders of the first seed at test views spread evenly. The box \
             of a row is where the methods' squared errors differ most; what is in it is beneath.\n"
        );
    }
    let tables: Vec<_> = report.tables.iter().map(|table| table.to_json()).collect();
    let json = json!({
        "study": name,
        "question": question,
        "caption": caption,
        "notes": report.notes,
        "tables": tables,
        "runs": results.runs.iter().map(|run| run.run.name()).collect::<Vec<_>>(),
    });
    let json =
        serde_json::to_string_pretty(&json).map_err(|e| Error::new(format!("{name}.json: {e}")))?;

    create_dir(&options.out)?;
    let write = |file: String, text: &str| write_file(&options.out.join(file), text.as_bytes());
    for picture in &report.pictures {
        write(format!("{}.svg", picture.name), &picture.svg)?;
    }
    if let Some((file, image)) = &renders {
        write_png(&options.out.join(file), image)?;
    }
    for table in &report.tables {
        write(format!("{}.csv", table.name), &table.to_csv()?)?;
    }
    write(format!("{name}.json"), &(json + "\n"))?;
    write(format!("{name}.md"), &markdown)?;
    Ok(markdown)
}

/// Says what the runs share, and what the figures mean.
fn caption(options: &Options, results: &Results) -> Result<String> {
    let config = match options.scenes.first() {
        Some(source) => Base::new(options, source)?.config("paper", &[])?,
        None => return Err(Error::usage("no scene is named")),
    };
    let size = match config.scene.max_size_px {
        Some(px) => format!("Images of at most {px} px"),
        None => format!("Images at most {} px wide", config.scene.max_width_px),
    };
    let points = match config.scene.max_points {
        Some(n) => format!("at most {n} points"),
        None => "as many points as each preset takes for the training pixels".to_owned(),
    };
    let seeds: Vec<String> = options.seeds.iter().map(u64::to_string).collect();
    let (plural, noise) = match seeds.len() {
        1 => (
            "",
            "One seed: how far chance spreads the figures is not known.".to_owned(),
        ),
        n => (
            "s",
            format!(
                "Figures are means over {n} seeds ± their standard deviation; a difference is \
                 *within noise* where it is no larger than the standard deviation of the \
                 difference between two single runs."
            ),
        ),
    };
    let trained: BTreeSet<u32> = results
        .runs
        .iter()
        .map(|run| run.metrics.iterations)
        .collect();
    let iterations = match (trained.first(), trained.last()) {
        (Some(least), Some(most)) if least < most => format!("{least} to {most}"),
        (_, most) => most.unwrap_or(&config.iterations).to_string(),
    };
    let settings: String = options.settings.iter().map(|s| format!(", {s}")).collect();
    let adapters: BTreeSet<&str> = results
        .runs
        .iter()
        .map(|run| run.metrics.adapter.as_str())
        .collect();
    let adapters: Vec<&str> = adapters.into_iter().collect();
    let mut lpips = results.runs.iter().filter_map(|run| {
        let measured = run.evaluation.measured.as_ref()?;
        Some(measured.lpips.as_ref()?.to_string())
    });
    let lpips = lpips
        .next()
        .map_or(String::new(), |which| format!("; LPIPS is {which}"));
    let n_tests = results.scenes().into_iter().map(|scene| {
        let run = results.runs.iter().find(|run| run.scene == scene);
        let n = run.map_or(0, |run| run.evaluation.views.len());
        format!("{n} test views of {scene}")
    });
    Ok(format!(
        "{size}, {points}, {iterations} iterations, seed{plural} {}{settings}; {}{lpips}; {}; gspotential {}. {noise}",
        seeds.join(", "),
        n_tests.collect::<Vec<_>>().join(", "),
        adapters.join("; "),
        VERSION,
    ))
}
