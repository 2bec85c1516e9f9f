//! This study asks what is left to gain: how far the default is from the same settings with all
//! photographs or an exact cloud, and where its error lies.

use super::errors::{EDGE_QUANTILE, REACHES, SceneErrors, ViewErrors, share, sum};
use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, TO_MODEL, gain, quality};
use super::renders::Method;
use super::runs::Results;
use super::whereabouts::{REMEDY_NOTE, Whereabouts};
use super::{Report, Study};
use crate::error::Result;
use crate::pipeline::TrainJob;
use crate::report::stats::Figure;
use crate::report::{Cell, Column, Table};
use crate::scene::{CloudSource, SceneSource, View};

const DEFAULT: &str = "gspotential";
const CEILING: &str = "gspotential-all-photographs";
const EXACT: &str = "gspotential-exact-cloud";
const BASELINE: &str = "3dgs";

/// Variants, the best-informed last, and what they are called.
const METHODS: [(&str, &str); 5] = [
    (BASELINE, "3dgs"),
    ("paper", "paper"),
    (DEFAULT, "gspotential"),
    (EXACT, "gspotential, exact cloud"),
    (CEILING, "gspotential, all photographs"),
];

/// Variants that the tables and the plot by angle show.
const BY_ANGLE: [&str; 3] = [DEFAULT, CEILING, BASELINE];

pub(crate) struct Ceiling;

impl Study for Ceiling {
    fn question(&self) -> &'static str {
        "What is left to gain: the default preset beside the same settings trained on all \
         photographs, test views among them (the ceiling), and, on the built-in scene, from an exact \
         cloud; where its error lies, and what would take it away."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let mut variants = base.presets(&[BASELINE, "paper", DEFAULT])?;
        if !matches!(base.source(), SceneSource::Folder(_)) {
            let Variant { name, job } = base.variant(EXACT, DEFAULT, &[])?;
            let cloud = Some(CloudSource::Exact);
            let job = TrainJob { cloud, ..job };
            variants.push(Variant { name, job });
        }
        let Variant { name, job } = base.variant(CEILING, DEFAULT, &[])?;
        let scene = job.load()?;
        let names = |views: &[View]| -> Vec<String> {
            let names = views.iter().map(|view| view.camera.name.clone());
            names.collect()
        };
        let job = TrainJob {
            train_views: Some([names(&scene.train), names(&scene.test)].concat()),
            test_views: Some(names(&scene.test)),
            overlap: true,
            ..job
        };
        variants.push(Variant { name, job });
        Ok(variants)
    }

    fn methods(&self, results: &Results) -> Vec<Method> {
        let scenes = results.scenes();
        let in_all = |variant: &str| scenes.iter().all(|s| !results.of(s, variant).is_empty());
        let methods = METHODS.iter().filter(|(variant, _)| in_all(variant));
        let method = |(variant, label): &(&str, &str)| Method {
            label: (*label).to_owned(),
            variant: (*variant).to_owned(),
        };
        methods.map(method).collect()
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let mut whereabouts = Whereabouts::new(DEFAULT, BY_ANGLE);
        let mut reach = reach_table();
        let mut notes = vec![what_is_what(), REMEDY_NOTE.to_owned()];
        for scene in results.scenes() {
            let Some(errors) = SceneErrors::of(results, scene, (DEFAULT, &METHODS))? else {
                continue;
            };
            whereabouts.add(&errors)?;
            for k in 0..REACHES.len() {
                reach.row(reach_row(&errors, k));
            }
            notes.extend(conclusion(&errors));
        }
        let Whereabouts {
            where_table,
            remedies,
            angles,
            pictures,
            ..
        } = whereabouts;
        Ok(Report {
            tables: vec![quality_table(results), reach, where_table, remedies, angles],
            pictures,
            notes,
        })
    }
}

fn what_is_what() -> String {
    format!(
        "The ceiling is no method: it has seen what it is measured at. It has the default's \
         settings and iterations, so it is what these can hold, not what any could. All errors \
         are squared, of renders rounded to 8 bit, over all test views together. Covered pixels \
         are those of the scene's own cloud, edges the {:.0} % of a photograph's pixels in which \
         brightness is steepest. In the second table geometry is what the best colour within a \
         window takes away, and colour the rest; within reach is what the ceiling has less of \
         either (below 0: more), and nobody's what it has, too, all in shares of the default's \
         error.",
        100.0 * (1.0 - EDGE_QUANTILE)
    )
}

