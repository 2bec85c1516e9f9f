//! This study asks what quality costs: one thing at a time is reduced, then two, beside what the default
//! chooses.

use super::front::{file_mb, fronts};
use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, TO_MODEL, gain, psnr_at, quality, scenes};
use super::runs::{Finished, Results, Scope};
use super::viewpoints::{Setting, measure};
use super::{Picture, Report, Study};
use crate::camera::json::read_cameras;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::pipeline::n_start;
use crate::report::plot::{Axis, Plot, Style};
use crate::report::{Cell, Column, Table};

/// All of it: the default preset.
const BASE: &str = "gspotential";

const SH_DEGREES: [u32; 4] = [0, 1, 2, 3];
/// One in so many of the start's points.
const CAPS: [usize; 5] = [1, 2, 4, 8, 16];
const VIRTUAL_VIEWS: [usize; 4] = [0, 16, 64, 1024];
/// One in so many of the iterations.
const SHORTER: [u32; 3] = [2, 4, 10];
/// One in so many pixels of the images' longer side.
const SMALLER: [u32; 2] = [2, 4];
/// One in so many of the start's points together with one in so many of the iterations.
const TWO_CAPS: [usize; 2] = [4, 16];
const TWO_SHORTER: [u32; 2] = [4, 10];
/// The same points together with so many virtual views.
const TWO_VIEWS: [usize; 2] = [16, 64];

/// The default where iterations are stated for the others: it ends by itself.
const CHOSEN: &str = "gspotential-chosen";

/// What the built-in scene can be made at.
const MIN_SIDE: u32 = 16;

/// A thing that is reduced: what its variants' names begin with, what it is called, and its size.
struct Factor {
    prefix: &'static str,
    label: &'static str,
    size: fn(&Finished) -> Option<f64>,
    /// Whether the base is a point of its curve.
    has_base: bool,
    is_log: bool,
}

const FACTORS: [Factor; 5] = [
    Factor {
        prefix: "gspotential-sh-",
        label: "SH degree",
        size: |run| Some(f64::from(run.job.config.model.sh_degree)),
        has_base: true,
        is_log: false,
    },
    Factor {
        prefix: "gspotential-cap-",
        label: "Gaussians at most",
        size: |run| Some(run.job.config.densify.max_gaussians as f64),
        has_base: false,
        is_log: true,
    },
    Factor {
        prefix: "gspotential-count-",
        label: "virtual views",
        size: |run| Some(run.job.config.views.count as f64),
        has_base: true,
        is_log: false,
    },
    Factor {
        prefix: "gspotential-iterations-",
        label: "iterations",
        size: |run| Some(f64::from(run.job.config.iterations)),
        has_base: true,
        is_log: true,
    },
    Factor {
        prefix: SIZE,
        label: "longer side trained at, px",
        size: |run| {
            let cameras = read_cameras(&run.run.cameras()).ok()?;
            let first = cameras.first()?;
            Some(f64::from(first.width.max(first.height)))
        },
        has_base: true,
        is_log: true,
    },
];

const SIZE: &str = "gspotential-size-";
/// Begins the names of variants in which two things are reduced.
const TWO: &str = "gspotential-two-";

const COLUMNS: [Column; 13] = [
    SCENE,
    Column::text("factor", "what"),
    Column::text("value", "how much"),
    PSNR,
    SSIM,
    LPIPS,
    TO_MODEL,
    Column::quantity("gain", "against all, dB"),
    Column::figure("n_gaussians", "Gaussians", 0),
    Column::figure("train_s", "training s", 1),
    Column::figure("energy_j", "training J", 0),
    Column::figure("gpu_peak_mb", "GPU MB", 1),
    Column::figure("file_mb", "file MB", 1),
];

pub(crate) struct Need;

