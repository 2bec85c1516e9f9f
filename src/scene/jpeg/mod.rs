//! This module tells whether a JPEG is whole: decoders fill in what is missing, in grey or in the
//! last colour.

mod bits;
mod scans;

use crate::error::{Error, Result};
use scans::Scans;

const MARKER: u8 = 0xff;
const START_OF_SCAN: u8 = 0xda;
const END_OF_IMAGE: u8 = 0xd9;
const WAY_OUT: &str = "copy it again, or save it anew if it looks whole";

/// Refuses a JPEG that ends before its end marker, as a broken copy does. What is no JPEG passes.
///
/// # Errors
/// The byte at which the file ends.
pub(super) fn check_end(bytes: &[u8]) -> Result<()> {
    let Some(segments) = Segments::of(bytes) else {
        return Ok(());
    };
    if segments.last().is_some_and(|s| s.marker == END_OF_IMAGE) {
        return Ok(());
    }
    Err(Error::new(format!(
        "the JPEG is cut off: it ends at byte {}, before its end marker, and what is missing would be grey",
        bytes.len()
    ))
    .way_out(WAY_OUT))
}

/// Refuses a JPEG whose scans have fewer blocks than its size asks for, as one that was cut off and
/// closed has: its codes are counted, which takes a part of the time of decoding them. What is
/// damaged otherwise, or not read here (arithmetic coding), is left to the decoder. What is no JPEG
/// passes.
///
/// # Errors
/// The share of a scan that is there, or that no scan has some of the colours.
pub(super) fn check_scans(bytes: &[u8]) -> Result<()> {
    let missing = Segments::of(bytes).and_then(|segments| Scans::default().missing(segments));
    missing.map_or(Ok(()), |what| {
        Err(Error::new(format!(
            "the JPEG is cut off: {what}, and the rest would be grey"
        ))
        .way_out(WAY_OUT))
    })
}

/// A marker and what follows it.
struct Segment<'a> {
    marker: u8,
    /// By its length, which is not in it.
    body: &'a [u8],
    /// All up to the next segment: the codes of a scan, with their restart markers.
    data: &'a [u8],
}

/// A walk from segment to segment, by their lengths, so that what lies within one, as a thumbnail
/// does, counts for nothing. Ends with the end marker, or before the first segment that is cut.
struct Segments<'a>(&'a [u8]);

impl<'a> Segments<'a> {
    fn of(bytes: &'a [u8]) -> Option<Segments<'a>> {
        Some(Segments(bytes.strip_prefix(&[MARKER, 0xd8])?))
    }

    /// Finds the next segment's marker: the next 0xff that is followed by neither a stuffed 0
    /// nor a restart marker nor another 0xff, which pads.
    fn next_marker(bytes: &[u8]) -> Option<usize> {
        bytes
            .windows(2)
            .position(|pair| pair[0] == MARKER && !matches!(pair[1], 0 | 1 | 0xd0..=0xd8 | MARKER))
    }
}

impl<'a> Iterator for Segments<'a> {
    type Item = Segment<'a>;

    fn next(&mut self) -> Option<Segment<'a>> {
        let at = Segments::next_marker(self.0)?;
        let marker = self.0[at + 1];
        let rest = &self.0[at + 2..];
        if marker == END_OF_IMAGE {
            self.0 = &[];
            return Some(Segment {
                marker,
                body: &[],
                data: &[],
            });
        }
        let (length, body) = rest.split_first_chunk()?;
        let length = usize::from(u16::from_be_bytes(*length)).saturating_sub(2);
        let (body, rest) = body.split_at_checked(length)?;
        // A scan's data follows its header at once.
        if marker == START_OF_SCAN && rest.is_empty() {
            return None;
        }
        let data = &rest[..Segments::next_marker(rest).unwrap_or(rest.len())];
        self.0 = &rest[data.len()..];
        Some(Segment { marker, body, data })
    }
}
