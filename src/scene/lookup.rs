//! This module finds a scene's files by the names that poses, lists and people give them.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use unicode_normalization::UnicodeNormalization;

/// File extensions of photographs that are read, in small letters.
const READ: [&str; 7] = ["jpg", "jpeg", "jpe", "jfif", "png", "webp", "bmp"];

/// Those of photographs that are not: raw ones, some of which are TIFF files whose first image is a
/// thumbnail, and formats without a decoder here.
const UNREAD: [&str; 26] = [
    "tif", "tiff", "heic", "heif", "avif", "jxl", "jp2", "gif", "exr", "hdr", "tga", "pgm", "ppm",
    "pnm", "psd", "cr2", "cr3", "nef", "arw", "dng", "raf", "orf", "rw2", "pef", "srw", "insp",
];

/// More parts than this has no path that is looked up.
const MAX_PARTS: usize = 32;

/// How a name led to a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum How {
    /// It is the file's path.
    Path,
    /// But for case, the form of its Unicode, and separators.
    Spelling,
    /// But for the suffix, and perhaps the spelling.
    Stem,
    /// Its last parts alone.
    Tail,
}

/// The outcome of looking up a name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Lookup {
    /// The file's path within the folder, with `/` between.
    Found(String, How),
    /// A photograph of that name in a format that is not read.
    Unread(String),
    /// None, or several that fit alike.
    Missing,
}

/// A folder in which files are looked up; what it holds is listed once.
pub(super) struct Folder {
    root: PathBuf,
    listed: RefCell<BTreeMap<String, Rc<Listing>>>,
}

/// Names in a folder, sorted.
#[derive(Default)]
struct Listing {
    files: Vec<String>,
    folders: Vec<String>,
}

impl Folder {
    pub(crate) fn new(root: &Path) -> Folder {
        Folder {
            root: root.to_owned(),
            listed: RefCell::default(),
        }
    }

    /// Returns whether `name` itself is a file's path here, links followed, and not of a format
    /// that is not read.
    pub(crate) fn has(&self, name: &str) -> bool {
        !is_unread(name) && self.root.join(name).is_file()
    }

    /// Looks for the photograph `name`: by its path, then but for its spelling, then but for its
    /// suffix on either side, and then its last parts alone in the same way. Files that `is_free`
    /// says false of are passed over, except under their own path.
    pub(crate) fn find(&self, name: &str, is_free: impl Fn(&str) -> bool) -> Lookup {
        let is_plain = name.split('/').all(|part| !part.is_empty() && part != ".");
        if is_plain && self.has(name) {
            return Lookup::Found(name.to_owned(), How::Path);
        }
        let plain = name.replace('\\', "/");
        let parts: Vec<&str> = plain
            .split('/')
            .filter(|part| !part.is_empty() && *part != ".")
            .collect();
        if parts.len() > MAX_PARTS || parts.contains(&"..") {
            return Lookup::Missing;
        }
        let mut unread = None;
        for start in 0..parts.len() {
            match self.descend(&parts[start..], &is_free) {
                Lookup::Found(file, how) if start > 0 => {
                    return Lookup::Found(file, how.max(How::Tail));
                }
                Lookup::Missing => {}
                Lookup::Unread(file) => unread = unread.or(Some(file)),
                found => return found,
            }
        }
        unread.map_or(Lookup::Missing, Lookup::Unread)
    }

    fn descend(&self, parts: &[&str], is_free: &impl Fn(&str) -> bool) -> Lookup {
        let Some((file, folders)) = parts.split_last() else {
            return Lookup::Missing;
        };
        let mut place = String::new();
        let mut how = How::Path;
        for part in folders {
            let listing = self.list(&place);
            let exact = listing.folders.iter().find(|name| name == part);
            let alike = || only(&listing.folders, |name| folded(name) == folded(part));
            let Some(name) = exact.or_else(alike) else {
                return Lookup::Missing;
            };
            if name != part {
                how = How::Spelling;
            }
            place += &format!("{name}/");
        }
        let listing = self.list(&place);
        let path = |name: &String| format!("{place}{name}");
        let files = listing.files.iter().filter(|name| is_free(&path(name)));
        let free: Vec<String> = files.cloned().collect();
        let readable: Vec<String> = free.iter().filter(|n| !is_unread(n)).cloned().collect();
        let stems = stems_of_pose(file);
        let is_stem = |name: &str| is_read(name) && stems.contains(&stem(name));
        let loose: Vec<String> = stems.iter().map(|stem| folded(stem)).collect();
        let is_loose = |name: &str| loose.contains(&folded(stem(name)));
        let levels: [(Fits, How); 4] = [
            (&|name| name == *file, How::Path),
            (&|name| folded(name) == folded(file), How::Spelling),
            (&is_stem, How::Stem),
            (&|name| is_read(name) && is_loose(name), How::Stem),
        ];
        for (fits, level) in levels {
            let n = readable.iter().filter(|name| fits(name)).count();
            match (n, only(&readable, fits)) {
                (0, _) => {}
                (_, Some(name)) => return Lookup::Found(path(name), how.max(level)),
                _ => return Lookup::Missing,
            }
        }
        let other = free.iter().find(|name| is_unread(name) && is_loose(name));
        other.map_or(Lookup::Missing, |name| Lookup::Unread(path(name)))
    }

