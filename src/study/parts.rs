//! This study asks what the parts beyond the paper add, one by one and together.

use super::plan::{Base, Variant};
use super::quality::{
    COVERED, LPIPS, PSNR, SCENE, SSIM, TO_MODEL, covered_psnr, gain, psnr_at, quality, scenes,
};
use super::runs::Results;
use super::{Picture, Report, Study};
use crate::config::Difference;
use crate::error::Result;
use crate::report::plot::{Axis, Plot, Style};
use crate::report::{Column, Table};

/// The preset of all parts, and the one without any.
const WHOLE: &str = "gspotential";
const BASELINE: &str = "3dgs";

/// The baseline without densification: what parts are added to.
const BASE: &str = "parts-base";

/// A part of the method: the keys in which the presets differ by it.
struct Part {
    name: &'static str,
    /// In the variants' names.
    word: &'static str,
    keys: &'static [&'static str],
    /// Whether it is about virtual views, and does nothing without.
    of_views: bool,
}

const fn part(
    name: &'static str,
    word: &'static str,
    keys: &'static [&'static str],
    of_views: bool,
) -> Part {
    Part {
        name,
        word,
        keys,
        of_views,
    }
}

const DENSIFY: &[&str] = &["densify.enabled"];

/// Virtual views are the first: those about them are added to it.
const PARTS: [Part; 7] = [
    part("virtual views", "views", &["views.count"], false),
    part(
        "visible candidates",
        "visibility",
        &[
            "views.visibility.enabled",
            "views.visibility.power",
            "views.visibility.min_share",
        ],
        true,
    ),
    part(
        "masked pixels",
        "mask",
        &["views.visibility.mask_angle_deg"],
        true,
    ),
    part("filled holes", "fill", &["loss.fill_weight"], true),
    part("blended photographs", "blend", &["splat.colors"], true),
    part("carving", "carve", &["carve.enabled"], false),
    part("far shell", "shell", &["shell.count"], false),
];

impl Part {
    fn added(&self) -> String {
        format!("parts-with-{}", self.word)
    }

    fn left_out(&self) -> String {
        format!("parts-without-{}", self.word)
    }

    /// Returns the keys that leave the part out; without virtual views, what is about them goes,
    /// too.
    fn dependent_keys(&self) -> Vec<&'static str> {
        let is_views = self.keys == PARTS[0].keys;
        let dependent = PARTS.iter().filter(|part| is_views && part.of_views);
        let keys = self.keys.iter().chain(dependent.flat_map(|part| part.keys));
        keys.copied().collect()
    }
}

/// Settings that the whole has not taken, added to it: variant, what it is called, and setting.
const LEFT_ASIDE: [(&str, &str, &str); 3] = [
    (
        "parts-with-densification",
        "densification",
        "densify.enabled=true",
    ),
    ("parts-with-dropout", "dropout", "dropout.rate_end=0.2"),
    (
        "parts-with-weights",
        "candidates weighed by visibility",
        "views.visibility.power=2",
    ),
];

/// A row of the table: its variant, what it is called, and the row that it is compared with.
struct Row {
    variant: String,
    label: String,
    over: Option<usize>,
}

fn rows() -> Vec<Row> {
    let row = |variant: &str, label: &str, over: Option<usize>| Row {
        variant: variant.to_owned(),
        label: label.to_owned(),
        over,
    };
    let mut rows = vec![
        row(BASELINE, "3dgs", None),
        row("paper", "paper", Some(0)),
        row(BASE, "3dgs without densification", Some(0)),
    ];
    let base = rows.len() - 1;
    for part in &PARTS {
        let (label, over) = match part.of_views {
            true => (format!("+ {} + {}", PARTS[0].name, part.name), base + 1),
            false => (format!("+ {}", part.name), base),
        };
        rows.push(row(&part.added(), &label, Some(over)));
    }
    rows.push(row(WHOLE, WHOLE, Some(1)));
    let whole = rows.len() - 1;
    for part in &PARTS {
        let label = format!("{WHOLE} - {}", part.name);
        rows.push(row(&part.left_out(), &label, Some(whole)));
    }
    for (variant, what, _) in LEFT_ASIDE {
        rows.push(row(variant, &format!("{WHOLE} + {what}"), Some(whole)));
    }
    rows
}

/// Returns the number of row `i` in the table.
fn number(i: usize) -> String {
    (i + 1).to_string()
}

pub(crate) struct Parts;

impl Study for Parts {
    fn question(&self) -> &'static str {
        "What each part of the preset `gspotential` adds to 3DGS without densification, what the \
         preset loses without it, and what it would gain from parts that it has not taken; the \
         paper's method and 3DGS beside them."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let whole = base.config(WHOLE, &[])?;
        let none = base.config(BASELINE, &[])?;
        let differences = whole.differences(&none)?;
        // Values of the keys in the whole or without any part.
        let settings = |keys: &[&str], of_whole: bool| -> Vec<String> {
            let own = differences
                .iter()
                .filter(|difference| keys.contains(&difference.key.as_str()));
            own.map(|Difference { key, here, there }| {
                format!("{key}={}", if of_whole { here } else { there })
            })
            .collect()
        };
        let mut variants = base.presets(&[BASELINE, "paper", WHOLE])?;
        variants.push(base.variant(BASE, BASELINE, &settings(DENSIFY, true))?);
        for part in &PARTS {
            let over = match part.of_views {
                true => PARTS[0].keys,
                false => &[],
            };
            let added = settings(&[DENSIFY, over, part.keys].concat(), true);
            variants.push(base.variant(&part.added(), BASELINE, &added)?);
            let left_out = settings(&part.dependent_keys(), false);
            variants.push(base.variant(&part.left_out(), WHOLE, &left_out)?);
        }
        for (variant, _, setting) in LEFT_ASIDE {
            variants.push(base.variant(variant, WHOLE, &[setting.to_owned()])?);
        }
        Ok(variants)
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let columns = [
            SCENE,
            Column::text("row", "row"),
            Column::text("method", "method"),
            PSNR,
            SSIM,
            LPIPS,
            TO_MODEL,
            COVERED,
            Column::quantity("gain", "PSNR gain dB"),
        ];
        let rows = rows();
        let mut table = Table::new("parts", &columns);
        for scope in results.scopes() {
            for (i, row) in rows.iter().enumerate() {
                let gained = row.over.map_or(String::new(), |over| {
                    let gained = gain(&scope, &row.variant, &rows[over].variant);
                    format!("{gained} over row {}", over + 1)
                });
                let head = [
                    scope.name.clone().into(),
                    number(i).into(),
                    row.label.as_str().into(),
                ];
                let cells = head.into_iter().chain(quality(&scope, &row.variant));
                let covered = scope.figure(&row.variant, covered_psnr);
                table.row(cells.chain([covered.into(), gained.into()]));
            }
        }
        let mut plot = Plot::new(
            "PSNR at the test views with parts added and left out",
            Axis::categories("row of the table", (0..rows.len()).map(number).collect()),
            Axis::linear("PSNR, dB"),
        );
        for scope in scenes(results) {
            let points = rows.iter().enumerate();
            let points = points.filter_map(|(i, row)| psnr_at(&scope, &row.variant, i as f64));
            plot = plot.with(&scope.name, Style::Marks, points.collect());
        }
        Ok(Report {
            tables: vec![table],
            pictures: vec![Picture {
                name: "parts".to_owned(),
                svg: plot.to_svg()?,
            }],
            notes: vec![format!(
                "Without {}, what is about them is off, too.",
                PARTS[0].name
            )],
        })
    }
}
