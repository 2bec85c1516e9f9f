//! Kernels of the information potential against the quality of what is rendered (the kernel
//! figure and the figure of potential and quality).

use super::plan::{Base, Variant};
use super::quality::SCENE;
use super::runs::Results;
use super::table::{Column, DataTable};
use super::viewpoints::{Setting, correlations, measure, scatter};
use super::{Picture, Report, Study, file_name};
use crate::config::{FieldConfig, Kernel};
use crate::error::Result;
use crate::eval::EvalOptions;
use crate::gpu::Gpu;
use crate::report::stats::Figure;

/// The paper's three, by kernel and concentration.
const KERNELS: [(&str, Kernel, f64); 3] = [
    ("von Mises-Fisher, kappa 3.0", Kernel::VonMisesFisher, 3.0),
    ("sech, sigma 5.3", Kernel::Sech, 5.298292365610484),
    ("von Mises-Fisher, kappa 4.4", Kernel::VonMisesFisher, 4.4),
];

/// What is trained: the paper asks about 3DGS alone.
const PRESET: &str = "3dgs";

const COLUMNS: [Column; 5] = [
    SCENE,
    Column::text("predictor", "predictor"),
    Column::figure("viewpoints", "viewpoints", 0),
    Column::figure("spearman", "Spearman", 3),
    Column::figure("partial", "at equal angle", 3),
];

pub struct KernelStudy;

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
                 training view, what the potential tells beyond it. Viewpoints: of the built-in \
                 scene all over the sphere, outside objects and above the floor, against \
                 ray-traced truth; of a folder its test views."
                    .to_owned(),
            ],
            ..Report::default()
        };
        let mut table = DataTable::new("kernel", &COLUMNS);
        for scene in results.scenes() {
            let runs = results.of(scene, PRESET);
            let Some(first) = runs.first() else { continue };
            let setting = Setting::of(first)?;
            let views = setting.viewpoints()?;
            let directions: Vec<_> = views.iter().map(|v| setting.direction(&v.camera)).collect();
            let angles: Vec<f64> = directions.iter().map(|d| setting.nearest_deg(*d)).collect();
            let mut psnr: Vec<Vec<f64>> = Vec::new();
            for run in &runs {
                let scores =
                    measure(&gpu, run, &setting.frame, &views, &EvalOptions::default())?.views;
                psnr.push(
                    scores
                        .iter()
                        .map(|v| v.psnr.unwrap_or(f64::INFINITY))
                        .collect(),
                );
            }
            let count = Some(Figure::exact(views.len() as f64));
            for (i, (label, kernel, sigma)) in KERNELS.into_iter().enumerate() {
                let config = FieldConfig {
                    kernel,
                    sigma,
                    ..first.job.config.field.clone()
                };
                let field = setting.field_of(&config);
                let potential: Vec<f64> = directions.iter().map(|d| field.u_info(*d)).collect();
                let [whole, partial] = correlations(&potential, &psnr, &angles);
                table.row([
                    scene.into(),
                    format!("U_info, {label}").into(),
                    count.into(),
                    whole.into(),
                    partial.into(),
                ]);
                let plot = scatter(
                    &format!("{scene}: {label}"),
                    ("information potential U_info", &potential),
                    &psnr,
                    &angles,
                );
                report.pictures.push(Picture {
                    name: file_name(&["kernel", scene, &(i + 1).to_string()]),
                    svg: plot.to_svg()?,
                });
            }
            let [whole, _] = correlations(&angles, &psnr, &angles);
            table.row([
                scene.into(),
                "angle to the nearest view".into(),
                count.into(),
                whole.into(),
                None.into(),
            ]);
        }
        report.tables.push(table);
        Ok(report)
    }
}
