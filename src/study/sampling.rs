//! Ways to choose the virtual views (Table 4).

use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, gain, psnr_at, quality, scenes};
use super::runs::Results;
use super::table::{Column, DataTable};
use super::{Picture, Report, Study};
use crate::error::Result;
use crate::report::plot::{Axis, Plot, Style};

/// Name of the variant, strategy, and what it is called in the paper.
const STRATEGIES: [(&str, &str, &str); 5] = [
    ("paper-nearest-angle", "nearest_angle", "nearest angle"),
    ("paper-sphere-uniform", "sphere_uniform", "uniform sphere"),
    ("paper-sphere-farthest", "sphere_farthest", "farthest point"),
    ("paper-interpolation", "interpolation", "interpolation"),
    (METHOD, "potential", "potential field"),
];

/// The method's own strategy is its preset.
const METHOD: &str = "paper";

pub struct Sampling;

impl Study for Sampling {
    fn question(&self) -> &'static str {
        "Which way to choose the virtual views helps most, all else as in the method (the \
         paper's Table 4)."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let variant = |(name, strategy, _): (&str, &str, &str)| {
            base.variant(name, "paper", &[format!("views.strategy={strategy}")])
        };
        STRATEGIES.into_iter().map(variant).collect()
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let columns = [
            SCENE,
            Column::text("strategy", "strategy"),
            PSNR,
            SSIM,
            LPIPS,
            Column::text("difference", "against the field, dB"),
        ];
        let mut table = DataTable::new("sampling", &columns);
        for scope in results.scopes() {
            for (name, _, label) in STRATEGIES {
                let against = match name {
                    METHOD => String::new(),
                    _ => gain(&scope, name, METHOD),
                };
                let head = [scope.name.clone().into(), label.into()];
                let cells = head.into_iter().chain(quality(&scope, name));
                table.row(cells.chain([against.into()]));
            }
        }
        let labels = STRATEGIES.map(|(_, _, label)| label.to_owned());
        let mut plot = Plot::new(
            "PSNR at the test views by the choice of virtual views",
            Axis::categories("strategy", labels.to_vec()),
            Axis::linear("PSNR, dB"),
        );
        for scope in scenes(results) {
            let strategies = STRATEGIES.iter().enumerate();
            let points = strategies.filter_map(|(i, (name, ..))| psnr_at(&scope, name, i as f64));
            plot = plot.with(&scope.name, Style::Marks, points.collect());
        }
        Ok(Report {
            tables: vec![table],
            pictures: vec![Picture {
                name: "sampling".to_owned(),
                svg: plot.to_svg()?,
            }],
            notes: Vec::new(),
        })
    }
}
