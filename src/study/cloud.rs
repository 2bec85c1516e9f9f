//! This study compares better and worse clouds (Table 3), and asks what 3DGS makes of its start
//! (the initialisation figure).

use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, TO_MODEL, gain, peak, psnr, quality};
use super::runs::{Finished, Results, Scope};
use super::{Picture, Report, Study};
use crate::error::Result;
use crate::pipeline::{TrainJob, n_start};
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::report::stats::Figure;
use crate::report::{Cell, Column, Table};
use crate::scene::{CloudSource, Scene, SceneSource, n_cloud_views, other_clouds};

const PRESETS: [&str; 2] = ["3dgs", "paper"];

/// Views that clouds are made from, where points know their view; the built-in scene's own is from
/// 4.
const VIEWS: [usize; 4] = [1, 2, 4, 8];
const OWN_VIEWS: usize = 4;

/// Points of the start, as shares of what there is: one in so many.
const THINNING: [usize; 4] = [1, 4, 16, 64];

/// Points of a curve, the start aside.
const N_CURVE: u32 = 20;

pub(crate) struct Cloud;

/// Lists the clouds' labels and where they come from; the scene's own is `None`.
fn clouds(base: &Base, scene: &Scene) -> Result<Vec<(String, Option<CloudSource>)>> {
    match base.source() {
        SceneSource::Builtin { .. } | SceneSource::Object { .. } => Ok(VIEWS
            .map(|n| {
                let source = (n != OWN_VIEWS).then_some(CloudSource::Views(n));
                (format!("{n}-views"), source)
            })
            .to_vec()),
        SceneSource::Folder(dir) => {
            let mut clouds = vec![("own".to_owned(), None)];
            let train = scene.train.iter().map(|view| view.camera.name.as_str());
            let n_views = n_cloud_views(dir, &train.collect::<Vec<_>>())?;
            clouds.extend(
                VIEWS
                    .into_iter()
                    .filter(|n| *n < n_views)
                    .map(|n| (format!("{n}-views"), Some(CloudSource::Views(n)))),
            );
            for path in other_clouds(dir)? {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                clouds.push((stem.into_owned(), Some(CloudSource::File(path))));
            }
            Ok(clouds)
        }
    }
}

/// Returns what follows a preset's name in a variant on a cloud; the scene's own adds nothing.
fn suffix(label: &str, source: &Option<CloudSource>) -> String {
    match source {
        None => String::new(),
        Some(_) => format!("-cloud-{label}"),
    }
}

fn curve_name(start: &str, thinning: usize) -> String {
    format!("3dgs-curve-{start}-{thinning}")
}

impl Study for Cloud {
    fn question(&self) -> &'static str {
        "What a better or worse cloud does to the method and its baseline (the paper's Table 3), \
         and how the baseline's PSNR goes as it trains from all points of the cloud, from few of \
         them, and from random ones (the initialisation figure)."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let mut variants = Vec::new();
        let scene = base.scene()?;
        for (label, cloud) in clouds(base, &scene)? {
            for preset in PRESETS {
                let name = format!("{preset}{}", suffix(&label, &cloud));
                let Variant { name, job } = base.variant(&name, preset, &[])?;
                let cloud = cloud.clone();
                let job = TrainJob { cloud, ..job };
                variants.push(Variant { name, job });
            }
        }
        let n_points = n_start(&scene, &base.config("3dgs", &[])?);
        for (start, cloud) in [("own", None), ("random", Some(CloudSource::Random))] {
            for thinning in THINNING {
                let points = format!("scene.max_points={}", (n_points / thinning).max(1));
                let name = curve_name(start, thinning);
                let Variant { name, job } = base.variant(&name, "3dgs", &[points])?;
                let job = TrainJob {
                    eval_every: Some((job.config.iterations / N_CURVE).max(1)),
                    cloud: cloud.clone(),
                    ..job
                };
                variants.push(Variant { name, job });
            }
        }
        Ok(variants)
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let own = THINNING.map(|thinning| ("own", thinning));
        let random = THINNING.map(|thinning| ("random", thinning));
        let with_random = [&[("own", 1)][..], &random].concat();
        let mut pictures = Vec::new();
        for (name, starts) in [("own", &own[..]), ("random", &with_random)] {
            pictures.push(Picture {
                name: format!("cloud-start-{name}"),
                svg: curves(results, starts)?,
            });
        }
        Ok(Report {
            tables: vec![quality_table(results), start_table(results)],
            pictures,
            notes: vec![
                "A random start has as many points as the cloud's beside it, uniform in the box \
                 that holds the middle 98 % of the cloud along each axis, of random colours."
                    .to_owned(),
            ],
        })
    }
}

