//! This is a run as a comparison sees it.

use std::path::Path;

use crate::config::{Config, Difference};
use crate::error::{Error, Result};
use crate::run::{Evaluation, Measured, Metrics, RunDir};

/// A run with what it did and what it measured.
#[derive(Clone, Debug)]
pub struct ComparedRun {
    name: String,
    /// The preset and every value that differs from it, but for the seed, the iterations and
    /// what is loaded, and a cloud that is not the scene's own: `paper (loss.ssim_weight=0.3)`.
    pub method: String,
    /// `key=value` of every value that differs from the preset's.
    pub changes: Vec<String>,
    /// The resolved config of the run.
    pub config: Config,
    /// What its training did: `metrics.json`.
    pub metrics: Metrics,
    /// Its errors at the test views: `eval.json`.
    pub evaluation: Evaluation,
    measured: Measured,
}

impl ComparedRun {
    /// Reads a run whose evaluation is `evaluation`.
    ///
    /// # Errors
    /// A config or metrics that cannot be read; an evaluation that an older version wrote.
    pub fn new(run: &RunDir, evaluation: Evaluation) -> Result<ComparedRun> {
        let config = run.config()?;
        let Some(measured) = evaluation.measured.clone() else {
            return Err(Error::new("its eval.json does not say how it was measured")
                .at_path(run.root())
                .way_out("evaluate the run again with `gspotential eval`"));
        };
        let changes = config.changes()?;
        let is_length = |key: &str| key == "iterations" || key == "need.ends";
        let is_method = |key: &str| !is_length(key) && !key.starts_with("scene.");
        let of_method = changes.iter().filter(|change| is_method(&change.key));
        let mut of_method: Vec<String> = of_method.map(Difference::setting).collect();
        let metrics = run.metrics()?;
        if let Some(cloud) = &metrics.scene.cloud {
            let file = Path::new(cloud).file_name().unwrap_or_default();
            of_method.push(format!("cloud={}", file.to_string_lossy()));
        }
        let method = if of_method.is_empty() {
            config.preset.clone()
        } else {
            format!("{} ({})", config.preset, of_method.join(", "))
        };
        Ok(ComparedRun {
            name: run.name(),
            method,
            changes: changes.iter().map(Difference::setting).collect(),
            config,
            metrics,
            evaluation,
            measured,
        })
    }

    /// Returns the directory's own name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns how the test views were measured, which decides what compares.
    pub fn measured(&self) -> &Measured {
        &self.measured
    }

    /// Returns whether both were measured against the same images.
    pub(super) fn same_images(&self, other: &ComparedRun) -> bool {
        let (a, b) = (&self.metrics.scene, &other.metrics.scene);
        (&a.name, &a.source, &a.test_views) == (&b.name, &b.source, &b.test_views)
            && self.measured.image_px == other.measured.image_px
    }

    /// Returns whether both are the same method with the same settings, whatever the seed.
    pub(super) fn same_row(&self, other: &ComparedRun) -> bool {
        let key = |run: &ComparedRun| (run.iterations(), run.config.scene.max_points);
        self.method == other.method
            && self.metrics.scene.cloud == other.metrics.scene.cloud
            && key(self) == key(other)
            && self.metrics.scene.train_views == other.metrics.scene.train_views
    }

    /// Returns `garden (320x213, 20 test views)`.
    pub(super) fn scene_label(&self) -> String {
        let scene = &self.metrics.scene;
        let [width, height] = self.measured.image_px.unwrap_or_default();
        let n = scene.test_views.len();
        format!("{} ({width}x{height}, {n} test views)", scene.name)
    }

    /// Says in words how long it was to train.
    pub(super) fn iterations(&self) -> String {
        let n = self.config.iterations;
        match self.config.need.ends {
            true => format!("up to {n} iterations"),
            false => format!("{n} iterations"),
        }
    }

    /// Says in words how many points it started from.
    pub(super) fn points(&self) -> String {
        match self.config.scene.max_points {
            Some(n) => format!("at most {n} points"),
            None => match self.config.scene.pixels_a_point {
                1.0 => "at most as many points as training pixels".to_owned(),
                n => format!("at most a point for {n} training pixels"),
            },
        }
    }
}
