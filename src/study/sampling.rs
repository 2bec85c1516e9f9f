//! This study compares ways to choose the virtual views (Table 4).

use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, TO_MODEL, gain, psnr_at, quality, scenes};
use super::renders::Method;
use super::runs::Results;
use super::{Picture, Report, Study};
use crate::error::Result;
use crate::report::plot::{Axis, Plot, Style};
use crate::report::{Column, Table};

/// Name of the variant, what it sets, and what it is called: the paper's five, and the field
/// weighted by what the training cameras see.
const STRATEGIES: [(&str, &str, &str); 6] = [
    (
        "paper-nearest-angle",
        "views.strategy=nearest_angle",
        "nearest angle",
    ),
    (
        "paper-sphere-uniform",
        "views.strategy=sphere_uniform",
        "uniform sphere",
    ),
    (
        "paper-sphere-farthest",
        "views.strategy=sphere_farthest",
        "farthest point",
    ),
    (
        "paper-interpolation",
        "views.strategy=interpolation",
        "interpolation",
    ),
    (METHOD, "views.strategy=potential", "potential field"),
    (
        "paper-visibility",
        "views.visibility.enabled=true",
        "field and visibility",
    ),
];

/// The method's own strategy is its preset.
const METHOD: &str = "paper";

pub(crate) struct Sampling;

impl Study for Sampling {
    fn question(&self) -> &'static str {
        "Which way to choose the virtual views helps most, all else as in the method (the \
         paper's Table 4, and the field weighted by visibility beside it)."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let variant = |(name, setting, _): (&str, &str, &str)| {
            base.variant(name, "paper", &[setting.to_owned()])
        };
        STRATEGIES.into_iter().map(variant).collect()
    }

    fn methods(&self, _results: &Results) -> Vec<Method> {
        STRATEGIES
            .map(|(name, _, label)| (label.to_owned(), name.to_owned()))
            .to_vec()
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let columns = [
            SCENE,
            Column::text("strategy", "strategy"),
            PSNR,
            SSIM,
            LPIPS,
            TO_MODEL,
            Column::quantity("difference", "against the field, dB"),
        ];
        let mut table = Table::new("sampling", &columns);
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