fn quality_table(results: &Results) -> Table {
    let columns = [
        SCENE,
        Column::text("method", "method"),
        PSNR,
        SSIM,
        LPIPS,
        TO_MODEL,
        Column::quantity("gain", "over the default, dB"),
    ];
    let mut table = Table::new("ceiling", &columns);
    for scope in results.scopes() {
        for (variant, label) in METHODS.iter().filter(|(variant, _)| scope.has(variant)) {
            let gained = match *variant {
                DEFAULT => String::new(),
                _ => gain(&scope, variant, DEFAULT),
            };
            let head: [Cell; 2] = [scope.name.clone().into(), (*label).into()];
            let cells = head.into_iter().chain(quality(&scope, variant));
            table.row(cells.chain([gained.into()]));
        }
    }
    table
}

/// Shares of the default's squared error, which sum to 1.
#[derive(Clone, Copy)]
struct Shares {
    /// What the ceiling has less of what the window takes away.
    geometry: f64,
    /// What the ceiling has less of what the window leaves.
    colour: f64,
    /// What the ceiling has, too.
    nobodys: f64,
}

impl Shares {
    /// Compares the errors of one seed, with the window of that index; `None` if there is no error.
    fn of(default: &[ViewErrors], ceiling: &[ViewErrors], k: usize) -> Option<Shares> {
        let whole = sum(default, |view| view.whole);
        let left = sum(default, |view| view.within[k]) - sum(ceiling, |view| view.within[k]);
        let nobodys = sum(ceiling, |view| view.whole);
        let share = |error: f64| error / whole;
        (whole > 0.0).then(|| Shares {
            geometry: share(whole - nobodys - left),
            colour: share(left),
            nobodys: share(nobodys),
        })
    }
}

fn percent(errors: &SceneErrors, k: usize, of: fn(Shares) -> f64) -> Option<Figure> {
    errors.figure_of_two((DEFAULT, CEILING), |default, ceiling| {
        Some(100.0 * of(Shares::of(default, ceiling, k)?))
    })
}

/// Returns the share of the default's error that an exact cloud takes away, percent.
fn clouds_percent(errors: &SceneErrors) -> Option<Figure> {
    errors.figure_of_two((DEFAULT, EXACT), |default, exact| {
        let left = sum(exact, |view| view.whole) / sum(default, |view| view.whole);
        left.is_finite().then_some(100.0 * (1.0 - left))
    })
}

fn reach_table() -> Table {
    let columns = [
        SCENE,
        Column::text("window", "window"),
        Column::figure("geometry", "within reach, geometry, %", 1),
        Column::figure("colour", "within reach, colour, %", 1),
        Column::figure("nobodys", "nobody's, %", 1),
        Column::figure("cloud", "an exact cloud takes away, %", 1),
    ];
    Table::new("ceiling-reach", &columns)
}

fn reach_row(errors: &SceneErrors, k: usize) -> [Cell; 6] {
    [
        errors.scene.into(),
        format!("±{} px", REACHES[k]).into(),
        percent(errors, k, |shares| shares.geometry).into(),
        percent(errors, k, |shares| shares.colour).into(),
        percent(errors, k, |shares| shares.nobodys).into(),
        clouds_percent(errors).into(),
    ]
}

/// Says how much less error there is, a percentage, in words that have no sign.
fn less(percent: f64) -> String {
    let which = if percent < 0.0 { "more" } else { "less" };
    format!("{:.0} % {which}", percent.abs())
}

/// Says of a scene in words which share of the default's error is whose.
fn conclusion(errors: &SceneErrors) -> Option<String> {
    let last = REACHES.len() - 1;
    let mean = |k: usize, of: fn(Shares) -> f64| Some(percent(errors, k, of)?.mean);
    let nobodys = mean(last, |shares| shares.nobodys)?;
    let whose = if nobodys >= 100.0 {
        format!(
            "the ceiling has {nobodys:.0} % of the default's squared error, so none of it is \
             shown to be within reach of more photographs"
        )
    } else {
        format!(
            "{nobodys:.0} % of the default's squared error is nobody's, as the ceiling has it, \
             too; it has {} geometry by the window of ±{} px ({} by ±{} px) and {} colour",
            less(mean(last, |shares| shares.geometry)?),
            REACHES[last],
            less(mean(0, |shares| shares.geometry)?),
            REACHES[0],
            less(mean(last, |shares| shares.colour)?),
        )
    };
    let default = errors.method(DEFAULT)?;
    let fit = default.figure(|views| share(views, |view| view.whole - view.remedied()[0]))?;
    let covered = default.figure(|views| share(views, |view| view.parts[0] + view.parts[1]))?;
    let cloud = clouds_percent(errors).map_or(String::new(), |figure| {
        format!("; from an exact cloud there is {}", less(figure.mean))
    });
    Some(format!(
        "{}: {whose}. Gain and offset of each test view would take away {:.0} %{cloud}; {:.0} % \
         of the error lies where the cloud covers the view.",
        errors.scene,
        100.0 * fit.mean,
        100.0 * covered.mean
    ))
}
