//! What `--scene` takes.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use crate::error::{Error, Result};

/// Image width of the built-in scene where none is given, pixels.
pub const DEFAULT_BUILTIN_WIDTH: u32 = 320;

/// Where a scene comes from: a folder, or `builtin[:WIDTH]`. A folder of that name is
/// `./builtin`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneSource {
    Folder(PathBuf),
    /// The built-in scene with images `width` pixels wide.
    Builtin {
        width: u32,
    },
}

impl SceneSource {
    /// The source with its folder made absolute; a folder that is not there is an error.
    pub fn resolved(self) -> Result<SceneSource> {
        match self {
            SceneSource::Folder(folder) => match folder.canonicalize() {
                Ok(absolute) if absolute.is_dir() => Ok(SceneSource::Folder(absolute)),
                Ok(_) => Err(Error::new("is no folder").at_path(&folder)),
                Err(e) => Err(Error::new(format!("cannot open the scene: {e}")).at_path(&folder)),
            }
            .map_err(|e| {
                e.way_out("name a folder with images/ and sparse/0/, or take `--scene builtin`")
            }),
            builtin => Ok(builtin),
        }
    }

    /// The source with the built-in scene's images no wider than `px`; a folder's are scaled
    /// when they are loaded.
    pub fn at_most(self, px: u32) -> SceneSource {
        match self {
            SceneSource::Builtin { width } => SceneSource::Builtin {
                width: width.min(px),
            },
            folder => folder,
        }
    }

    /// Short name for tables and folders.
    pub fn name(&self) -> String {
        match self {
            SceneSource::Folder(folder) => match folder.file_name() {
                Some(name) => name.to_string_lossy().into_owned(),
                None => "scene".to_owned(),
            },
            SceneSource::Builtin { .. } => "builtin".to_owned(),
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
        let Some(width) = text.strip_prefix("builtin:") else {
            return Ok(SceneSource::Folder(PathBuf::from(text)));
        };
        match width.parse() {
            Ok(width @ 16..=8192) => Ok(SceneSource::Builtin { width }),
            _ => Err(Error::usage(format!(
                "the built-in scene's width is 16 to 8192 pixels, not `{width}`"
            ))
            .way_out("write for example builtin:640")),
        }
    }
}

impl fmt::Display for SceneSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SceneSource::Folder(folder) => write!(f, "{}", folder.display()),
            SceneSource::Builtin { width } => write!(f, "builtin:{width}"),
        }
    }
}
