//! This study holds kernels of the information potential against the quality of what is rendered
//! (the kernel figure).

use super::plan::{Base, Variant};
use super::quality::{SCENE, TO_MODEL, to_model};
use super::runs::Results;
use super::viewpoints::{Survey, scatter};
use super::{Picture, Report, Study, file_name};
use crate::config::{FieldConfig, Kernel};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::report::stats::Figure;
use crate::report::{Cell, Column, Table};

/// The paper's three, by kernel and concentration.
const KERNELS: [(&str, Kernel, f64); 3] = [
    ("von Mises-Fisher, kappa 3.0", Kernel::VonMisesFisher, 3.0),
    ("sech, sigma 5.3", Kernel::Sech, 5.298292365610484),
    ("von Mises-Fisher, kappa 4.4", Kernel::VonMisesFisher, 4.4),
];

/// The preset that is trained: the paper asks about 3DGS alone.
const PRESET: &str = "3dgs";

/// Share of a potential's range that counts as its low end.
const LOW: f64 = 0.1;

const COLUMNS: [Column; 7] = [
    SCENE,
    Column::text("predictor", "predictor"),
    Column::figure("viewpoints", "viewpoints", 0),
    Column::figure("spearman", "Spearman", 3),
    Column::figure("partial", "at equal angle", 3),
    Column::figure("low", "in the lowest tenth", 3),
    TO_MODEL,
];

pub(crate) struct KernelStudy;

impl Study for KernelStudy {
    fn question(&self) -> &'static str {
        "Whether the information potential ranks viewpoints by what 3DGS renders there, with \
         each kernel, against the angle to the nearest training view alone."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        base.presets(&[PRESET])
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let gpu = Gpu::open()?;
        let mut report = Report {
            notes: vec![
                "Spearman: rank correlation of PSNR with the predictor over the viewpoints. At \
                 equal angle: the partial rank correlation given the angle to the nearest \
                 training view, what the potential tells beyond it. In the lowest tenth: the share \
                 of the viewpoints whose potential lies in the lowest tenth of its range over \
                 them, and is hardly told apart. Viewpoints: of the built-in \
                 scene all over the sphere, outside objects and above the floor, against \
                 ray-traced truth; of a folder its test views."
                    .to_owned(),
            ],
            ..Report::default()
        };
        let mut table = Table::new("kernel", &COLUMNS);
        for scene in results.scenes() {
            let runs = results.of(scene, PRESET);
            let Some(first) = runs.first() else { continue };
            let survey = Survey::of(&gpu, &runs)?;
            let angles = &survey.angles;
            let count = Some(Figure::exact(angles.len() as f64));
            let seconds = Figure::of(runs.iter().map(|run| to_model(run)));
            for (i, (label, kernel, sigma)) in KERNELS.into_iter().enumerate() {
                let config = FieldConfig {
                    kernel,
                    sigma,
                    ..first.job.config.field.clone()
                };
                let field = survey.setting.field_of(&config);
                let directions = survey.directions.iter();
                let potential: Vec<f64> = directions.map(|d| field.u_info(*d)).collect();
                let [whole, partial] = survey.correlations(&potential);
                table.row([
                    scene.into(),
                    format!("U_info, {label}").into(),
                    count.into(),
                    whole.into(),
                    partial.into(),
                    low_share(&potential).map(Figure::exact).into(),
                    seconds.into(),
                ]);
                let title = format!("{scene}: {label}");
                let number = (i + 1).to_string();
                let of_angle = by_angle(&title, angles, &potential, &survey.psnr);
                let of_quality = scatter(
                    &title,
                    ("information potential U_info", &potential),
                    &survey.psnr,
                    angles,
                );
                for (words, plot) in [
                    (vec!["kernel", "angle", scene, &number], of_angle),
                    (vec!["kernel", scene, &number], of_quality),
                ] {
                    report.pictures.push(Picture {
                        name: file_name(&words),
                        svg: plot.to_svg()?,
                    });
                }
            }
            let [whole, _] = survey.correlations(angles);
            table.row([
                scene.into(),
                "angle to the nearest view".into(),
                count.into(),
                whole.into(),
                Cell::Figure(None),
                Cell::Figure(None),
                seconds.into(),
            ]);
        }
        report.tables.push(table);
        Ok(report)
    }
}

/// Plots the potential over the angle to the nearest training view, the paper's axis; colour is
/// PSNR, the mean over the seeds.
fn by_angle(title: &str, angles: &[f64], potential: &[f64], psnr: &[Vec<f64>]) -> Plot {
    let points = angles.iter().zip(potential);
    let points = points.map(|(x, y)| Point::new(*x, *y)).collect();
    let mean = |i: usize| psnr.iter().map(|seed| seed[i]).sum::<f64>() / psnr.len() as f64;
    let mut plot = Plot::new(
        title,
        Axis::linear("angle to the nearest training view, degrees; colour: PSNR"),
        Axis::linear("information potential U_info"),
    );
    plot.color_label = "PSNR, dB".to_owned();
    let colors = (0..angles.len()).map(mean).collect();
    plot.with("", Style::Colored(colors), points)
}

/// Returns the share of the values in the lowest part of their range; none where they do not
/// differ.
fn low_share(values: &[f64]) -> Option<f64> {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let limit = least + LOW * (greatest - least);
    let n_low = values.iter().filter(|v| **v <= limit).count();
    (greatest > least).then(|| n_low as f64 / values.len() as f64)
}
