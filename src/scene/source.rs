//! This module parses what `--scene` and `--cloud` take.

use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::builtin::{CLOUD_VIEWS, WIDTHS};
use super::formats::FOLDERS;
use crate::error::{Error, Result, did_you_mean};

/// Image width of the built-in scene where none is given, pixels.
pub const DEFAULT_BUILTIN_WIDTH: u32 = 320;

/// The source of a scene: a folder, `builtin[:WIDTH]` or `builtin:object[:WIDTH]`. A folder of that
/// name is `./builtin`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneSource {
    /// A scene on disk: one folder in a format that is read.
    Folder(PathBuf),
    /// The built-in scene with images `width` pixels wide.
    Builtin {
        /// Image width, pixels; the height is two thirds of it.
        width: u32,
    },
    /// The built-in object, which turns on the spot before a white ground, with its masks.
    Object {
        /// Image width, pixels; the height is two thirds of it.
        width: u32,
    },
}

impl SceneSource {
    /// Returns the source with its folder made absolute; a folder that is not there is an error.
    pub fn resolved(self) -> Result<SceneSource> {
        match self {
            SceneSource::Folder(folder) => match folder.canonicalize() {
                Ok(absolute) if absolute.is_dir() => Ok(SceneSource::Folder(absolute)),
                Ok(_) => Err(Error::new("is not a folder").at_path(&folder)),
                Err(e) => Err(Error::new(format!("cannot open the scene: {e}")).at_path(&folder)),
            }
            .map_err(|e| {
                let otherwise =
                    "name a folder with images/ and sparse/0/, or take `--scene builtin`";
                e.way_out(near_folder(&folder).unwrap_or_else(|| otherwise.to_owned()))
            }),
            builtin => Ok(builtin),
        }
    }

    /// Returns the source with the built-in scene's images no wider than `px`; a folder's are
    /// scaled when they are loaded.
    pub fn at_most(self, px: u32) -> SceneSource {
        match self {
            SceneSource::Builtin { width } => SceneSource::Builtin {
                width: width.min(px.max(*WIDTHS.start())),
            },
            SceneSource::Object { width } => SceneSource::Object {
                width: width.min(px.max(*WIDTHS.start())),
            },
            folder => folder,
        }
    }

    /// Returns the short name for tables and folders.
    pub fn name(&self) -> String {
        match self {
            SceneSource::Folder(folder) => match folder.file_name() {
                Some(name) => name.to_string_lossy().into_owned(),
                None => "scene".to_owned(),
            },
            SceneSource::Builtin { .. } => "builtin".to_owned(),
            SceneSource::Object { .. } => "builtin-object".to_owned(),
        }
    }
}

impl FromStr for SceneSource {
    type Err = Error;

    fn from_str(text: &str) -> Result<SceneSource> {
        if text.is_empty() {
            return Err(Error::usage("no folder is named"));
        }
        if text == "builtin" {
            return Ok(SceneSource::Builtin {
                width: DEFAULT_BUILTIN_WIDTH,
            });
        }
        let Some(which) = text.strip_prefix("builtin:") else {
            return Ok(SceneSource::Folder(PathBuf::from(text)));
        };
        if which == "object" {
            return Ok(SceneSource::Object {
                width: DEFAULT_BUILTIN_WIDTH,
            });
        }
        let object = which.strip_prefix("object:");
        let width = object.unwrap_or(which);
        match (width.parse(), object) {
            (Ok(width @ 16..=8192), None) => Ok(SceneSource::Builtin { width }),
            (Ok(width @ 16..=8192), Some(_)) => Ok(SceneSource::Object { width }),
            _ => Err(Error::usage(format!(
                "the built-in scene's width is 16 to 8192 pixels, not `{width}`"
            ))
            .way_out("write for example builtin:640, or builtin:object for the other one")),
        }
    }
}

