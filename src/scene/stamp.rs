//! A stamp of a scene's files tells whether what was measured is still what is there.

use std::fs::Metadata;
use std::path::Path;
use std::time::UNIX_EPOCH;

use super::lookup::is_run;
use super::{CloudSource, SceneSource};
use crate::files::digest::sha256;

impl SceneSource {
    /// Names the state of the scene's files, and of the cloud's where it is not the scene's own:
    /// every file's path, size and time of change, in hex. `None` if they cannot be read, as on
    /// another machine. The built-in scene is stamped with its size; what else it is made of is
    /// the program's version.
    pub fn stamp(&self, cloud: Option<&CloudSource>) -> Option<String> {
        let mut listing = String::new();
        match self {
            SceneSource::Folder(folder) => list(folder, "", &mut listing).ok()?,
            SceneSource::Builtin { width } => listing += &format!("builtin {width}\n"),
            SceneSource::Object { width } => listing += &format!("object {width}\n"),
        }
        if let Some(CloudSource::File(path)) = cloud {
            listing += &line("cloud", &std::fs::metadata(path).ok()?);
        }
        Some(sha256(listing.as_bytes()))
    }
}

/// Appends a line for every file below `dir`, sorted; links to folders are not followed. Runs that
/// lie within are left out: no scene reads them, and they change at every evaluation.
fn list(dir: &Path, prefix: &str, listing: &mut String) -> std::io::Result<()> {
    let mut entries = std::fs::read_dir(dir)?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            if !is_run(&entry.path()) {
                list(&entry.path(), &format!("{name}/"), listing)?;
            }
        } else if let Ok(meta) = std::fs::metadata(entry.path()) {
            *listing += &line(&name, &meta);
        }
    }
    Ok(())
}

fn line(name: &str, meta: &Metadata) -> String {
    let changed = meta.modified().ok();
    let age = changed.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let nanoseconds = age.map_or(0, |age| age.as_nanos());
    format!("{name:?} {} {nanoseconds}\n", meta.len())
}
