//! This study compares ways to choose the virtual views (Table 4).

use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, TO_MODEL, gain, psnr_at, quality, scenes};
use super::renders::Method;
use super::runs::Results;
use super::{Picture, Report, Study};
use crate::error::Result;
use crate::report::plot::{Axis, Plot, Style};
use crate::report::{Column, Table};

/// A row of the table.
struct Strategy {
    /// Name of its variant.
    name: &'static str,
    /// What it sets.
    setting: &'static str,
    /// What it is called on paper.
    label: &'static str,
}

/// The paper's five, and the field weighted by what the training cameras see.
const STRATEGIES: [Strategy; 6] = [
    Strategy {
        name: "paper-nearest-angle",
        setting: "views.strategy=nearest_angle",
        label: "nearest angle",
    },
    Strategy {
        name: "paper-sphere-uniform",
        setting: "views.strategy=sphere_uniform",
        label: "uniform sphere",
    },
    Strategy {
        name: "paper-sphere-farthest",
        setting: "views.strategy=sphere_farthest",
        label: "farthest point",
    },
    Strategy {
        name: "paper-interpolation",
        setting: "views.strategy=interpolation",
        label: "interpolation",
    },
    Strategy {
        name: METHOD,
        setting: "views.strategy=potential",
        label: "potential field",
    },
    Strategy {
        name: "paper-visibility",
        setting: "views.visibility.enabled=true",
        label: "field and visibility",
    },
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
        let variant = |strategy: &Strategy| {
            base.variant(strategy.name, "paper", &[strategy.setting.to_owned()])
        };
        STRATEGIES.iter().map(variant).collect()
    }

    fn methods(&self, _results: &Results) -> Vec<Method> {
        let method = |strategy: &Strategy| Method {
            label: strategy.label.to_owned(),
            variant: strategy.name.to_owned(),
        };
        STRATEGIES.iter().map(method).collect()
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
            for Strategy { name, label, .. } in STRATEGIES {
                let against = match name {
                    METHOD => String::new(),
                    _ => gain(&scope, name, METHOD),
                };
                let head = [scope.name.clone().into(), label.into()];
                let cells = head.into_iter().chain(quality(&scope, name));
                table.row(cells.chain([against.into()]));
            }
        }
        let labels = STRATEGIES.map(|strategy| strategy.label.to_owned());
        let mut plot = Plot::new(
            "PSNR at the test views by the choice of virtual views",
            Axis::categories("strategy", labels.to_vec()),
            Axis::linear("PSNR, dB"),
        );
        for scope in scenes(results) {
            let strategies = STRATEGIES.iter().enumerate();
            let points = strategies.filter_map(|(i, s)| psnr_at(&scope, s.name, i as f64));
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
