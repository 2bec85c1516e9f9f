//! This module writes films as YUV4MPEG2: uncompressed, for encoders to read from a pipe.
//!
//! Planes of 8 bit in 4:2:0: colours as stored through the matrix of BT.709, in limited range (black
//! is 16, white 235), each 2x2 pixels' mean chroma at their middle. The header says size, rate,
//! `C420jpeg`, which is that place of the chroma, and the range; it has no word for the matrix, so
//! encoders are to be told.

use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};

use super::animation::FRAMES_PER_SECOND;
use crate::error::{Error, Result};
use crate::files::write_parts;
use crate::scene::Image;

/// A place to write a film to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FilmTarget {
    /// The standard output, which another program reads.
    Stdout,
    /// A file.
    File(PathBuf),
}

impl FilmTarget {
    /// Returns the target that a command line names: `-` is the standard output.
    pub fn new(path: &Path) -> FilmTarget {
        match path == Path::new("-") {
            true => FilmTarget::Stdout,
            false => FilmTarget::File(path.to_owned()),
        }
    }

    /// Refuses a terminal, which cannot show a film.
    pub fn check(&self) -> Result<()> {
        if *self == FilmTarget::Stdout && io::stdout().is_terminal() {
            return Err(Error::usage("the film would be written to the terminal")
                .way_out("pipe it into an encoder, as the examples of --help do, or name a file"));
        }
        Ok(())
    }
}

/// Returns the size of a film of images of this size: 4:2:0 has whole pairs of pixels, so an odd
/// column or row is left out.
pub fn film_size((width, height): (u32, u32)) -> (u32, u32) {
    (width & !1, height & !1)
}

/// Writes a film of `n_frames` images of one size, as `frame` makes them.
///
/// # Errors
/// What `frame` returns, an image of another size, one that is too small, or what keeps the film
/// from being written.
pub fn write_film(
    target: &FilmTarget,
    size: (u32, u32),
    n_frames: u32,
    mut frame: impl FnMut(u32) -> Result<Image>,
) -> Result<()> {
    let (width, height) = film_size(size);
    if width == 0 || height == 0 {
        return Err(Error::new(format!(
            "images of {}x{} pixels are too small for a film",
            size.0, size.1
        )));
    }
    let header = format!(
        "YUV4MPEG2 W{width} H{height} F{FRAMES_PER_SECOND}:1 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n"
    );
    let frames = (0..n_frames).map(|i| planes(&frame(i)?, size));
    let parts = std::iter::once(Ok(header.into_bytes())).chain(frames);
    match target {
        FilmTarget::File(path) => write_parts(path, parts),
        FilmTarget::Stdout => {
            let mut stdout = io::stdout().lock();
            for part in parts {
                stdout.write_all(&part?).map_err(cannot)?;
            }
            stdout.flush().map_err(cannot)
        }
    }
}

fn cannot(e: io::Error) -> Error {
    Error::new(format!("cannot write: {e}")).at("stdout")
}

/// Returns a frame with its header: luma, then both chromas.
fn planes(image: &Image, size: (u32, u32)) -> Result<Vec<u8>> {
    if (image.width, image.height) != size {
        return Err(Error::new(format!(
            "a frame is {}x{} pixels, and the first is {}x{}",
            image.width, image.height, size.0, size.1
        ))
        .way_out("choose views of one size with --views, or a path through them with --path N"));
    }
    let (width, height) = film_size(size);
    let (width, height) = (width as usize, height as usize);
    let stride = 3 * image.width as usize;
    let pixel = |x: usize, y: usize| -> [f64; 3] {
        let at = y * stride + 3 * x;
        [0, 1, 2].map(|c| f64::from(image.rgb[at + c]) / 255.0)
    };
    let mut bytes = Vec::with_capacity(6 + width * height * 3 / 2);
    bytes.extend(b"FRAME\n");
    for y in 0..height {
        bytes.extend((0..width).map(|x| (16.0 + 219.0 * luma(pixel(x, y))).round() as u8));
    }
    // Blue and red less luma, each from -0.5 to 0.5 of its greatest difference.
    for (channel, span) in [(2, 1.8556), (0, 1.5748)] {
        for y in (0..height).step_by(2) {
            bytes.extend((0..width).step_by(2).map(|x| {
                let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
                let differences = four.map(|(x, y)| {
                    let rgb = pixel(x, y);
                    (rgb[channel] - luma(rgb)) / span
                });
                (128.0 + 224.0 * differences.iter().sum::<f64>() / 4.0).round() as u8
            }));
        }
    }
    Ok(bytes)
}

/// Returns the luma of BT.709, from 0 to 1.
fn luma([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}
