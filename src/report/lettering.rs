//! This module writes plain text on pictures, in letters of five by nine pixels.

use crate::scene::Image;

/// The printable ASCII characters and one for all others, 16 beside one another in 6 rows; `#` is
/// ink, and a blank stands between two.
const LETTERS: &str = include_str!("lettering.txt");

const PER_ROW: u32 = 16;

/// Height of a letter, the descender included, pixels at scale 1.
pub(crate) const LINE_HEIGHT: u32 = 9;

/// From a letter to the next, pixels at scale 1.
const ADVANCE: u32 = 6;

/// Returns the width of a line, pixels.
pub(crate) fn text_width(text: &str, scale: u32) -> u32 {
    ADVANCE * scale * text.chars().count() as u32
}

/// Returns the line, with `..` for what does not fit into `width` pixels.
pub(crate) fn shortened(text: &str, width: u32, scale: u32) -> String {
    let room = (width / (ADVANCE * scale)) as usize;
    if text.chars().count() <= room {
        return text.to_owned();
    }
    let kept = text.chars().take(room.saturating_sub(2));
    kept.chain("..".chars()).take(room).collect()
}

/// Writes a line with its upper left corner at `(x, y)`; what lies beyond the page is left out.
pub(crate) fn write_text(
    page: &mut Image,
    text: &str,
    (x, y): (u32, u32),
    scale: u32,
    color: [u8; 3],
) {
    for (i, letter) in text.chars().enumerate() {
        let left = x + ADVANCE * scale * i as u32;
        for (column, row) in ink(letter) {
            let corner = (left + column * scale, y + row * scale);
            fill(page, corner, (scale, scale), color);
        }
    }
}

/// Fills a rectangle as far as it lies on the page.
pub(crate) fn fill(
    page: &mut Image,
    (left, top): (u32, u32),
    (width, height): (u32, u32),
    color: [u8; 3],
) {
    for y in top..(top + height).min(page.height) {
        for x in left..(left + width).min(page.width) {
            let at = 3 * (y as usize * page.width as usize + x as usize);
            page.rgb[at..at + 3].copy_from_slice(&color);
        }
    }
}

/// Returns the columns and rows of a letter's inked pixels.
fn ink(letter: char) -> impl Iterator<Item = (u32, u32)> {
    let code = match letter {
        ' '..='~' => letter as u32,
        _ => 0x7f,
    };
    let (row, column) = ((code - 0x20) / PER_ROW, (code - 0x20) % PER_ROW);
    let lines = LETTERS.lines().skip((row * LINE_HEIGHT) as usize);
    let lines = lines.take(LINE_HEIGHT as usize).zip(0..);
    lines.flat_map(move |(line, y)| {
        let pixels = line.bytes().skip((column * ADVANCE) as usize);
        let pixels = pixels.take(ADVANCE as usize).zip(0..);
        pixels.filter_map(move |(byte, x)| (byte == b'#').then_some((x, y)))
    })
}