impl fmt::Display for SceneSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SceneSource::Folder(folder) => write!(f, "{}", folder.display()),
            SceneSource::Builtin { width } => write!(f, "builtin:{width}"),
            SceneSource::Object { width } => write!(f, "builtin:object:{width}"),
        }
    }
}

/// The source of a cloud other than the scene's own. A file named `random` is `./random`, and
/// so is one named `exact`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CloudSource {
    /// A file that [`super::read_cloud`] reads.
    File(PathBuf),
    /// What the first so many views give: of a folder's cloud the points that came from them, if
    /// they say so; of the built-in scene a cloud made from so many views, its training views and,
    /// beyond them, views midway between.
    Views(usize),
    /// Random points and colours, as many as the scene's own cloud has
    /// ([`super::random_like`]).
    Random,
    /// The built-in scene's cloud without its errors: every pixel of the training views at its true
    /// place. Folders have none.
    Exact,
}

impl CloudSource {
    /// Returns the source with its file made absolute: one in the scene's folder or beside its
    /// model, else a path.
    ///
    /// # Errors
    /// No such file; a cloud that this scene cannot have.
    pub fn resolved(self, scene: &SceneSource) -> Result<CloudSource> {
        match (self, scene) {
            (CloudSource::File(path), _) => {
                let folders: Vec<PathBuf> = match scene {
                    SceneSource::Folder(dir) => {
                        let models = FOLDERS.map(|model| dir.join(model));
                        [vec![dir.clone()], models.to_vec()].concat()
                    }
                    SceneSource::Builtin { .. } | SceneSource::Object { .. } => Vec::new(),
                };
                let candidates = folders.iter().map(|folder| folder.join(&path));
                candidates
                    .chain(std::iter::once(path.clone()))
                    .find(|candidate| candidate.is_file())
                    .and_then(|found| found.canonicalize().ok())
                    .map(CloudSource::File)
                    .ok_or_else(|| no_such_cloud(&path, scene))
            }
            (other, _) => Ok(other),
        }
    }
}

fn no_such_cloud(path: &Path, scene: &SceneSource) -> Error {
    Error::new("no such cloud file")
        .at_path(path)
        .way_out(format!(
            "name a file in {scene}, in its model's folder, or by its path"
        ))
}

impl FromStr for CloudSource {
    type Err = Error;

    fn from_str(text: &str) -> Result<CloudSource> {
        if text.is_empty() {
            return Err(Error::usage("no cloud is named"));
        }
        if text == "random" {
            return Ok(CloudSource::Random);
        }
        if text == "exact" {
            return Ok(CloudSource::Exact);
        }
        let Some(n) = text.strip_prefix("views:") else {
            return Ok(CloudSource::File(PathBuf::from(text)));
        };
        match n.parse() {
            Ok(n) if CLOUD_VIEWS.contains(&n) => Ok(CloudSource::Views(n)),
            _ => Err(Error::usage(format!(
                "a cloud is made of {} to {} views, not `{n}`",
                CLOUD_VIEWS.start(),
                CLOUD_VIEWS.end()
            ))),
        }
    }
}

impl fmt::Display for CloudSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CloudSource::File(path) => write!(f, "{}", path.display()),
            CloudSource::Views(n) => write!(f, "views:{n}"),
            CloudSource::Random => f.write_str("random"),
            CloudSource::Exact => f.write_str("exact"),
        }
    }
}

/// Finds the folder beside `dir` that may have been meant.
fn near_folder(dir: &Path) -> Option<String> {
    let name = dir.file_name()?.to_str()?;
    let parent = dir.parent().filter(|parent| *parent != Path::new(""));
    let entries = std::fs::read_dir(parent.unwrap_or(Path::new("."))).ok()?;
    let folders = entries.flatten().filter(|entry| entry.path().is_dir());
    let names = folders.filter_map(|entry| entry.file_name().into_string().ok());
    let names: BTreeSet<String> = names.collect();
    did_you_mean(name, names.iter().map(String::as_str))
}
