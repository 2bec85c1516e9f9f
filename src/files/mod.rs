//! This module reads files whole, writes them so that no half-written one stands under its name,
//! and has the parts of formats that more than one module reads or writes (`bytes`, `gltf`, `npy`,
//! `ply`, `zip`).

pub(crate) mod bytes;
pub mod digest;
pub(crate) mod gltf;
pub(crate) mod npy;
pub(crate) mod ply;
pub(crate) mod zip;

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::Path;

use crate::error::{Error, Result};

/// Reads a whole file; the error names it.
pub fn read_file(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(|e| Error::new(format!("cannot read: {e}")).at_path(path))
}

/// Reads the first `n` bytes of a file, or all of a shorter one; the error names it.
pub(crate) fn read_start(path: &Path, n: usize) -> Result<Vec<u8>> {
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(n as u64).read_to_end(&mut start))
        .map_err(|e| Error::new(format!("cannot read: {e}")).at_path(path))?;
    Ok(start)
}

/// Writes a whole file through a temporary neighbour and a rename, so that a half-written
/// file never stands under the final name; the error names it. Once this returns the file is on
/// the disk, not in a cache that a power cut empties.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    write_parts(path, [Ok(bytes)].into_iter())
}

/// Does what [`write_file`] does for a file that comes in parts; one that fails leaves no file.
pub fn write_parts<B: AsRef<[u8]>>(
    path: &Path,
    parts: impl Iterator<Item = Result<B>>,
) -> Result<()> {
    let mut neighbor = path.as_os_str().to_owned();
    neighbor.push(PART);
    let neighbor = Path::new(&neighbor);
    let cannot = |e: io::Error| Error::new(format!("cannot write: {e}")).at_path(path);
    let written = (|| {
        let mut file = File::create(neighbor).map_err(cannot)?;
        for part in parts {
            file.write_all(part?.as_ref()).map_err(cannot)?;
        }
        file.sync_all().map_err(cannot)?;
        fs::rename(neighbor, path)
            .and_then(|()| sync_folder(path))
            .map_err(cannot)
    })();
    if written.is_err() {
        // The room that it takes may be what is missing; where it cannot be removed, the error
        // at hand says more.
        let _ = fs::remove_file(neighbor);
    }
    written
}

/// What [`write_file`] appends to the name of the temporary neighbour.
pub const PART: &str = ".part";

/// Puts the new name of `path` on the disk; Windows has no way to, and does so itself.
fn sync_folder(path: &Path) -> io::Result<()> {
    if cfg!(windows) {
        return Ok(());
    }
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

/// Creates a directory with its parents; the error names it.
pub fn create_dir(path: &Path) -> Result<()> {
    fs::create_dir_all(path)
        .map_err(|e| Error::new(format!("cannot create the directory: {e}")).at_path(path))
}

/// Returns the peak resident set of this process in bytes; `None` if the system does not tell
/// (Linux does).
pub fn peak_host_bytes() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}
