//! A stamp of a scene's files, to tell whether what was measured is still what is there.

use std::fmt::Write as _;
use std::path::Path;
use std::time::UNIX_EPOCH;

use super::SceneSource;
use crate::digest::sha256;

impl SceneSource {
    /// Names the state of the scene's files: every file's path, size and time of change, in hex.
    /// None where the folder cannot be read, as on another machine. The built-in scene is stamped
    /// with its size; what else it is made of is the program's version.
    pub fn stamp(&self) -> Option<String> {
        let mut listing = String::new();
        match self {
            SceneSource::Folder(folder) => list(folder, "", &mut listing).ok()?,
            SceneSource::Builtin { width } => {
                // Writing to a string does not fail.
                let _ = write!(listing, "builtin {width}");
            }
        }
        Some(sha256(listing.as_bytes()))
    }
}

/// Appends a line for every file below `dir`, sorted; links to folders are not followed.
fn list(dir: &Path, prefix: &str, listing: &mut String) -> std::io::Result<()> {
    let mut entries = std::fs::read_dir(dir)?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            list(&entry.path(), &format!("{name}/"), listing)?;
        } else if let Ok(meta) = std::fs::metadata(entry.path()) {
            let changed = meta.modified().ok();
            let age = changed.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
            let nanoseconds = age.map_or(0, |age| age.as_nanos());
            let _ = writeln!(listing, "{name:?} {} {nanoseconds}", meta.len());
        }
    }
    Ok(())
}