impl Study for Need {
    fn question(&self) -> &'static str {
        "What quality costs: from the method as it is, one thing at a time is reduced (virtual \
         views are also raised), then Gaussians with iterations or virtual views, with the time of training, the \
         memory on the GPU and the size of the file. Fronts show what no other variant beats, and the chosen one."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let config = base.config(BASE, &[])?;
        let scene = base.scene()?;
        let n_points = n_start(&scene, &config);
        let views = || scene.train.iter().chain(&scene.test).map(|v| &v.camera);
        let side = views().map(|c| c.width.max(c.height)).max().unwrap_or(0);
        let shorter = views().map(|c| c.width.min(c.height)).min().unwrap_or(0);
        let mut variants = base.presets(&[BASE])?;
        let mut add = |name: String, changes: &[String]| -> Result<()> {
            variants.push(base.variant(&name, BASE, changes)?);
            Ok(())
        };
        for degree in SH_DEGREES
            .into_iter()
            .filter(|d| *d != config.model.sh_degree)
        {
            let change = format!("model.sh_degree={degree}");
            add(format!("gspotential-sh-{degree}"), &[change])?;
        }
        for part in CAPS {
            let n = (n_points / part).max(1);
            let changes = [
                format!("scene.max_points={n}"),
                format!("densify.max_gaussians={n}"),
                "need.prune=false".to_owned(),
            ];
            add(format!("gspotential-cap-{part}"), &changes)?;
        }
        for count in VIRTUAL_VIEWS
            .into_iter()
            .filter(|n| *n != config.views.count)
        {
            let change = format!("views.count={count}");
            add(format!("gspotential-count-{count}"), &[change])?;
        }
        for part in SHORTER {
            let changes = [
                format!("iterations={}", (config.iterations / part).max(1)),
                "need.ends=false".to_owned(),
            ];
            add(format!("gspotential-iterations-{part}"), &changes)?;
        }
        for cap in TWO_CAPS {
            let n = (n_points / cap).max(1);
            let gaussians = [
                format!("scene.max_points={n}"),
                format!("densify.max_gaussians={n}"),
                "need.prune=false".to_owned(),
            ];
            for part in TWO_SHORTER {
                let iterations = (config.iterations / part).max(1);
                let mut changes = gaussians.to_vec();
                changes.push(format!("iterations={iterations}"));
                changes.push("need.ends=false".to_owned());
                add(format!("{TWO}cap-{cap}-iterations-{part}"), &changes)?;
            }
            for count in TWO_VIEWS {
                let mut changes = gaussians.to_vec();
                changes.push(format!("views.count={count}"));
                add(format!("{TWO}cap-{cap}-count-{count}"), &changes)?;
            }
        }
        if !config.need.ends {
            add(CHOSEN.to_owned(), &["need.ends=true".to_owned()])?;
        }
        let can_be = |part: &u32| side / part >= MIN_SIDE && shorter / part >= base.min_side_px();
        for part in SMALLER.into_iter().filter(can_be) {
            let changes = [
                format!("scene.max_size_px={}", side / part),
                // Without it the start would shrink, too.
                format!("scene.max_points={n_points}"),
            ];
            add(format!("{SIZE}{part}"), &changes)?;
        }
        Ok(variants)
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let results = at_full_size(results)?;
        let mut table = Table::new("need", &COLUMNS);
        for scope in results.scopes() {
            table.row(row(&scope, BASE, ["all".into(), "".into()]));
            for factor in &FACTORS {
                for variant in variants_of(&results, factor) {
                    let value = size(&results, factor, &variant);
                    let value = value.map_or(String::new(), |v| v.to_string());
                    let head = [factor.label.into(), value.into()];
                    table.row(row(&scope, &variant, head));
                }
            }
            for variant in beside(&results) {
                let named = variant.trim_start_matches("gspotential-").to_owned();
                table.row(row(&scope, &variant, [named.into(), "".into()]));
            }
        }
        let ends_by_itself = results.runs.iter().any(|run| run.variant == CHOSEN);
        let chosen = if ends_by_itself { CHOSEN } else { BASE };
        let (front_table, front_pictures) = fronts(&results, chosen)?;
        let pictures = FACTORS.iter().map(|factor| picture(&results, factor));
        let mut pictures = pictures.collect::<Result<Vec<Picture>>>()?;
        pictures.extend(front_pictures);
        let mut notes = vec![
            "All are measured at the same test views, at the full size, whatever they were \
             trained at. *Gaussians at most*: the start is thinned to so many and never \
             grows beyond. Seconds are of training alone; GPU MB the most that buffers held."
                .to_owned(),
        ];
        notes.extend(late_degrees(&results));
        Ok(Report {
            tables: vec![table, front_table],
            pictures,
            notes,
        })
    }
}