    /// Returns all photographs here and in the folders below, links to folders followed once each;
    /// those that are not read apart.
    pub(crate) fn photographs(&self) -> (Vec<String>, Vec<String>) {
        let mut found = (Vec::new(), Vec::new());
        let mut seen = Vec::new();
        let mut places = vec![String::new()];
        while let Some(place) = places.pop() {
            let Ok(full) = self.root.join(&place).canonicalize() else {
                continue;
            };
            if seen.contains(&full) {
                continue;
            }
            seen.push(full);
            self.photographs_in(&place, &mut found);
            let below = self.list(&place);
            places.extend(below.folders.iter().map(|name| format!("{place}{name}/")));
        }
        found
    }

    /// Lists those in the folder `place` alone, which is empty or ends in `/`.
    pub(crate) fn photographs_in(&self, place: &str, found: &mut (Vec<String>, Vec<String>)) {
        for name in &self.list(place).files {
            // macOS leaves a `._a.jpg` with a photograph's attributes on foreign disks.
            if name.starts_with("._") {
                continue;
            }
            if is_read(name) {
                found.0.push(format!("{place}{name}"));
            } else if is_unread(name) {
                found.1.push(format!("{place}{name}"));
            }
        }
    }

    fn list(&self, place: &str) -> Rc<Listing> {
        if let Some(listing) = self.listed.borrow().get(place) {
            return listing.clone();
        }
        let mut listing = Listing::default();
        let entries = std::fs::read_dir(self.root.join(place));
        for entry in entries.into_iter().flatten().flatten() {
            // Poses are UTF-8, so a file whose name is not can have none.
            let Ok(name) = entry.file_name().into_string() else {
                continue;
            };
            let path = entry.path();
            if path.is_dir() {
                // The pictures that a run keeps are no photographs.
                if !is_run(&path) {
                    listing.folders.push(name);
                }
            } else if path.is_file() {
                listing.files.push(name);
            }
        }
        listing.files.sort();
        listing.folders.sort();
        let listing = Rc::new(listing);
        let mut listed = self.listed.borrow_mut();
        listed.insert(place.to_owned(), listing.clone());
        listing
    }
}

/// Returns whether a folder is what training writes: a config, beside what marks a run that is
/// under way or done.
pub(super) fn is_run(dir: &Path) -> bool {
    let marks = [".lock", "metrics.json", "checkpoints"];
    dir.join("config.json").is_file() && marks.iter().any(|mark| dir.join(mark).exists())
}

/// A test whether a name fits.
type Fits<'a> = &'a dyn Fn(&str) -> bool;

fn only(names: &[String], fits: impl Fn(&str) -> bool) -> Option<&String> {
    let mut fitting = names.iter().filter(|name| fits(name));
    let first = fitting.next();
    first.filter(|_| fitting.next().is_none())
}

/// Returns a name as people take it for the same: composed, in small letters, with `/` between.
pub(super) fn folded(name: &str) -> String {
    let slashed = name.replace('\\', "/");
    slashed.nfc().flat_map(char::to_lowercase).nfc().collect()
}

/// Returns the name without its suffix.
pub(super) fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// Returns what a pose's photograph may be called before its suffix: the name may have none, and
/// hold periods all the same.
fn stems_of_pose(name: &str) -> Vec<&str> {
    if is_read(name) || is_unread(name) {
        vec![name, stem(name)]
    } else {
        vec![name]
    }
}

/// Returns whether the name's suffix is of a format of photographs that is read.
pub(super) fn is_read(name: &str) -> bool {
    has_suffix(name, &READ)
}

/// Returns whether the name's suffix is of a format of photographs that is not read.
pub(super) fn is_unread(name: &str) -> bool {
    has_suffix(name, &UNREAD)
}

fn has_suffix(name: &str, suffixes: &[&str]) -> bool {
    let suffix = name.rsplit_once('.').map(|(_, suffix)| suffix);
    suffix.is_some_and(|own| suffixes.iter().any(|known| own.eq_ignore_ascii_case(known)))
}
