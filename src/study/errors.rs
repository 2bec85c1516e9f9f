//! This module measures where the errors of finished runs lie: in which pixels of which test views,
//! and what would take them away.

use rayon::prelude::*;

use super::runs::{Finished, Results};
use super::viewpoints::Setting;
use crate::error::Result;
use crate::eval::covered_pixels;
use crate::metrics::errors::{ColourFit, edges, fitted_error, squared_errors};
use crate::report::read_png;
use crate::report::stats::Figure;
use crate::run::file_names;
use crate::scene::{Image, View};

/// Share of a photograph's pixels that are no edges.
pub(super) const EDGE_QUANTILE: f64 = 0.8;

/// The parts that the pixels of a view fall into, in the order of [`part`].
pub(super) const PARTS: [&str; 4] = [
    "covered, edges",
    "covered, elsewhere",
    "not covered, edges",
    "not covered, elsewhere",
];

/// Windows in which a pixel may take the best colour: pixels to each side.
pub(super) const REACHES: [usize; 2] = [1, 2];

/// Fits of a view's colours.
const FITS: [ColourFit; 2] = [ColourFit::Gains, ColourFit::Matrix];

/// Remedies that a test view's render may be given, in the order of [`ViewErrors::remedied`].
pub(super) const REMEDIES: [&str; 4] = [
    "the best gain and offset of each channel",
    "the best 3x4 matrix of its colours",
    "in each pixel the best colour within 1 px",
    "in each pixel the best colour within 2 px",
];

fn part(is_covered: bool, is_edge: bool) -> usize {
    2 * usize::from(!is_covered) + usize::from(!is_edge)
}

/// Squared errors of a render of a test view, levels squared, over all pixels and channels.
#[derive(Clone, Copy, Debug)]
pub(super) struct ViewErrors {
    pub whole: f64,
    /// In each of [`PARTS`].
    pub parts: [f64; PARTS.len()],
    /// What is left after a fit of its colours.
    fitted: [f64; FITS.len()],
    /// What is left where each pixel takes the best colour within each of [`REACHES`].
    pub within: [f64; REACHES.len()],
}

impl ViewErrors {
    /// Measures a render; `parts` has the part of every pixel.
    fn of(render: &Image, photograph: &Image, parts: &[usize]) -> Result<ViewErrors> {
        let errors = squared_errors(render, photograph, 0)?;
        let mut by_part = [0.0; PARTS.len()];
        for (error, part) in errors.iter().zip(parts) {
            by_part[*part] += error;
        }
        let mut fitted = [0.0; FITS.len()];
        for (left, fit) in fitted.iter_mut().zip(FITS) {
            *left = fitted_error(render, photograph, fit)?;
        }
        let mut within = [0.0; REACHES.len()];
        for (left, reach) in within.iter_mut().zip(REACHES) {
            *left = squared_errors(render, photograph, reach)?.iter().sum();
        }
        Ok(ViewErrors {
            whole: errors.iter().sum(),
            parts: by_part,
            fitted,
            within,
        })
    }

    /// Returns what is left after each of [`REMEDIES`].
    pub(super) fn remedied(&self) -> [f64; REMEDIES.len()] {
        let [gains, matrix] = self.fitted;
        let [one, two] = self.within;
        [gains, matrix, one, two]
    }
}

/// Adds up an error over the test views.
pub(super) fn sum(views: &[ViewErrors], of: impl Fn(&ViewErrors) -> f64) -> f64 {
    views.iter().map(of).sum()
}

/// Returns the share that an error has of the whole, over all test views; `None` if there is none.
pub(super) fn share(views: &[ViewErrors], of: impl Fn(&ViewErrors) -> f64) -> Option<f64> {
    let whole = sum(views, |view| view.whole);
    (whole > 0.0).then(|| sum(views, of) / whole)
}

/// What is known of a scene's test views whatever the method.
pub(super) struct Ground {
    views: Vec<View>,
    /// The part of every pixel of each view, an index into [`PARTS`].
    parts: Vec<Vec<usize>>,
    /// To the nearest training camera as seen from the focus, degrees, one a view.
    pub angles: Vec<f64>,
}

