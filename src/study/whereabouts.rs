//! This module tabulates and draws where errors lie: by pixels, by what would take them away, and by
//! the angle to the nearest training camera.

use super::errors::{MethodErrors, PARTS, REMEDIES, SceneErrors, ViewErrors, share, sum};
use super::quality::SCENE;
use super::{Picture, file_name};
use crate::error::Result;
use crate::metrics::mean;
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::report::stats::Figure;
use crate::report::{Cell, Column, Table};

/// What the remedies are, for the report's notes.
pub(super) const REMEDY_NOTE: &str = "What a remedy takes away is no metric of a method, as it \
     looks at the test photographs. A fit of a view's colours is by least squares over all its \
     pixels: an upper bound of what exposure and white balance cost. A window is an upper bound of \
     what misplacement by so many pixels costs, as among more colours some fits better by chance, \
     too. Remedies overlap; decibels are means over the test views.";

/// Bounds of the table's angles, degrees.
const BOUNDS: [f64; 10] = [0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 180.0];

/// Tables and pictures of where the errors of a study's runs lie.
pub(super) struct Whereabouts {
    /// The variant whose error is the measure of all in the pictures.
    base: &'static str,
    /// Variants that are shown by angle.
    by_angle: [&'static str; 3],
    pub where_table: Table,
    pub remedies: Table,
    pub angles: Table,
    pub pictures: Vec<Picture>,
}

impl Whereabouts {
    /// Makes empty tables; those by angle are of three variants: the base, the ceiling and a baseline.
    pub(super) fn new(base: &'static str, by_angle: [&'static str; 3]) -> Whereabouts {
        Whereabouts {
            base,
            by_angle,
            where_table: where_table(),
            remedies: remedy_table(),
            angles: angle_table(),
            pictures: Vec::new(),
        }
    }

    /// Adds a scene's rows and pictures.
    ///
    /// # Errors
    /// A picture that cannot be drawn.
    pub(super) fn add(&mut self, errors: &SceneErrors) -> Result<()> {
        for method in &errors.methods {
            for part in 0..PARTS.len() {
                self.where_table.row(where_row(errors, method, part));
            }
            for k in 0..REMEDIES.len() {
                self.remedies.row(remedy_row(errors.scene, method, k));
            }
        }
        for bounds in BOUNDS.windows(2) {
            let bin = Bin::of(errors, [bounds[0], bounds[1]]);
            if !bin.views.is_empty() {
                self.angles.row(angle_row(errors, &bin, &self.by_angle));
            }
        }
        let pictures = [
            ("where", where_plot(errors, self.base)),
            ("angle", angle_plot(errors, &self.by_angle)),
        ];
        for (word, plot) in pictures {
            self.pictures.push(Picture {
                name: file_name(&["ceiling", word, errors.scene]),
                svg: plot.to_svg()?,
            });
        }
        Ok(())
    }
}

fn percent(share: f64) -> f64 {
    100.0 * share
}

fn where_table() -> Table {
    let columns = [
        SCENE,
        Column::text("method", "method"),
        Column::text("pixels", "pixels"),
        Column::number("pixel_share", "of the pixels, %", 1),
        Column::figure("error_share", "of the squared error, %", 1),
        Column::figure("mse", "mean squared error, levels²", 0),
    ];
    Table::new("ceiling-where", &columns)
}

fn where_row(errors: &SceneErrors, method: &MethodErrors, part: usize) -> [Cell; 6] {
    let n_pixels = errors.ground.n_pixels(part) as f64;
    let n_all: usize = (0..PARTS.len())
        .map(|part| errors.ground.n_pixels(part))
        .sum();
    let mse = |views: &[ViewErrors]| {
        let mean = sum(views, |view| view.parts[part]) / (3.0 * n_pixels);
        (n_pixels > 0.0).then_some(mean)
    };
    [
        errors.scene.into(),
        method.label.into(),
        PARTS[part].into(),
        percent(n_pixels / n_all as f64).into(),
        method
            .figure(|views| share(views, |view| view.parts[part]).map(percent))
            .into(),
        method.figure(mse).into(),
    ]
}

fn remedy_table() -> Table {
    let columns = [
        SCENE,
        Column::text("method", "method"),
        Column::text("remedy", "if each test view had"),
        Column::figure("error_share", "of the squared error would go, %", 1),
        Column::figure("db", "PSNR would rise, dB", 2),
    ];
    Table::new("ceiling-remedies", &columns)
}

fn remedy_row(scene: &str, method: &MethodErrors, k: usize) -> [Cell; 5] {
    let gone = |view: &ViewErrors| view.whole - view.remedied()[k];
    let decibels = |views: &[ViewErrors]| {
        let of_view = |view: &ViewErrors| match view.whole > 0.0 {
            true => 10.0 * (view.whole / view.remedied()[k]).log10(),
            false => 0.0,
        };
        (!views.is_empty()).then(|| sum(views, of_view) / views.len() as f64)
    };
    [
        scene.into(),
        method.label.into(),
        REMEDIES[k].into(),
        method
            .figure(|views| share(views, gone).map(percent))
            .into(),
        method.figure(decibels).into(),
    ]
}

