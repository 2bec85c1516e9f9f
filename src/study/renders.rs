//! This module sets side by side what the methods of a study render.

use super::runs::{Finished, Results};
use crate::error::Result;
use crate::report::{GridRow, method_grid, read_png};
use crate::run::file_names;
use crate::scene::Image;

/// Rows of a grid, or as many as there are scenes.
const N_ROWS: usize = 4;

/// A method whose renders are shown.
pub(crate) struct Method {
    pub label: String,
    /// Name of its variant.
    pub variant: String,
}

/// Renders of every method's first seed at test views spread evenly over each scene's.
///
/// # Errors
/// A scene that is no longer as it was trained on, or a render that cannot be read.
pub(crate) fn grid(results: &Results, methods: &[Method]) -> Result<Image> {
    let scenes = results.scenes();
    let per_scene = (N_ROWS / scenes.len().max(1)).max(1);
    let mut rows = Vec::new();
    for scene in scenes {
        let runs = methods
            .iter()
            .filter_map(|method| results.of(scene, &method.variant).into_iter().next());
        let runs: Vec<&Finished> = runs.collect();
        let Some(first) = runs.first() else { continue };
        let test = first.job.load_again()?.test;
        let names: Vec<&str> = test.iter().map(|view| view.camera.name.as_str()).collect();
        let files = file_names(&names, "png");
        let n_shown = per_scene.min(test.len());
        for i in (0..n_shown).map(|k| (2 * k + 1) * test.len() / (2 * n_shown)) {
            let render = |run: &&Finished| {
                let image = read_png(&run.run.test_views().join(&files[i]))?;
                let psnr = run.evaluation.views.get(i).and_then(|view| view.psnr);
                Ok((image, psnr.map_or(String::new(), |v| format!("{v:.2} dB"))))
            };
            rows.push(GridRow {
                label: format!("{scene}, {}", names[i]),
                truth: test[i].image.clone(),
                renders: runs.iter().map(render).collect::<Result<_>>()?,
            });
        }
    }
    let labels: Vec<String> = methods.iter().map(|m| m.label.clone()).collect();
    method_grid(&labels, &rows)
}
