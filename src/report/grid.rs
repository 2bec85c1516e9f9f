//! A grid shows renders of several methods side by side, with what they disagree on enlarged.

use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Rgb};

use super::lettering::{LINE_HEIGHT, fill, shortened, text_width, write_text};
use crate::error::{Error, Result};
use crate::scene::Image;

/// Longer side of a picture at most, pixels; smaller ones are enlarged by whole factors up to it.
const CELL_SIDE: u32 = 400;
/// The box's sides, one in so many of the picture's.
const BOX_SHARE: u32 = 4;
/// Pixels of the image for one of a letter.
const SCALE: u32 = 2;
const GAP: u32 = 8;
/// A line of text with its margins, pixels.
const STRIP: u32 = LINE_HEIGHT * SCALE + GAP;
/// Most pixels of a page's side.
const MAX_SIDE: u32 = 16_000;

const PAPER: [u8; 3] = [255; 3];
const INK: [u8; 3] = [0; 3];
/// Seen on dark and on bright pictures by its dark rim.
const BOX_COLOR: [u8; 3] = [240, 228, 66];
const BOX_LINE: u32 = 2;

/// A part of a picture or page, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Its left column, from 0.
    pub x: u32,
    /// Its upper row, from 0.
    pub y: u32,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

/// A view by every method.
#[derive(Clone, Debug)]
pub struct GridRow {
    /// The text above the row, which names the view.
    pub label: String,
    /// The photograph.
    pub truth: Image,
    /// Each of the photograph's size, with what is written beneath it.
    pub renders: Vec<(Image, String)>,
}

/// Finds the window of a quarter of the sides in which the renders' mean squared errors against the
/// photograph have the largest variance; the first of equals, row by row.
///
/// # Errors
/// Pictures of different sizes.
pub fn most_contested(truth: &Image, renders: &[&Image]) -> Result<Window> {
    let (width, height) = (truth.width as usize, truth.height as usize);
    let side = |length: u32| (length / BOX_SHARE).max(1);
    let (across, down) = (side(truth.width), side(truth.height));
    let stride = width + 1;
    // Sums over everything above and to the left.
    let mut sums: Vec<Vec<u64>> = Vec::with_capacity(renders.len());
    for render in renders {
        if (render.width, render.height) != (truth.width, truth.height)
            || render.rgb.len() != truth.rgb.len()
        {
            return Err(Error::new(format!(
                "a render is {}x{}, its photograph {width}x{height}",
                render.width, render.height
            )));
        }
        let mut sum = vec![0; stride * (height + 1)];
        for y in 0..height {
            let mut row = 0;
            for x in 0..width {
                let at = 3 * (y * width + x);
                row += (at..at + 3)
                    .map(|i| u64::from(render.rgb[i].abs_diff(truth.rgb[i])).pow(2))
                    .sum::<u64>();
                sum[(y + 1) * stride + x + 1] = sum[y * stride + x + 1] + row;
            }
        }
        sums.push(sum);
    }
    let mut best = (0, 0, 0);
    for y in 0..=height - down as usize {
        for x in 0..=width - across as usize {
            let (right, bottom) = (x + across as usize, y + down as usize);
            // In whole numbers, so that equals are equal: n sum e^2 - (sum e)^2.
            let (mut total, mut squares) = (0_u128, 0_u128);
            for sum in &sums {
                let error = sum[bottom * stride + right] + sum[y * stride + x]
                    - sum[y * stride + right]
                    - sum[bottom * stride + x];
                total += u128::from(error);
                squares += u128::from(error).pow(2);
            }
            let variance = sums.len() as u128 * squares - total * total;
            if variance > best.0 {
                best = (variance, x as u32, y as u32);
            }
        }
    }
    Ok(Window {
        x: best.1,
        y: best.2,
        width: across,
        height: down,
    })
}

