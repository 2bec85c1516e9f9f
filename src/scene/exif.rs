//! This module reads the focal length in a photograph's EXIF, a TIFF directory.

/// Tag of the directory of exposure data.
const EXIF_IFD: u16 = 0x8769;
/// Tag of the focal length on 35 mm film.
const FOCAL_35MM: u16 = 0xa405;

/// Returns the focal length on 35 mm film, mm; `None` if it is not there, 0 (unknown), or the data
/// are malformed.
pub(super) fn focal_35mm(exif: &[u8]) -> Option<f64> {
    let exif = exif.strip_prefix(b"Exif\0\0").unwrap_or(exif);
    let little = match exif.get(..4)? {
        b"II*\0" => true,
        b"MM\0*" => false,
        _ => return None,
    };
    let tiff = Tiff {
        bytes: exif,
        little,
    };
    let directory = tiff.value(tiff.u32(4)?, EXIF_IFD)?;
    let focal = tiff.value(directory, FOCAL_35MM)?;
    (focal > 0).then_some(f64::from(focal))
}

struct Tiff<'a> {
    bytes: &'a [u8],
    little: bool,
}

impl Tiff<'_> {
    fn u16(&self, at: usize) -> Option<u16> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.little {
            u16::from_le_bytes(bytes)
        } else {
            u16::from_be_bytes(bytes)
        })
    }

    fn u32(&self, at: usize) -> Option<u32> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.little {
            u32::from_le_bytes(bytes)
        } else {
            u32::from_be_bytes(bytes)
        })
    }

    /// Returns the short or long value of a tag in the directory at a byte.
    fn value(&self, directory: u32, tag: u16) -> Option<u32> {
        let begin = directory as usize;
        let n = self.u16(begin)?;
        let entries = (0..usize::from(n)).map(|i| begin + 2 + 12 * i);
        let entry = entries.into_iter().find(|at| self.u16(*at) == Some(tag))?;
        match self.u16(entry + 2)? {
            3 => self.u16(entry + 8).map(u32::from),
            4 => self.u32(entry + 8),
            _ => None,
        }
    }
}