/// Test views whose angles lie between two bounds.
struct Bin {
    bounds: [f64; 2],
    /// Indices of the views.
    views: Vec<usize>,
    /// Their mean angle, degrees.
    angle: f64,
}

impl Bin {
    fn of(errors: &SceneErrors, [low, high]: [f64; 2]) -> Bin {
        let angles = &errors.ground.angles;
        // Nothing is beyond the last bound, which belongs to the last bin.
        let is_in = |angle: f64| low <= angle && (angle < high || high >= 180.0);
        let views: Vec<usize> = (0..angles.len()).filter(|i| is_in(angles[*i])).collect();
        let angle = views.iter().map(|i| angles[*i]).sum::<f64>() / views.len() as f64;
        Bin {
            bounds: [low, high],
            views,
            angle,
        }
    }

    /// Returns the mean PSNR of a method at these views, dB.
    fn psnr(&self, method: &MethodErrors) -> Option<Figure> {
        Figure::of(method.runs.iter().map(|run| {
            let psnr = self
                .views
                .iter()
                .map(|i| run.evaluation.views.get(*i)?.psnr);
            mean(psnr)
        }))
    }

    /// Returns the share of a method's whole squared error that lies in these views, percent.
    fn error_share(&self, method: &MethodErrors) -> Option<Figure> {
        method.figure(|views| {
            let here: f64 = self.views.iter().map(|i| views[*i].whole).sum();
            let whole = sum(views, |view| view.whole);
            (whole > 0.0).then(|| percent(here / whole))
        })
    }
}

fn angle_table() -> Table {
    let columns = [
        SCENE,
        Column::text("angle", "degrees to the nearest training camera"),
        Column::number("n_views", "test views", 0),
        Column::figure("psnr_default", "default, PSNR dB", 2),
        Column::figure("psnr_ceiling", "ceiling, PSNR dB", 2),
        Column::figure("psnr_3dgs", "3dgs, PSNR dB", 2),
        Column::figure("share_default", "default, of the squared error, %", 1),
        Column::figure("share_ceiling", "ceiling, %", 1),
        Column::figure("share_3dgs", "3dgs, %", 1),
    ];
    Table::new("ceiling-angle", &columns)
}

fn angle_row(errors: &SceneErrors, bin: &Bin, variants: &[&str; 3]) -> Vec<Cell> {
    let mut cells: Vec<Cell> = vec![
        errors.scene.into(),
        format!("{} to {}", bin.bounds[0], bin.bounds[1]).into(),
        bin.views.len().into(),
    ];
    let methods = || variants.iter().map(|variant| errors.method(variant));
    cells.extend(methods().map(|method| method.and_then(|m| bin.psnr(m)).into()));
    cells.extend(methods().map(|method| method.and_then(|m| bin.error_share(m)).into()));
    cells
}

fn point(x: f64, figure: Figure) -> Point {
    Point {
        x,
        y: figure.mean,
        spread: figure.deviation,
    }
}

/// Draws the error of each part, in shares of what the base has in all.
fn where_plot(errors: &SceneErrors, base: &str) -> Plot {
    let title = format!("{}: where the squared error lies", errors.scene);
    // The parts' names are too long for an axis.
    let numbers = (1..=PARTS.len()).map(|number| number.to_string()).collect();
    let mut plot = Plot::new(
        &title,
        Axis::categories(
            "1, 2: covered, edges and elsewhere; 3, 4: not covered, edges and elsewhere",
            numbers,
        ),
        Axis::linear("squared error, % of the default's whole"),
    );
    for method in &errors.methods {
        let of_part = |part: usize| {
            let of_base = |views: &[ViewErrors], whole: &[ViewErrors]| {
                let whole = sum(whole, |view| view.whole);
                (whole > 0.0).then(|| percent(sum(views, |view| view.parts[part]) / whole))
            };
            let figure = errors.figure_of_two((method.variant, base), of_base)?;
            Some(point(part as f64, figure))
        };
        let points = (0..PARTS.len()).filter_map(of_part).collect();
        plot = plot.with(method.label, Style::Marks, points);
    }
    plot
}

fn angle_plot(errors: &SceneErrors, variants: &[&str; 3]) -> Plot {
    let title = format!("{}: PSNR by angle", errors.scene);
    let mut plot = Plot::new(
        &title,
        Axis::linear("degrees to the nearest training camera, means of bins"),
        Axis::linear("PSNR at the test views, dB"),
    );
    let bins: Vec<Bin> = BOUNDS
        .windows(2)
        .map(|bounds| Bin::of(errors, [bounds[0], bounds[1]]))
        .filter(|bin| !bin.views.is_empty())
        .collect();
    for method in variants.iter().filter_map(|variant| errors.method(variant)) {
        let at = |bin: &Bin| Some(point(bin.angle, bin.psnr(method)?));
        let points = bins.iter().filter_map(at).collect();
        plot = plot.with(method.label, Style::Curve, points);
    }
    plot
}
