//! This module reads `cameras.txt` and `images.txt`: blank-separated fields, `#` begins a comment
//! line.

use super::{Model, StatedCamera, StatedPose};
use crate::error::{Error, Result, without_mark};

/// Returns the lines of a text file with their numbers from 1; bytes that are no UTF-8 are refused.
pub(crate) fn lines(bytes: &[u8]) -> impl Iterator<Item = Result<(usize, &str)>> {
    without_mark(bytes)
        .split(|&b| b == b'\n')
        .zip(1..)
        .map(|(line, number)| match std::str::from_utf8(line) {
            Ok(line) => Ok((number, line.trim())),
            Err(_) => Err(at_line(Error::new("not UTF-8 text"), number)),
        })
}

pub(crate) fn at_line(error: Error, number: usize) -> Error {
    error.at(format_args!("line {number}"))
}

/// Cuts the next blank-separated field off `rest` and returns it.
pub(crate) fn field<'a>(rest: &mut &'a str, what: &str) -> Result<&'a str> {
    let line = rest.trim_start();
    if line.is_empty() {
        return Err(Error::new(format!("the line ends before {what}")));
    }
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    let (field, tail) = line.split_at(end);
    *rest = tail;
    Ok(field)
}

/// Reads a [`field`] as a number.
pub(crate) fn number<T: std::str::FromStr>(rest: &mut &str, what: &str) -> Result<T> {
    let field = field(rest, what)?;
    field.parse().map_err(|_| {
        Error::new(format!(
            "{what} is not a valid number: `{}`",
            field.escape_debug()
        ))
    })
}

pub(crate) fn numbers<const N: usize>(rest: &mut &str, what: &str) -> Result<[f64; N]> {
    let mut values = [0.0; N];
    for value in &mut values {
        *value = real(rest, what)?;
    }
    Ok(values)
}

/// Reads a [`number`], or NaN where Microsoft's C library wrote what is none (`-nan(ind)`,
/// `1.#QNAN`).
pub(crate) fn real(rest: &mut &str, what: &str) -> Result<f64> {
    let mut ahead = *rest;
    let field = field(&mut ahead, what)?;
    let bare = field.trim_start_matches(['-', '+']);
    if bare.starts_with("nan(") || bare.starts_with("1.#") {
        *rest = ahead;
        return Ok(f64::NAN);
    }
    number(rest, what)
}

fn is_data(line: &str) -> bool {
    !line.is_empty() && !line.starts_with('#')
}

pub(crate) fn read_cameras(bytes: &[u8], model: &mut Model) -> Result<()> {
    for line in lines(bytes) {
        let (at, line) = line?;
        if is_data(line) {
            read_camera((at, line), model)?;
        }
    }
    Ok(())
}

fn read_camera((at, mut line): (usize, &str), model: &mut Model) -> Result<()> {
    let camera = camera_fields(&mut line).map_err(|e| at_line(e, at))?;
    model.add_camera(&format!("line {at}"), camera)
}

fn camera_fields<'a>(line: &mut &'a str) -> Result<StatedCamera<'a>> {
    let id = number(line, "the camera's id")?;
    let model = field(line, "the camera's model")?;
    let size = [
        number(line, "the camera's width")?,
        number(line, "the camera's height")?,
    ];
    let mut params = Vec::new();
    while !line.trim_start().is_empty() {
        params.push(real(line, "a camera parameter")?);
    }
    Ok(StatedCamera {
        id,
        model,
        size,
        params,
    })
}

/// Reads `images.txt`. Each image takes two lines; the second, its observations, is not used,
/// whatever it holds.
pub(crate) fn read_images(bytes: &[u8], model: &mut Model) -> Result<()> {
    let mut lines = lines(bytes);
    while let Some(line) = lines.next() {
        let (at, line) = line?;
        if !is_data(line) {
            continue;
        }
        read_image(line, model).map_err(|e| at_line(e, at))?;
        if let Some(line) = lines.next() {
            let (at, line) = line?;
            check_no_image(line).map_err(|e| at_line(e, at))?;
        }
    }
    Ok(())
}

fn read_image(mut line: &str, model: &mut Model) -> Result<()> {
    let pose = image_numbers(&mut line)?;
    // The rest of the line: names may contain blanks.
    model.add_image(pose, line.trim())
}

fn image_numbers(line: &mut &str) -> Result<StatedPose> {
    let _id: i64 = number(line, "the image's id")?;
    Ok(StatedPose {
        rotation_wxyz: numbers(line, "the image's rotation")?,
        translation: numbers(line, "the image's translation")?,
        camera_id: number(line, "the image's camera id")?,
    })
}

/// Refuses a second line that is an image. Without this, a file that leaves the second lines out
/// would lose every other image. An image's name is no number, or else its fields are no triples.
fn check_no_image(mut line: &str) -> Result<()> {
    let n_fields = line.split_whitespace().count();
    let is_image = n_fields >= 10 && {
        let numbers = image_numbers(&mut line).is_ok();
        let name = line.split_whitespace().next().unwrap_or_default();
        numbers && (name.parse::<f64>().is_err() || !n_fields.is_multiple_of(3))
    };
    if !is_image {
        return Ok(());
    }
    Err(Error::new(
        "an image where the observations of the one before are expected (X Y POINT3D_ID ..., or \
         an empty line)",
    )
    .way_out("write two lines an image, the second may be empty"))
}
