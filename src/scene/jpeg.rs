//! Whether a JPEG is whole: decoders fill in what is missing, in grey.

use crate::error::{Error, Result};

const MARKER: u8 = 0xff;
const START_OF_SCAN: u8 = 0xda;
const END_OF_IMAGE: u8 = 0xd9;

/// Refuses a JPEG that ends before its end marker, as a broken copy does. Segments are skipped by
/// their lengths, so that the end of a thumbnail within counts for nothing, and so does what follows
/// the image. What is no JPEG passes.
///
/// # Errors
/// The byte at which the file ends.
pub(super) fn check_whole(bytes: &[u8]) -> Result<()> {
    if !bytes.starts_with(&[MARKER, 0xd8]) || ends(bytes) {
        return Ok(());
    }
    Err(Error::new(format!(
        "the JPEG is cut off: it ends at byte {}, before its end marker, and what is missing would be grey",
        bytes.len()
    ))
    .way_out("copy it again, or save it anew if it looks whole"))
}

/// Whether the end marker comes, in a walk from segment to segment.
fn ends(bytes: &[u8]) -> bool {
    let mut at = 2;
    loop {
        // Between segments, and within the data of a scan, a marker is the next 0xff that is followed
        // by neither a stuffed 0 nor a restart marker nor another 0xff, which pads.
        let next = bytes[at..]
            .windows(2)
            .position(|pair| pair[0] == MARKER && !matches!(pair[1], 0 | 1 | 0xd0..=0xd8 | MARKER));
        let Some(next) = next else {
            return false;
        };
        at += next + 2;
        match bytes[at - 1] {
            END_OF_IMAGE => return true,
            marker => {
                let Some(length) = bytes.get(at..at + 2) else {
                    return false;
                };
                let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
                at += length;
                // A scan's data follows its header at once.
                if at > bytes.len() || (marker == START_OF_SCAN && at == bytes.len()) {
                    return false;
                }
            }
        }
    }
}