impl Ground {
    /// Loads the test views of `run`; cloud and training cameras are those that it was trained from.
    fn of(run: &Finished) -> Result<Ground> {
        let setting = Setting::of(run)?;
        let scene = &setting.scene;
        let covered = covered_pixels(&scene.cloud, &setting.frame, &scene.test, &run.job.config)?;
        let parts = scene.test.par_iter().zip(covered).map(|(view, covered)| {
            let pixels = covered.into_iter().zip(edges(&view.image, EDGE_QUANTILE)?);
            Ok(pixels.map(|(covered, edge)| part(covered, edge)).collect())
        });
        let angle = |view: &View| setting.nearest_deg(setting.direction(&view.camera));
        Ok(Ground {
            parts: parts.collect::<Result<_>>()?,
            angles: scene.test.iter().map(angle).collect(),
            views: setting.scene.test,
        })
    }

    /// Returns the number of pixels of a part, over all test views.
    pub(super) fn n_pixels(&self, part: usize) -> usize {
        self.parts.iter().flatten().filter(|p| **p == part).count()
    }

    /// Measures the renders that a run on the same test views has left, view by view.
    fn errors(&self, run: &Finished) -> Result<Vec<ViewErrors>> {
        let names: Vec<&str> = self.views.iter().map(|v| v.camera.name.as_str()).collect();
        let files = file_names(&names, "png");
        let views = (&self.views, &self.parts, &files).into_par_iter();
        let of_view = |(view, parts, file): (&View, &Vec<usize>, &String)| {
            let path = run.run.test_views().join(file);
            ViewErrors::of(&read_png(&path)?, &view.image, parts).map_err(|e| e.at_path(&path))
        };
        views.map(of_view).collect()
    }
}

/// Errors of a method on a scene.
pub(super) struct MethodErrors<'a> {
    pub variant: &'static str,
    pub label: &'static str,
    /// In the order of the seeds.
    pub runs: Vec<&'a Finished>,
    /// Errors at each test view, of every run.
    pub errors: Vec<Vec<ViewErrors>>,
}

impl MethodErrors<'_> {
    /// Returns mean and deviation over the seeds of what their errors say.
    pub(super) fn figure(&self, of: impl Fn(&[ViewErrors]) -> Option<f64>) -> Option<Figure> {
        Figure::of(self.errors.iter().map(|views| of(views)))
    }
}

/// Errors of all methods on a scene.
pub(super) struct SceneErrors<'a> {
    pub scene: &'a str,
    pub ground: Ground,
    pub methods: Vec<MethodErrors<'a>>,
}

impl<'a> SceneErrors<'a> {
    /// Measures the runs of `methods` (variant and label) on a scene, as far as there are any, on the
    /// ground of the `base` variant; `None` without a run of that.
    ///
    /// # Errors
    /// A scene or a render that can no longer be read.
    pub(super) fn of(
        results: &'a Results,
        scene: &'a str,
        (base, methods): (&str, &[(&'static str, &'static str)]),
    ) -> Result<Option<SceneErrors<'a>>> {
        let Some(first) = results.of(scene, base).into_iter().next() else {
            return Ok(None);
        };
        let ground = Ground::of(first)?;
        let mut measured = Vec::new();
        for (variant, label) in methods {
            let runs = results.of(scene, variant);
            let errors = runs.iter().map(|run| ground.errors(run));
            let errors = errors.collect::<Result<Vec<_>>>()?;
            if !runs.is_empty() {
                measured.push(MethodErrors {
                    variant,
                    label,
                    runs,
                    errors,
                });
            }
        }
        Ok(Some(SceneErrors {
            scene,
            ground,
            methods: measured,
        }))
    }

    /// Returns a method by its variant.
    pub(super) fn method(&self, variant: &str) -> Option<&MethodErrors<'a>> {
        self.methods.iter().find(|m| m.variant == variant)
    }

    /// Returns mean and deviation over the seeds of what two methods' errors say of each other, pairs of
    /// the same seed; `None` where one is missing.
    pub(super) fn figure_of_two(
        &self,
        (a, b): (&str, &str),
        of: impl Fn(&[ViewErrors], &[ViewErrors]) -> Option<f64>,
    ) -> Option<Figure> {
        let (a, b) = (self.method(a)?, self.method(b)?);
        Figure::of(a.errors.iter().zip(&b.errors).map(|(a, b)| of(a, b)))
    }
}
