//! A scene folder may have these formats. Each is told by its marker files, and its reader turns
//! the poses into ours; images and points are read alike for all.

mod colmap;
mod gaussianobject;
mod instantsplat;
mod transforms;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::LoadOptions;
use super::layout::Layout;
use crate::error::{Error, Result};

pub use colmap::other_clouds;
pub(super) use colmap::own_cloud;
pub(super) use colmap::{FOLDERS, read_points_binary, read_points_text};
pub(super) use instantsplat::confidence_of;

/// A format's marker in a scene folder.
struct Probe {
    /// Relative to the scene folder, for messages.
    name: String,
    path: PathBuf,
}

impl Probe {
    fn new(dir: &Path, name: &str) -> Probe {
        Probe {
            name: name.to_owned(),
            path: dir.join(name),
        }
    }
}

struct Format {
    /// Looks for the marker in a scene folder.
    find: fn(&Path, &LoadOptions) -> Result<Option<Probe>>,
    read: fn(&Path, &Probe, &LoadOptions) -> Result<Layout>,
}

/// In the order in which they are looked for.
const FORMATS: [Format; 5] = [
    Format {
        find: colmap::find,
        read: colmap::read,
    },
    Format {
        find: instantsplat::find,
        read: instantsplat::read,
    },
    Format {
        find: gaussianobject::find,
        read: gaussianobject::read,
    },
    Format {
        find: transforms::find,
        read: transforms::read,
    },
    Format {
        find: transforms::find_blender,
        read: transforms::read_blender,
    },
];

/// Reads the scene folder `dir` in the first format whose marker is there.
///
/// # Errors
///
/// No marker, or what the format's reader refuses.
pub(super) fn read(dir: &Path, options: &LoadOptions) -> Result<Layout> {
    let mut taken: Option<(&Format, Probe)> = None;
    let mut others = Vec::new();
    for format in &FORMATS {
        if taken.is_none() {
            taken = (format.find)(dir, options)?.map(|probe| (format, probe));
        } else if let Ok(Some(probe)) = (format.find)(dir, options) {
            others.push(format!("`{}`", probe.name));
        }
    }
    let Some((format, probe)) = taken else {
        return Err(Error::new("no scene in this folder")
            .at_path(dir)
            .way_out(format!(
                "put {}, or a scene of another format that src/scene/README.md lists",
                colmap::expected()
            )));
    };
    let mut layout = (format.read)(dir, &probe, options)?;
    if !others.is_empty() {
        layout.warnings.push(format!(
            "`{}` is taken; also here and not used: {}",
            probe.name,
            others.join(", ")
        ));
    }
    Ok(layout)
}

/// Finds the first of the files that is there, else the first but for the case of its name.
fn first_file(candidates: &[PathBuf]) -> Option<PathBuf> {
    let exact = candidates.iter().find(|path| path.is_file()).cloned();
    exact.or_else(|| candidates.iter().find_map(|path| in_other_case(path)))
}

/// Finds the only file beside `path` whose name differs from it in case alone.
fn in_other_case(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let entries = std::fs::read_dir(path.parent()?).ok()?.flatten();
    let mut alike = entries.filter(|entry| {
        let other = entry.file_name();
        let other = other.to_str().unwrap_or_default();
        other.eq_ignore_ascii_case(name) && entry.path().is_file()
    });
    let first = alike.next()?.path();
    alike.next().is_none().then_some(first)
}

/// Finds `{prefix}N{suffix}` in `dir` that satisfies `is_one`; if several do, the one with
/// N = `n_train`.
///
/// # Errors
///
/// Several, of which none is for `n_train` views.
fn find_numbered(
    dir: &Path,
    (prefix, suffix): (&str, &str),
    is_one: impl Fn(&Path) -> bool,
    n_train: usize,
) -> Result<Option<Probe>> {
    let failed = |e: std::io::Error| Error::new(format!("cannot list: {e}")).at_path(dir);
    let mut found: BTreeMap<usize, String> = BTreeMap::new();
    for entry in std::fs::read_dir(dir).map_err(failed)? {
        let Ok(name) = entry.map_err(failed)?.file_name().into_string() else {
            continue;
        };
        let digits = name
            .strip_prefix(prefix)
            .and_then(|rest| rest.strip_suffix(suffix));
        let number = digits.and_then(|digits| digits.parse().ok());
        if let Some(n) = number
            && name == format!("{prefix}{n}{suffix}")
            && is_one(&dir.join(&name))
        {
            found.insert(n, name);
        }
    }
    if let Some(name) = found.get(&n_train) {
        return Ok(Some(Probe::new(dir, name)));
    }
    if found.len() > 1 {
        let names: Vec<String> = found.values().map(|name| format!("`{name}`")).collect();
        return Err(Error::new(format!(
            "{} are here, and none of them is for {n_train} training views",
            names.join(", ")
        ))
        .at_path(dir)
        .way_out("choose with --set scene.n_train=N, or keep one of them"));
    }
    Ok(found.values().next().map(|name| Probe::new(dir, name)))
}
