//! This module packs files into zip archives as they are, and reads such archives.
//!
//! What is packed here is compressed already. The crates that read and write the format bring
//! encryption, time and a system's permissions along; without compression it is three records a file.
//! Lengths fit 32 bits, and names are ASCII.

use crate::error::{Error, Result};

const LOCAL: u32 = 0x0403_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const END: u32 = 0x0605_4b50;
/// Version of the format that readers need.
const NEEDED: u16 = 20;
/// Midnight of the first day that the format knows, 1 January 1980: the bytes do not depend on the time.
const DATE: [u16; 2] = [0, 0x21];

/// Bytes of the records without names.
const LOCAL_BYTES: usize = 30;
const CENTRAL_BYTES: usize = 46;
const END_BYTES: usize = 22;

/// An archive under way.
#[derive(Default)]
pub(crate) struct Zip {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    n: u16,
}

impl Zip {
    /// Adds a file.
    ///
    /// # Errors
    /// The archive would have 4 GiB or more.
    pub(crate) fn add(&mut self, name: &str, content: &[u8]) -> Result<()> {
        let too_large = |_| Error::new("an archive holds less than 4 GiB").at(name);
        let at = u32::try_from(self.bytes.len()).map_err(too_large)?;
        let length = u32::try_from(content.len()).map_err(too_large)?;
        let crc = crc32fast::hash(content);
        let described = |record: &mut Vec<u8>| {
            // Neither flags nor compression.
            for word in [NEEDED, 0, 0, DATE[0], DATE[1]] {
                record.extend(word.to_le_bytes());
            }
            for word in [crc, length, length] {
                record.extend(word.to_le_bytes());
            }
            record.extend((name.len() as u16).to_le_bytes());
            // No extra field.
            record.extend([0; 2]);
        };
        self.bytes.extend(LOCAL.to_le_bytes());
        described(&mut self.bytes);
        self.bytes.extend(name.as_bytes());
        self.bytes.extend(content);
        self.directory.extend(CENTRAL.to_le_bytes());
        self.directory.extend(NEEDED.to_le_bytes());
        described(&mut self.directory);
        // No comment, the first disk, no attributes.
        self.directory.extend([0; 10]);
        self.directory.extend(at.to_le_bytes());
        self.directory.extend(name.as_bytes());
        self.n += 1;
        Ok(())
    }

    /// Returns the archive.
    ///
    /// # Errors
    /// It would have 4 GiB or more.
    pub(crate) fn finish(mut self) -> Result<Vec<u8>> {
        let at = u32::try_from(self.bytes.len())
            .map_err(|_| Error::new("an archive holds less than 4 GiB"))?;
        self.bytes.extend(&self.directory);
        self.bytes.extend(END.to_le_bytes());
        for word in [0, 0, self.n, self.n] {
            self.bytes.extend(word.to_le_bytes());
        }
        self.bytes
            .extend((self.directory.len() as u32).to_le_bytes());
        self.bytes.extend(at.to_le_bytes());
        self.bytes.extend([0; 2]);
        Ok(self.bytes)
    }
}

/// Finds a file in an archive without a comment, whose files are stored as they are.
///
/// # Errors
/// No such archive, no such file in it, or one that is compressed or damaged.
pub(crate) fn unpacked<'a>(bytes: &'a [u8], name: &str) -> Result<&'a [u8]> {
    let damaged = || Error::new("not a whole zip archive").way_out("export or copy it again");
    let end = bytes.len().checked_sub(END_BYTES).ok_or_else(damaged)?;
    if word(bytes, end) != Some(END) {
        return Err(damaged());
    }
    let mut at = word(bytes, end + 16).ok_or_else(damaged)? as usize;
    while word(bytes, at) == Some(CENTRAL) {
        let record = bytes.get(at..at + CENTRAL_BYTES).ok_or_else(damaged)?;
        let short = |at: usize| usize::from(u16::from_le_bytes([record[at], record[at + 1]]));
        let long = |at: usize| word(record, at).unwrap_or(0);
        let own = at + CENTRAL_BYTES;
        let own = bytes.get(own..own + short(28)).ok_or_else(damaged)?;
        if own == name.as_bytes() {
            if short(10) != 0 {
                return Err(Error::new("is compressed, which is not read here").at(name));
            }
            let local = long(42) as usize;
            let header = bytes.get(local..local + LOCAL_BYTES).ok_or_else(damaged)?;
            let skipped = |at: usize| usize::from(u16::from_le_bytes([header[at], header[at + 1]]));
            let first = local + LOCAL_BYTES + skipped(26) + skipped(28);
            let content = bytes
                .get(first..first + long(24) as usize)
                .ok_or_else(damaged)?;
            if crc32fast::hash(content) != long(16) {
                return Err(Error::new("is damaged").at(name).way_out("copy it again"));
            }
            return Ok(content);
        }
        at += CENTRAL_BYTES + short(28) + short(30) + short(32);
    }
    Err(Error::new("is not in the archive").at(name))
}

/// Returns the word at a byte; `None` beyond the end.
fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    four.first_chunk().map(|four| u32::from_le_bytes(*four))
}
