//! This module reads files whole, and has a checked little-endian reader: a read that the file is
//! too short for names its byte.

use std::path::Path;

use crate::error::{Error, Result};
use crate::files::read_file;

/// Reads a whole file of a scene. Pipes and devices, which may have no end, are refused.
pub(crate) fn read_regular(path: &Path) -> Result<Vec<u8>> {
    if path.exists() && !path.is_file() {
        return Err(Error::new("not a regular file").at_path(path));
    }
    read_file(path)
}

pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// Returns the offset of the next unread byte.
    pub(crate) fn position(&self) -> usize {
        self.position
    }

    fn rest(&self) -> &'a [u8] {
        &self.bytes[self.position..]
    }

    fn take(&mut self, n: usize, what: &str) -> Result<&'a [u8]> {
        let Some((taken, _)) = self.rest().split_at_checked(n) else {
            return Err(self.truncated(what, n as u64));
        };
        self.position += n;
        Ok(taken)
    }

    fn truncated(&self, what: &str, needed: u64) -> Error {
        Error::new(format!(
            "truncated: {what} takes {needed} bytes, but the file ends at byte {}",
            self.bytes.len()
        ))
        .at(format_args!("byte {}", self.position))
        .way_out("export or copy the file again")
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    pub(crate) fn i32(&mut self, what: &str) -> Result<i32> {
        Ok(i32::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn u64(&mut self, what: &str) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn f64(&mut self, what: &str) -> Result<f64> {
        Ok(f64::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn rgb(&mut self, what: &str) -> Result<[u8; 3]> {
        self.array(what)
    }

    pub(crate) fn f64s<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64(what)?;
        }
        Ok(values)
    }

    /// Reads a `u64` count of `what` that take at least `item_bytes` each: a count that the rest of
    /// the file has no room for is refused before anything is allocated or looped over.
    pub(crate) fn count(&mut self, item_bytes: usize, what: &str) -> Result<usize> {
        let at = self.position;
        let count = self.u64(what)?;
        let room = self.rest().len() / item_bytes;
        match usize::try_from(count) {
            Ok(count) if count <= room => Ok(count),
            _ => Err(Error::new(format!(
                "truncated or damaged: {count} {what} declared, but the file ends at byte {} \
                 and has room for at most {room}",
                self.bytes.len()
            ))
            .at(format_args!("byte {at}"))
            .way_out("export or copy the file again")),
        }
    }

    /// Skips a `u64` count and that many items of exactly `item_bytes`.
    pub(crate) fn skip_list(&mut self, item_bytes: usize, what: &str) -> Result<()> {
        let count = self.count(item_bytes, what)?;
        // The count was held against the rest of the file, so the product is within it.
        self.take(count * item_bytes, what)?;
        Ok(())
    }

    /// Reads the bytes up to a NUL, which is consumed.
    pub(crate) fn nul_terminated(&mut self, what: &str) -> Result<&'a [u8]> {
        let rest = self.rest();
        let Some(length) = rest.iter().position(|&b| b == 0) else {
            return Err(self.truncated(what, rest.len() as u64 + 1));
        };
        self.position += length + 1;
        Ok(&rest[..length])
    }
}