/// Makes Table 3: clouds against presets.
fn quality_table(results: &Results) -> Table {
    let columns = [
        SCENE,
        Column::text("cloud", "cloud"),
        Column::text("preset", "preset"),
        PSNR,
        SSIM,
        LPIPS,
        TO_MODEL,
        Column::quantity("gain", "over 3dgs, dB"),
    ];
    let mut table = Table::new("cloud", &columns);
    let mut suffixes: Vec<(String, String)> = Vec::new();
    for run in &results.runs {
        let Some(suffix) = run.variant.strip_prefix("paper") else {
            continue;
        };
        let label = match &run.job.cloud {
            Some(CloudSource::Views(1)) => "1 view".to_owned(),
            Some(CloudSource::Views(n)) => format!("{n} views"),
            Some(_) => suffix.trim_start_matches("-cloud-").to_owned(),
            None => match run.job.source {
                SceneSource::Folder(_) => "the scene's own".to_owned(),
                SceneSource::Builtin { .. } | SceneSource::Object { .. } => {
                    format!("{OWN_VIEWS} views")
                }
            },
        };
        if !suffixes.iter().any(|(known, _)| known == suffix) {
            suffixes.push((suffix.to_owned(), label));
        }
    }
    for scope in results.scopes() {
        for (suffix, label) in &suffixes {
            let variant = |preset: &str| format!("{preset}{suffix}");
            for preset in PRESETS.into_iter().filter(|p| scope.has(&variant(p))) {
                let gained = match preset {
                    "3dgs" => String::new(),
                    _ => gain(&scope, &variant(preset), &variant("3dgs")),
                };
                let head: [Cell; 3] = [
                    scope.name.clone().into(),
                    label.clone().into(),
                    preset.into(),
                ];
                let cells = head.into_iter().chain(quality(&scope, &variant(preset)));
                table.row(cells.chain([gained.into()]));
            }
        }
    }
    table
}

/// Makes the initialisation figure in numbers: where PSNR starts, peaks and ends.
fn start_table(results: &Results) -> Table {
    let columns = [
        SCENE,
        Column::text("start", "start"),
        Column::figure("points", "points", 0),
        Column::figure("psnr_start", "at the start, dB", 2),
        Column::figure("psnr_peak", "at best, dB", 2),
        Column::figure("peak_iteration", "after iterations", 0),
        Column::figure("psnr_end", "at the end, dB", 2),
    ];
    let mut table = Table::new("cloud-start", &columns);
    for scope in results.scopes() {
        for start in ["own", "random"] {
            for thinning in THINNING {
                let variant = curve_name(start, thinning);
                let figure = |of: fn(&Finished) -> Option<f64>| -> Cell {
                    scope.figure(&variant, of).into()
                };
                table.row([
                    scope.name.clone().into(),
                    label(start, thinning).into(),
                    scope
                        .figure(&variant, points)
                        .map(|f| Figure::exact(f.mean))
                        .into(),
                    figure(|run| run.metrics.curve.first()?.psnr),
                    figure(|run| Some(peak(run)?.1)),
                    figure(|run| Some(peak(run)?.0)),
                    figure(psnr),
                ]);
            }
        }
    }
    table
}

fn label(start: &str, thinning: usize) -> String {
    let of = match start {
        "own" => "the cloud",
        _ => "random points",
    };
    match thinning {
        1 => of.to_owned(),
        n => format!("1/{n} of {of}"),
    }
}

fn points(run: &Finished) -> Option<f64> {
    run.job.config.scene.max_points.map(|n| n as f64)
}

/// Plots PSNR against iterations, the mean over the scenes and seeds.
fn curves(results: &Results, starts: &[(&str, usize)]) -> Result<String> {
    let mut plot = Plot::new(
        "3DGS from different starts",
        Axis::linear("iterations"),
        Axis::linear("PSNR at the test views, dB"),
    );
    let scopes = results.scopes();
    let Some(scope) = scopes.last() else {
        return plot.to_svg();
    };
    for (start, thinning) in starts {
        let points = curve(results, scope, &curve_name(start, *thinning));
        plot = plot.with(&label(start, *thinning), Style::Curve, points);
    }
    plot.to_svg()
}

fn curve(results: &Results, scope: &Scope, variant: &str) -> Vec<Point> {
    let run = results.runs.iter().find(|run| run.variant == variant);
    let iterations = run.map_or(&[][..], |run| &run.metrics.curve);
    let point = |(i, at): (usize, &crate::run::CurvePoint)| {
        let figure: Figure = scope.figure(variant, |run| run.metrics.curve.get(i)?.psnr)?;
        Some(Point {
            x: f64::from(at.iteration),
            y: figure.mean,
            spread: figure.deviation,
        })
    };
    iterations.iter().enumerate().filter_map(point).collect()
}
