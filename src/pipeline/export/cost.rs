//! This module measures what the formats of exported files cost.

use std::path::Path;

use crate::camera::{Camera, Frame, Similarity};
use crate::config::ModelConfig;
use crate::error::{Error, Result};
use crate::gaussians::ply::Stored;
use crate::gaussians::{Format, Gaussians};
use crate::gpu::Gpu;
use crate::metrics::{psnr, quantize};
use crate::render::{Kernels, Model, Renderer, ViewUniform};
use crate::report::{Cell, Column, Table};
use crate::scene::Image;

/// Places at which renders are compared.
pub(super) struct Renders<'a> {
    /// In the scene's own frame; one or more.
    pub views: &'a [Camera],
    pub frame: Frame,
    pub config: &'a ModelConfig,
}

/// Returns a table of the files: their sizes, and the mean PSNR of renders of what they hold against
/// those of `model`. They were made of `written`, which is `factor` times as large as the model.
///
/// # Errors
/// A file that cannot be read, or a GPU fault.
pub(super) fn costs(
    renders: &Renders<'_>,
    model: &Stored,
    files: &[(&Path, Format)],
    written: &Stored,
    factor: f64,
) -> Result<Table> {
    let gpu = Gpu::open()?;
    log::info!("adapter: {}", gpu.describe());
    let kernels = Kernels::new(&gpu);
    let mut renderer = Renderer::new(&gpu, &kernels);
    let mut of = |gaussians: Gaussians| -> Result<Vec<Image>> {
        let stored = Stored {
            gaussians,
            offset: model.offset,
        };
        let gaussians = stored.to_canonical(&renders.frame);
        let model = Model::upload(&gpu, &gaussians, gaussians.len())?;
        let near = renders.frame.near(renders.config.near);
        let render = |camera: &Camera| {
            let camera = renders.frame.camera_to_canonical(camera);
            let view = ViewUniform::new(&camera, near, renders.config.background);
            let image = renderer.render(&model, &view)?;
            quantize(image.width, image.height, &image.rgb)
        };
        renders.views.iter().map(render).collect()
    };
    let truth = of(model.gaussians.clone())?;
    let mut table = Table::new(
        "formats",
        &[
            Column::text("file", "file"),
            Column::number("mb", "MB", 2),
            Column::number("n_gaussians", "Gaussians", 0),
            Column::number("bytes_per_gaussian", "bytes each", 1),
            Column::number("psnr_db", "PSNR against the model, dB", 2),
        ],
    );
    let back = Similarity {
        scale: 1.0 / factor,
        ..Similarity::IDENTITY
    };
    for (path, format) in files {
        let bytes = std::fs::metadata(path)
            .map_err(|e| Error::new(format!("cannot be read: {e}")).at_path(path))?
            .len() as f64;
        let read = format.read_back(path, written)?;
        let n = read.as_ref().map(|read| read.len() as f64);
        let psnr = match read {
            None => None,
            Some(read) => Some(mean_psnr(&of(read.placed(&back))?, &truth)?),
        };
        table.row([
            Cell::from(path.display().to_string()),
            (bytes / 1e6).into(),
            n.into(),
            n.map(|n| bytes / n).into(),
            psnr.into(),
        ]);
    }
    Ok(table)
}

/// Returns the mean over views; infinite where every image is the same.
fn mean_psnr(renders: &[Image], truth: &[Image]) -> Result<f64> {
    let each = renders.iter().zip(truth).map(|(a, b)| psnr(a, b));
    let each = each.collect::<Result<Vec<f64>>>()?;
    Ok(each.iter().sum::<f64>() / each.len().max(1) as f64)
}
