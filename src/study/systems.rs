//! This study sets whole systems side by side, scenes and objects apart (Table 1).

use super::plan::{Base, Variant};
use super::presets::{measured_on_the_way, with_curve};
use super::quality::{
    COVERED, LPIPS, PSNR, SCENE, SSIM, TO_MODEL, covered_psnr, gain, peak, psnr, quality, scenes,
    to_model,
};
use super::renders::Method;
use super::runs::{Finished, Results, Scope};
use super::{Picture, Report, Study, file_name};
use crate::config::{Config, PRESETS, Start};
use crate::error::Result;
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::report::{Column, Table};
use crate::scene::View;

/// Gains are over it.
const BASELINE: &str = "3dgs";

/// What stands before the name of a system's variant on an object: all have one ground there.
const ON_WHITE: &str = "white-";
const WHITE: &str = "model.background=[1,1,1]";

const COLUMNS: [Column; 12] = [
    SCENE,
    Column::text("system", "system"),
    PSNR,
    SSIM,
    LPIPS,
    Column::figure("best_psnr", "best PSNR dB", 2),
    Column::figure("best_at", "at iteration", 0),
    TO_MODEL,
    Column::figure("train_s", "training s", 1),
    Column::figure("n_gaussians", "Gaussians", 0),
    COVERED,
    Column::quantity("gain", "over 3dgs, dB"),
];

pub(crate) struct Systems;

/// Lists the systems, the baseline first: every preset but parts of the method, which have a study of their own, and a
/// shorter version of another.
fn systems() -> Vec<&'static str> {
    let names = PRESETS.iter().map(|(name, _)| *name);
    let others =
        names.filter(|name| !name.starts_with("ablation-") && !["fast", BASELINE].contains(name));
    std::iter::once(BASELINE).chain(others).collect()
}

/// Returns whether a system can be trained on a scene whose subject is not cut out.
fn needs_no_masks(system: &str) -> Result<bool> {
    Ok(Config::preset(system)?.model.start == Start::Cloud)
}

/// Returns the system's variant in a scope, where it has one.
fn variant_in(scope: &Scope, system: &str) -> Option<String> {
    let names = ["", ON_WHITE].map(|ground| with_curve(&format!("{ground}{system}")));
    names.into_iter().find(|name| scope.has(name))
}

impl Study for Systems {
    fn question(&self) -> &'static str {
        "How whole systems compare from the same photographs, poses and cloud: the paper's method and ours, 3DGS, and \
         other systems' rules on the same kernels (the paper's Table 1). Objects, whose subjects are cut out, stand on \
         white ground in all of them."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let is_object = base.scene()?.train.iter().any(View::is_cut_out);
        let mut variants = Vec::new();
        for system in systems() {
            let name = |ground: &str| with_curve(&format!("{ground}{system}"));
            if is_object {
                variants.push(base.variant(&name(ON_WHITE), system, &[WHITE.to_owned()])?);
            } else if needs_no_masks(system)? {
                variants.push(base.variant(&name(""), system, &[])?);
            }
        }
        Ok(variants.into_iter().map(measured_on_the_way).collect())
    }

    fn methods(&self, results: &Results) -> Vec<Method> {
        let every = results.scopes();
        let of_all = |system: &str| {
            let variants = every.last().and_then(|scope| variant_in(scope, system));
            let label = system.to_owned();
            variants.map(|variant| Method { label, variant })
        };
        systems().into_iter().filter_map(of_all).collect()
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let mut table = Table::new("systems", &COLUMNS);
        let on_white = with_curve(ON_WHITE);
        for scope in results.scopes_by(|run| run.variant.starts_with(&on_white)) {
            let Some(baseline) = variant_in(&scope, BASELINE) else {
                continue;
            };
            for system in systems() {
                let Some(variant) = variant_in(&scope, system) else {
                    continue;
                };
                let gained = match system == BASELINE {
                    true => String::new(),
                    false => gain(&scope, &variant, &baseline),
                };
                let head = [scope.name.clone().into(), system.into()];
                let figure = |of: &dyn Fn(&Finished) -> Option<f64>| scope.figure(&variant, of);
                let [psnr, ssim, lpips, to_model] = quality(&scope, &variant);
                let best = [
                    figure(&|run| Some(peak(run)?.1)).into(),
                    figure(&|run| Some(peak(run)?.0)).into(),
                ];
                let cost = [
                    to_model,
                    figure(&|run| run.metrics.seconds.train).into(),
                    figure(&|run| Some(run.evaluation.n_gaussians as f64)).into(),
                ];
                let end = [figure(&covered_psnr).into(), gained.into()];
                let cells = head.into_iter().chain([psnr, ssim, lpips]);
                table.row(cells.chain(best).chain(cost).chain(end));
            }
        }
        let shown = scenes(results);
        let pictures = shown.iter().map(picture);
        Ok(Report {
            tables: vec![table],
            pictures: pictures.collect::<Result<_>>()?,
            notes: vec![
                "Other systems' rules run on this program's kernels and start; configs/README.md says what each lacks of its \
                 source. Those that start from masks are trained on objects alone."
                    .to_owned(),
                "The best PSNR is the highest of ten on the way: what a system reaches if it ends in time."
                    .to_owned(),
            ],
        })
    }
}

/// Plots what a system reaches on a scene against the seconds that it takes.
fn picture(scope: &Scope<'_>) -> Result<Picture> {
    let title = format!("PSNR by seconds, {}", scope.name);
    let mut plot = Plot::new(
        &title,
        Axis::log("end to end, s"),
        Axis::linear("PSNR at the test views, dB"),
    );
    for system in systems() {
        let point = variant_in(scope, system).and_then(|variant| {
            let reached = scope.figure(&variant, psnr)?;
            Some(Point {
                x: scope.figure(&variant, to_model)?.mean,
                y: reached.mean,
                spread: reached.deviation,
            })
        });
        plot = plot.with(system, Style::Marks, point.into_iter().collect());
    }
    Ok(Picture {
        name: file_name(&["systems", &scope.name]),
        svg: plot.to_svg()?,
    })
}
