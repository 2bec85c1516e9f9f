//! This study varies settings of the field: potential against quality for several sigma and lambda
//! (the parameterization figure), and what training with each lambda gives (the paper's choice of
//! it).

use super::plan::{Base, Variant};
use super::quality::{
    LPIPS, PSNR, SCENE, SSIM, TO_MODEL, gain, lpips, psnr, quality, scenes, ssim, to_model,
};
use super::renders::Method;
use super::runs::{Finished, Results};
use super::viewpoints::{Survey, scatter};
use super::{Picture, Report, Study, file_name};
use crate::config::FieldConfig;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::report::stats::Figure;
use crate::report::{Column, Table};

/// Weights of `U_conf` in the field; that of the study's options is among them or added.
const LAMBDAS: [f64; 5] = [0.0, 0.1, 0.2, 0.4, 0.8];
/// Times the method's sigma.
const SIGMAS: [f64; 3] = [0.5, 1.0, 2.0];

/// The preset that renders the viewpoints: the paper asks about 3DGS.
const BASELINE: &str = "3dgs";
/// Its own lambda is a row.
const METHOD: &str = "paper";
const PREFIX: &str = "paper-lambda-";

pub(crate) struct Parameters;

impl Study for Parameters {
    fn question(&self) -> &'static str {
        "How well the potential ranks viewpoints by what 3DGS renders there for several sigma and \
         lambda, and what the method renders when it is trained with each lambda."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let mut variants = base.presets(&[BASELINE, METHOD])?;
        let own = base.config(METHOD, &[])?.field.lambda;
        for lambda in LAMBDAS.into_iter().filter(|lambda| *lambda != own) {
            let change = format!("field.lambda={lambda}");
            variants.push(base.variant(&format!("{PREFIX}{lambda}"), METHOD, &[change])?);
        }
        Ok(variants)
    }

    fn methods(&self, results: &Results) -> Vec<Method> {
        let method = |(lambda, variant): (f64, String)| Method {
            label: format!("lambda {lambda}"),
            variant,
        };
        trained(results).into_iter().map(method).collect()
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let (settings, mut pictures) = settings(results)?;
        pictures.splice(0..0, lambda_pictures(results)?);
        Ok(Report {
            tables: vec![lambda_table(results), settings],
            pictures,
            notes: vec![
                "The first table trains with each lambda. The second trains nothing more: U_total \
                 with each setting against the PSNR of 3DGS at viewpoints, of the built-in scene \
                 all over the sphere, of a folder its test views. Spearman: rank correlation. At \
                 equal angle: the partial one given the angle to the nearest training view."
                    .to_owned(),
            ],
        })
    }
}

/// Lists the lambdas that were trained with, in order, with their variants.
fn trained(results: &Results) -> Vec<(f64, String)> {
    let of_method = |run: &&Finished| run.variant == METHOD || run.variant.starts_with(PREFIX);
    let runs = results.runs.iter().filter(of_method);
    let mut lambdas: Vec<(f64, String)> = runs
        .map(|run| (run.job.config.field.lambda, run.variant.clone()))
        .collect();
    lambdas.sort_by(|a, b| a.0.total_cmp(&b.0));
    lambdas.dedup();
    lambdas
}

fn lambda_table(results: &Results) -> Table {
    let columns = [
        SCENE,
        Column::text("lambda", "lambda"),
        PSNR,
        SSIM,
        LPIPS,
        TO_MODEL,
        Column::quantity("gain", "against the method's, dB"),
    ];
    let mut table = Table::new("parameters", &columns);
    for scope in results.scopes() {
        for (lambda, variant) in trained(results) {
            let gained = match variant.as_str() {
                METHOD => String::new(),
                _ => gain(&scope, &variant, METHOD),
            };
            let head = [scope.name.clone().into(), lambda.to_string().into()];
            let cells = head.into_iter().chain(quality(&scope, &variant));
            table.row(cells.chain([gained.into()]));
        }
    }
    table
}

/// Plots every measure over lambda, where it was measured.
fn lambda_pictures(results: &Results) -> Result<Vec<Picture>> {
    let mut pictures = Vec::new();
    type Measure = (&'static str, &'static str, fn(&Finished) -> Option<f64>);
    let measures: [Measure; 3] = [
        ("psnr", "PSNR, dB", psnr),
        ("ssim", "SSIM", ssim),
        ("lpips", "LPIPS", lpips),
    ];
    for (name, label, measure) in measures {
        let mut plot = Plot::new(
            &format!("{label} at the test views by lambda"),
            Axis::linear("lambda"),
            Axis::linear(label),
        );
        for scope in scenes(results) {
            let point = |(lambda, variant): (f64, String)| {
                let figure = scope.figure(&variant, measure)?;
                Some(Point {
                    x: lambda,
                    y: figure.mean,
                    spread: figure.deviation,
                })
            };
            let points: Vec<Point> = trained(results).into_iter().filter_map(point).collect();
            plot = plot.with(&scope.name, Style::Curve, points);
        }
        if plot.series.iter().any(|series| !series.points.is_empty()) {
            pictures.push(Picture {
                name: format!("parameters-lambda-{name}"),
                svg: plot.to_svg()?,
            });
        }
    }
    Ok(pictures)
}

/// Tabulates the potential against quality for every sigma and lambda, and plots those that differ
/// from the method's in one of the two.
fn settings(results: &Results) -> Result<(Table, Vec<Picture>)> {
    let columns = [
        SCENE,
        Column::text("sigma", "sigma"),
        Column::text("lambda", "lambda"),
        Column::figure("viewpoints", "viewpoints", 0),
        Column::figure("spearman", "Spearman", 3),
        Column::figure("partial", "at equal angle", 3),
        TO_MODEL,
    ];
    let mut table = Table::new("parameters-settings", &columns);
    let mut pictures = Vec::new();
    let gpu = Gpu::open()?;
    for scene in results.scenes() {
        let runs = results.of(scene, BASELINE);
        let Some(first) = runs.first() else { continue };
        let own = &first.job.config.field;
        let survey = Survey::of(&gpu, &runs)?;
        let count = Some(Figure::exact(survey.angles.len() as f64));
        let seconds = Figure::of(runs.iter().map(|run| to_model(run)));
        for sigma in SIGMAS.map(|factor| factor * own.sigma) {
            for (lambda, _) in trained(results) {
                let field = survey.setting.field_of(&FieldConfig {
                    sigma,
                    lambda,
                    ..own.clone()
                });
                let directions = survey.directions.iter();
                let potential: Vec<f64> = directions.map(|d| field.u_total(*d)).collect();
                let [whole, partial] = survey.correlations(&potential);
                let sigma_text = format!("{sigma:.2}");
                table.row([
                    scene.into(),
                    sigma_text.as_str().into(),
                    lambda.to_string().into(),
                    count.into(),
                    whole.into(),
                    partial.into(),
                    seconds.into(),
                ]);
                if sigma != own.sigma && lambda != own.lambda {
                    continue;
                }
                let title = format!("{scene}: sigma {sigma_text}, lambda {lambda}");
                let plot = scatter(
                    &title,
                    ("camera potential U_total", &potential),
                    &survey.psnr,
                    &survey.angles,
                );
                let words = ["parameters", scene, &sigma_text, &lambda.to_string()];
                pictures.push(Picture {
                    name: file_name(&words),
                    svg: plot.to_svg()?,
                });
            }
        }
    }
    Ok((table, pictures))
}
