//! `cameras.txt` and `images.txt`: blank-separated fields, `#` begins a comment line.

use super::Model;
use crate::error::{Error, Result};

/// The lines of a text file with their numbers from 1; bytes that are no UTF-8 are refused.
pub fn lines(bytes: &[u8]) -> impl Iterator<Item = Result<(usize, &str)>> {
    bytes
        .split(|&b| b == b'\n')
        .zip(1..)
        .map(|(line, number)| match std::str::from_utf8(line) {
            Ok(line) => Ok((number, line.trim())),
            Err(_) => Err(at_line(Error::new("not UTF-8 text"), number)),
        })
}

pub fn at_line(error: Error, number: usize) -> Error {
    error.at(format_args!("line {number}"))
}

/// The next blank-separated field of `rest`, which it is cut from.
pub fn field<'a>(rest: &mut &'a str, what: &str) -> Result<&'a str> {
    let line = rest.trim_start();
    if line.is_empty() {
        return Err(Error::new(format!("the line ends before {what}")));
    }
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    let (field, tail) = line.split_at(end);
    *rest = tail;
    Ok(field)
}

/// [`field`] as a number.
pub fn number<T: std::str::FromStr>(rest: &mut &str, what: &str) -> Result<T> {
    let field = field(rest, what)?;
    field.parse().map_err(|_| {
        Error::new(format!(
            "{what} is not a valid number: `{}`",
            field.escape_debug()
        ))
    })
}

pub fn numbers<const N: usize>(rest: &mut &str, what: &str) -> Result<[f64; N]> {
    let mut values = [0.0; N];
    for value in &mut values {
        *value = number(rest, what)?;
    }
    Ok(values)
}

fn is_data(line: &str) -> bool {
    !line.is_empty() && !line.starts_with('#')
}

pub fn read_cameras(bytes: &[u8], model: &mut Model) -> Result<()> {
    for line in lines(bytes) {
        let (at, line) = line?;
        if is_data(line) {
            read_camera(line, model).map_err(|e| at_line(e, at))?;
        }
    }
    Ok(())
}

fn read_camera(mut line: &str, model: &mut Model) -> Result<()> {
    let id = number(&mut line, "the camera's id")?;
    let name = field(&mut line, "the camera's model")?;
    let size = [
        number(&mut line, "the camera's width")?,
        number(&mut line, "the camera's height")?,
    ];
    let mut params = Vec::new();
    while !line.trim_start().is_empty() {
        params.push(number(&mut line, "a camera parameter")?);
    }
    model.add_camera(id, name, size, &params)
}

/// Each image takes two lines; the second, its observations, is often empty and not used.
pub fn read_images(bytes: &[u8], model: &mut Model) -> Result<()> {
    let mut lines = lines(bytes);
    while let Some(line) = lines.next() {
        let (at, line) = line?;
        if !is_data(line) {
            continue;
        }
        read_image(line, model).map_err(|e| at_line(e, at))?;
        if let Some(line) = lines.next() {
            let (at, line) = line?;
            check_observations(line).map_err(|e| at_line(e, at))?;
        }
    }
    Ok(())
}

fn read_image(mut line: &str, model: &mut Model) -> Result<()> {
    let _id: i64 = number(&mut line, "the image's id")?;
    let rotation_wxyz = numbers(&mut line, "the image's rotation")?;
    let translation = numbers(&mut line, "the image's translation")?;
    let camera_id = number(&mut line, "the image's camera id")?;
    // The rest of the line: names may contain blanks.
    model.add_image(rotation_wxyz, translation, camera_id, line.trim())
}

/// Without this, a file that leaves the second lines out would lose every other image.
fn check_observations(line: &str) -> Result<()> {
    let n_fields = line.split_whitespace().count();
    let last_is_id = line
        .split_whitespace()
        .next_back()
        .is_none_or(|id| id.parse::<i64>().is_ok());
    if n_fields.is_multiple_of(3) && last_is_id {
        return Ok(());
    }
    Err(
        Error::new("expected the image's observations (X Y POINT3D_ID, or an empty line)")
            .way_out("write two lines an image, the second may be empty"),
    )
}