/// Draws a grid with one column for the photographs and one for each of `methods`, one row a view:
/// the pictures with a box where the methods differ most, and what is in it enlarged beneath.
///
/// # Errors
/// No row, a row without a render for every method, renders that are not of their photograph's
/// size, or more than fits a page.
pub fn method_grid(methods: &[String], rows: &[GridRow]) -> Result<Image> {
    let cells = rows.iter().map(|row| cell_size(&row.truth));
    let cells = cells.collect::<Result<Vec<(u32, u32)>>>()?;
    let Some(column) = cells.iter().map(|(width, _)| width + GAP).max() else {
        return Err(Error::new("a grid of renders has no view to show"));
    };
    let n_columns = 1 + methods.len() as u32;
    let width = GAP + n_columns * column;
    let row_height = |(_, height): &(u32, u32)| 2 * STRIP + 2 * height + GAP;
    let height = GAP + STRIP + cells.iter().map(row_height).sum::<u32>();
    if width.max(height) > MAX_SIDE {
        return Err(Error::new(format!(
            "a grid of renders would be {width}x{height} pixels"
        )));
    }
    let mut page = Image {
        width,
        height,
        rgb: PAPER.repeat(width as usize * height as usize),
    };
    let left = |i: usize| GAP + i as u32 * column;
    let names = std::iter::once("photograph").chain(methods.iter().map(String::as_str));
    for (i, name) in names.enumerate() {
        centered(&mut page, name, (left(i), GAP), column - GAP);
    }
    let mut top = GAP + STRIP;
    for (row, cell) in rows.iter().zip(cells) {
        if row.renders.len() != methods.len() {
            return Err(Error::new(format!(
                "{} has {} renders for {} methods",
                row.label,
                row.renders.len(),
                methods.len()
            )));
        }
        let renders: Vec<&Image> = row.renders.iter().map(|(image, _)| image).collect();
        let window = most_contested(&row.truth, &renders).map_err(|e| e.at(&row.label))?;
        let label = shortened(&row.label, width - 2 * GAP, SCALE);
        write_text(&mut page, &label, (GAP, top), SCALE, INK);
        let pictures = std::iter::once((&row.truth, "")).chain(
            row.renders
                .iter()
                .map(|(image, text)| (image, text.as_str())),
        );
        for (i, (picture, text)) in pictures.enumerate() {
            let upper = Window {
                x: left(i),
                y: top + STRIP,
                width: cell.0,
                height: cell.1,
            };
            let lower = Window {
                y: upper.y + cell.1 + STRIP,
                ..upper
            };
            let whole = Window {
                x: 0,
                y: 0,
                width: picture.width,
                height: picture.height,
            };
            paste(&mut page, picture, whole, upper)?;
            paste(&mut page, picture, window, lower)?;
            let scaled = |at: u32, cell: u32, side: u32| {
                (u64::from(at) * u64::from(cell) / u64::from(side)) as u32
            };
            let boxed = Window {
                x: upper.x + scaled(window.x, cell.0, whole.width),
                y: upper.y + scaled(window.y, cell.1, whole.height),
                width: scaled(window.width, cell.0, whole.width),
                height: scaled(window.height, cell.1, whole.height),
            };
            frame(&mut page, boxed);
            frame(&mut page, lower);
            let beneath = (left(i), upper.y + cell.1 + GAP / 2);
            centered(&mut page, text, beneath, column - GAP);
        }
        top += row_height(&cell);
    }
    Ok(page)
}

/// Returns the width and height that a picture is shown at.
fn cell_size(picture: &Image) -> Result<(u32, u32)> {
    let longer = picture.width.max(picture.height);
    if picture.width.min(picture.height) == 0 {
        return Err(Error::new("a picture has no pixel"));
    }
    Ok(if longer <= CELL_SIDE {
        let factor = CELL_SIDE / longer;
        (picture.width * factor, picture.height * factor)
    } else {
        let side = |length: u32| {
            let scaled = u64::from(length) * u64::from(CELL_SIDE) / u64::from(longer);
            (scaled as u32).max(1)
        };
        (side(picture.width), side(picture.height))
    })
}

/// Scales a part of a picture to a place on the page: pixels stay sharp where it is enlarged.
fn paste(page: &mut Image, picture: &Image, part: Window, place: Window) -> Result<()> {
    let stride = 3 * picture.width as usize;
    let (from, to) = (3 * part.x as usize, 3 * (part.x + part.width) as usize);
    let rows = picture.rgb.chunks_exact(stride).skip(part.y as usize);
    let rows = rows.take(part.height as usize);
    let cut = rows.flat_map(|row| row[from..to].iter().copied()).collect();
    let Some(cut) = ImageBuffer::<Rgb<u8>, Vec<u8>>::from_raw(part.width, part.height, cut) else {
        return Err(Error::new("a picture lacks pixels"));
    };
    let filter = match place.width < part.width {
        true => FilterType::Triangle,
        false => FilterType::Nearest,
    };
    let scaled = resize(&cut, place.width, place.height, filter);
    for (y, row) in scaled.rows().enumerate() {
        let start = 3 * ((place.y as usize + y) * page.width as usize + place.x as usize);
        for (at, pixel) in (start..).step_by(3).zip(row) {
            page.rgb[at..at + 3].copy_from_slice(&pixel.0);
        }
    }
    Ok(())
}

/// Draws a box just inside a rectangle, its rim outside of the line and inside.
fn frame(page: &mut Image, place: Window) {
    let mut outline = |inset: u32, line: u32, color: [u8; 3]| {
        let size = (
            place.width.saturating_sub(2 * inset),
            place.height.saturating_sub(2 * inset),
        );
        let (left, top) = (place.x + inset, place.y + inset);
        let (across, down) = ((size.0, line.min(size.1)), (line.min(size.0), size.1));
        fill(page, (left, top), across, color);
        fill(page, (left, top + size.1 - across.1), across, color);
        fill(page, (left, top), down, color);
        fill(page, (left + size.0 - down.0, top), down, color);
    };
    outline(0, BOX_LINE + 2, INK);
    outline(1, BOX_LINE, BOX_COLOR);
}

fn centered(page: &mut Image, text: &str, (left, top): (u32, u32), width: u32) {
    let text = shortened(text, width, SCALE);
    let free = width.saturating_sub(text_width(&text, SCALE));
    write_text(page, &text, (left + free / 2, top), SCALE, INK);
}
