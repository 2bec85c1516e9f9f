//! This module shows what a run did: image files, contact sheets, tables, plots and its page.

mod agreement;
mod animation;
mod comparison;
mod evaluation;
mod export;
mod grid;
mod lettering;
mod page;
pub mod plot;
mod sheet;
pub mod stats;
mod table;
mod y4m;

pub use agreement::agreement_table;
pub use animation::write_animation;
pub use comparison::{Block, ComparedRun, Comparison, Row, check_protocols};
pub use evaluation::{evaluation_table, view_table};
pub use export::{runs_csv, runs_json};
pub use grid::{GridRow, Window, method_grid, most_contested};
pub use page::{
    Course, LivePage, SceneRuns, live_asset, live_gaussians, live_photograph, write_comparison,
    write_run_page,
};
pub use sheet::{ContactSheet, mask_image};
pub use table::{Cell, Column, Table};
pub use y4m::{FilmTarget, film_size, write_film};

use std::io::Cursor;
use std::path::Path;

use image::codecs::openexr::OpenExrEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageFormat};

use crate::error::{Error, Result};
use crate::files::{read_file, write_file};
use crate::scene::Image;

/// Writes an 8-bit RGB PNG.
pub fn write_png(path: &Path, image: &Image) -> Result<()> {
    let mut bytes = Vec::new();
    check_len(path, image.width, image.height, image.rgb.len())?;
    PngEncoder::new(&mut bytes)
        .write_image(
            &image.rgb,
            image.width,
            image.height,
            ExtendedColorType::Rgb8,
        )
        .map_err(|e| Error::new(format!("cannot encode as PNG: {e}")).at_path(path))?;
    write_file(path, &bytes)
}

/// Writes shares in [0, 1] as a 16-bit grey PNG. `values`: `height * width`.
pub fn write_grey_png(path: &Path, width: u32, height: u32, values: &[f32]) -> Result<()> {
    check_len(path, width, height, 3 * values.len())?;
    let levels = values
        .iter()
        .map(|v| (65535.0 * v.clamp(0.0, 1.0)).round() as u16);
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(
            bytemuck::cast_slice(&levels.collect::<Vec<u16>>()),
            width,
            height,
            ExtendedColorType::L16,
        )
        .map_err(|e| Error::new(format!("cannot encode as PNG: {e}")).at_path(path))?;
    write_file(path, &bytes)
}

/// Reads a PNG as 8-bit RGB.
pub fn read_png(path: &Path) -> Result<Image> {
    let picture = image::load_from_memory_with_format(&read_file(path)?, ImageFormat::Png)
        .map_err(|e| Error::new(format!("cannot be read as PNG: {e}")).at_path(path))?
        .into_rgb8();
    Ok(Image {
        width: picture.width(),
        height: picture.height(),
        rgb: picture.into_raw(),
    })
}

/// Writes 32-bit float RGB as OpenEXR, unclamped. `rgb`: `height * width * 3` values.
pub fn write_exr(path: &Path, width: u32, height: u32, rgb: &[f32]) -> Result<()> {
    let mut bytes = Cursor::new(Vec::new());
    check_len(path, width, height, rgb.len())?;
    OpenExrEncoder::new(&mut bytes)
        .write_image(
            bytemuck::cast_slice(rgb),
            width,
            height,
            ExtendedColorType::Rgb32F,
        )
        .map_err(|e| Error::new(format!("cannot encode as EXR: {e}")).at_path(path))?;
    write_file(path, &bytes.into_inner())
}

/// Refuses a buffer of another size, on which the encoders panic.
fn check_len(path: &Path, width: u32, height: u32, n: usize) -> Result<()> {
    if u64::from(width) * u64::from(height) * 3 == n as u64 && n > 0 {
        return Ok(());
    }
    Err(Error::new(format!("a picture of {width}x{height} has {n} values")).at_path(path))
}
