//! A checkpoint file holds one state of the training; a run keeps the newest two.
//!
//! ```text
//! "gspckpt\0"   8 bytes
//! format        u32, FORMAT
//! header size   u64, bytes
//! header        JSON
//! payload       the rest but the last 4 bytes
//! checksum      u32, CRC-32 (IEEE) of all before it
//! ```
//!
//! Numbers are little-endian. A file is written beside its final name, synced and renamed, so that
//! what ends the process leaves the ones before it whole; the checksum tells what a disk has
//! garbled since.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::remove;
use crate::error::{Error, Result};
use crate::files::{PART, read_file, write_parts};

const MAGIC: &[u8; 8] = b"gspckpt\0";
/// Rises when a file's layout or what the payload holds changes.
const FORMAT: u32 = 1;
/// Up to the header.
const FRONT: usize = 20;
const CHECKSUM: usize = 4;
const EXTENSION: &str = "ckpt";
/// The newest may turn out to be damaged.
const KEPT: usize = 2;

/// The checkpoints of one run.
#[derive(Clone, Debug)]
pub struct Checkpoints {
    folder: PathBuf,
}

/// A checkpoint that was read.
pub struct Found<H> {
    /// The file that it was read from.
    pub path: PathBuf,
    /// The JSON part.
    pub header: H,
    /// The bytes after the header, without the checksum.
    pub payload: Vec<u8>,
    /// Why newer ones could not be read.
    pub warnings: Vec<String>,
}

impl Checkpoints {
    /// Names the checkpoints in `folder`, which must exist when one is saved: who removes a run's
    /// folder does not want it back.
    pub fn new(folder: PathBuf) -> Checkpoints {
        Checkpoints { folder }
    }

    /// Returns the folder that the files lie in; it may not exist yet.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes the checkpoint after `done` iterations and then removes all but the newest two up to
    /// it: later ones have been fallen back from.
    ///
    /// # Errors
    /// One of `payload`, or a file that cannot be written; the earlier checkpoints are as before.
    pub fn save(
        &self,
        done: u32,
        header: &impl Serialize,
        payload: impl Iterator<Item = Result<Vec<u8>>>,
    ) -> Result<()> {
        // Ten digits hold any number of iterations: the order of names is theirs.
        let path = self.folder.join(format!("{done:010}.{EXTENSION}"));
        let header = serde_json::to_vec(header).map_err(|e| Error::new(e.to_string()))?;
        let front = [
            MAGIC.as_slice(),
            &FORMAT.to_le_bytes(),
            &(header.len() as u64).to_le_bytes(),
        ]
        .concat();
        let mut sum = crc32fast::Hasher::new();
        let mut body = [Ok(front), Ok(header)].into_iter().chain(payload);
        let mut ended = false;
        let parts = std::iter::from_fn(|| match body.next() {
            Some(part) => Some(part.inspect(|bytes| sum.update(bytes))),
            None if ended => None,
            None => {
                ended = true;
                Some(Ok(sum.clone().finalize().to_le_bytes().to_vec()))
            }
        });
        write_parts(&path, parts)?;
        let (mut kept, later): (Vec<_>, Vec<_>) =
            self.files()?.into_iter().partition(|file| *file <= path);
        kept.truncate(kept.len().saturating_sub(KEPT));
        for old in kept.iter().chain(&later) {
            remove(old, |file| fs::remove_file(file))?;
        }
        Ok(())
    }

    /// Reads the newest checkpoint that is whole; `None` where there is none at all.
    ///
    /// # Errors
    /// There are some, and none can be read.
    pub fn newest<H: DeserializeOwned>(&self) -> Result<Option<Found<H>>> {
        let mut damaged: Vec<Error> = Vec::new();
        for path in self.files()?.into_iter().rev() {
            match read::<H>(&path) {
                Ok((header, payload)) => {
                    return Ok(Some(Found {
                        warnings: damaged.iter().map(Error::to_string).collect(),
                        path,
                        header,
                        payload,
                    }));
                }
                Err(e) => damaged.push(e.at_path(&path)),
            }
        }
        match damaged.into_iter().next() {
            None => Ok(None),
            Some(e) => Err(e.way_out("no other checkpoint can be read; train the run again")),
        }
    }

    /// Removes what an interrupted write has left.
    pub fn tidy(&self) -> Result<()> {
        for file in self.files_named(|name| name.ends_with(PART))? {
            remove(&file, |file| fs::remove_file(file))?;
        }
        Ok(())
    }

    /// Removes them all, with their folder.
    pub fn clear(&self) -> Result<()> {
        remove(&self.folder, |folder| fs::remove_dir_all(folder))
    }

    /// Lists the files from the oldest on.
    fn files(&self) -> Result<Vec<PathBuf>> {
        let is_ours = |name: &str| {
            let stem = name
                .strip_suffix(EXTENSION)
                .and_then(|s| s.strip_suffix('.'));
            stem.is_some_and(|s| s.len() == 10 && s.bytes().all(|b| b.is_ascii_digit()))
        };
        self.files_named(is_ours)
    }

    fn files_named(&self, is_ours: impl Fn(&str) -> bool) -> Result<Vec<PathBuf>> {
        let cannot = |e: std::io::Error| {
            Error::new(format!("cannot list the checkpoints: {e}")).at_path(&self.folder)
        };
        let entries = match fs::read_dir(&self.folder) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(cannot)?,
        };
        let mut files = Vec::new();
        for entry in entries {
            let entry = entry.map_err(cannot)?;
            if entry.file_name().to_str().is_some_and(&is_ours) {
                files.push(entry.path());
            }
        }
        files.sort();
        Ok(files)
    }
}

fn read<H: DeserializeOwned>(path: &Path) -> Result<(H, Vec<u8>)> {
    let mut bytes = read_file(path)?;
    let (header, payload) = verify(&bytes)?;
    let header = serde_json::from_slice(&bytes[header])
        .map_err(|e| Error::new(format!("not as this version writes it: {e}")))?;
    bytes.truncate(payload.end);
    Ok((header, bytes.split_off(payload.start)))
}

type Span = std::ops::Range<usize>;

/// Checks a whole checkpoint; returns the places of header and payload.
fn verify(bytes: &[u8]) -> Result<(Span, Span)> {
    let damaged = |what: &str| Error::new(format!("damaged: {what}"));
    if bytes.len() < FRONT + CHECKSUM || !bytes.starts_with(MAGIC) {
        return Err(damaged("not the beginning of a checkpoint"));
    }
    let mut format = [0; 4];
    format.copy_from_slice(&bytes[8..12]);
    let format = u32::from_le_bytes(format);
    if format != FORMAT {
        return Err(Error::new(format!(
            "a checkpoint of format {format}; this version reads format {FORMAT}"
        )));
    }
    let end = bytes.len() - CHECKSUM;
    if crc32fast::hash(&bytes[..end]).to_le_bytes() != bytes[end..] {
        return Err(damaged("its checksum is not that of its bytes"));
    }
    let mut header = [0; 8];
    header.copy_from_slice(&bytes[12..FRONT]);
    let header = usize::try_from(u64::from_le_bytes(header))
        .ok()
        .and_then(|size| FRONT.checked_add(size))
        .filter(|header_end| *header_end <= end)
        .ok_or_else(|| damaged("its header is longer than the file"))?;
    Ok((FRONT..header, header..end))
}