/// Returns a warning if training ends before degrees that rows are about have begun.
fn late_degrees(results: &Results) -> Option<String> {
    let config = &results.runs.first()?.job.config;
    let interval = config.model.sh_interval;
    let active = config.iterations.saturating_sub(1) / interval;
    (active < config.model.sh_degree).then(|| {
        format!(
            "The SH degree rises by one every {interval} iterations, so that within {} it is \
             {active} at most: rows of higher degrees are equal to it.",
            config.iterations
        )
    })
}

/// Names of a factor's variants in the order of the plan.
fn variants_of(results: &Results, factor: &Factor) -> Vec<String> {
    let runs = results.runs.iter().map(|run| &run.variant);
    let mut names: Vec<String> = Vec::new();
    for name in runs.filter(|name| name.starts_with(factor.prefix)) {
        if !names.contains(name) {
            names.push(name.clone());
        }
    }
    names
}

/// Names of the variants that are no factor's, in the order of the plan.
fn beside(results: &Results) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for run in &results.runs {
        let is_beside = run.variant == CHOSEN || run.variant.starts_with(TWO);
        if is_beside && !names.contains(&run.variant) {
            names.push(run.variant.clone());
        }
    }
    names
}

/// Returns how much of the factor a variant has; its first run stands for all.
fn size(results: &Results, factor: &Factor, variant: &str) -> Option<f64> {
    let mut runs = results.runs.iter();
    (factor.size)(runs.find(|run| run.variant == variant)?)
}

fn row(scope: &Scope, variant: &str, [what, value]: [Cell; 2]) -> Vec<Cell> {
    let gained = match variant {
        BASE => String::new(),
        _ => gain(scope, variant, BASE),
    };
    let figure =
        |of: &dyn Fn(&Finished) -> Option<f64>| -> Cell { scope.figure(variant, of).into() };
    let mut cells = vec![scope.name.clone().into(), what, value];
    cells.extend(quality(scope, variant));
    cells.push(gained.into());
    cells.push(figure(&|run| Some(run.evaluation.n_gaussians as f64)));
    cells.push(figure(&|run| run.metrics.seconds.train));
    cells.push(figure(&|run| run.metrics.energy_j));
    cells.push(figure(&|run| {
        Some(run.metrics.memory.gpu_peak_bytes? as f64 / 1e6)
    }));
    cells.push(figure(&file_mb));
    cells
}

/// Plots PSNR against how much there is of the factor.
fn picture(results: &Results, factor: &Factor) -> Result<Picture> {
    let axis = if factor.is_log {
        Axis::log(factor.label)
    } else {
        Axis::linear(factor.label)
    };
    let y = Axis::linear("PSNR at the test views, dB");
    let mut plot = Plot::new(&format!("PSNR by {}", factor.label), axis, y);
    let mut names = variants_of(results, factor);
    if factor.has_base {
        names.push(BASE.to_owned());
    }
    for scope in scenes(results) {
        let point = |name: &String| psnr_at(&scope, name, size(results, factor, name)?);
        let mut points: Vec<_> = names.iter().filter_map(point).collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        plot = plot.with(&scope.name, Style::Curve, points);
    }
    let name = factor
        .prefix
        .trim_start_matches("gspotential-")
        .trim_end_matches('-');
    Ok(Picture {
        name: format!("need-{name}"),
        svg: plot.to_svg()?,
    })
}

/// Returns the results with what was trained on smaller images measured at the base's test views.
fn at_full_size(results: &Results) -> Result<Results> {
    let mut runs = results.runs.clone();
    let gpu = Gpu::open()?;
    for scene in results.scenes() {
        let Some(base) = results.of(scene, BASE).into_iter().next() else {
            continue;
        };
        let setting = Setting::of(base)?;
        let smaller = |run: &&mut Finished| run.scene == scene && run.variant.starts_with(SIZE);
        for run in runs.iter_mut().filter(smaller) {
            run.evaluation = measure(
                &gpu,
                run,
                &setting.frame,
                &setting.scene.test,
                &results.measure,
            )?;
        }
    }
    Ok(Results {
        runs,
        measure: results.measure.clone(),
    })
}
