//! This module writes animated PNGs; browsers show them as they show any PNG.

use std::path::Path;

use png::{BitDepth, ColorType, Encoder, EncodingError};

use crate::error::{Error, Result};
use crate::files::write_file;
use crate::scene::Image;

/// Shown for a 24th of a second each.
pub(super) const FRAMES_PER_SECOND: u16 = 24;

/// Writes `n_frames` frames of one size, as `frame` makes them, to be played for ever.
///
/// # Errors
/// What `frame` returns, frames of another size, or what keeps the file from being written.
pub fn write_animation(
    path: &Path,
    (width, height): (u32, u32),
    n_frames: u32,
    mut frame: impl FnMut(u32) -> Result<Image>,
) -> Result<()> {
    let failed = |e: EncodingError| Error::new(format!("cannot encode as PNG: {e}")).at_path(path);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_animated(n_frames, 0).map_err(failed)?;
    encoder
        .set_frame_delay(1, FRAMES_PER_SECOND)
        .map_err(failed)?;
    let mut writer = encoder.write_header().map_err(failed)?;
    for i in 0..n_frames {
        writer.write_image_data(&frame(i)?.rgb).map_err(failed)?;
    }
    writer.finish().map_err(failed)?;
    write_file(path, &bytes)
}
