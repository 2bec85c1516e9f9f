//! The one error type: what went wrong, where, and the way out.

use std::fmt;
use std::path::Path;

/// Result of everything fallible in this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Decides the process's exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// The command line or the config asks for something that does not exist: exit code 2.
    Usage,
    /// Anything else: exit code 1.
    Failure,
}

/// A one-line error: `place: what; way out`.
#[derive(Clone, Debug)]
pub struct Error {
    kind: ErrorKind,
    place: Option<String>,
    what: String,
    way_out: Option<String>,
}

impl Error {
    /// A failure (exit code 1) described by `what`.
    pub fn new(what: impl Into<String>) -> Self {
        Self {
            kind: ErrorKind::Failure,
            place: None,
            what: what.into(),
            way_out: None,
        }
    }

    /// A usage error (exit code 2) described by `what`.
    pub fn usage(what: impl Into<String>) -> Self {
        Self {
            kind: ErrorKind::Usage,
            ..Self::new(what)
        }
    }

    /// Names where it happened (a file with line or byte, a view). An outer place is put in front.
    pub fn at(mut self, place: impl fmt::Display) -> Self {
        self.place = Some(match self.place {
            Some(inner) => format!("{place}: {inner}"),
            None => place.to_string(),
        });
        self
    }

    /// [`Error::at`] for a path.
    pub fn at_path(self, path: &Path) -> Self {
        self.at(path.display())
    }

    /// Names what the user can do about it.
    pub fn way_out(mut self, way_out: impl Into<String>) -> Self {
        self.way_out = Some(way_out.into());
        self
    }

    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// The process's exit code for this error.
    pub fn exit_code(&self) -> u8 {
        match self.kind {
            ErrorKind::Usage => 2,
            ErrorKind::Failure => 1,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        f.write_str(&self.what)?;
        if let Some(way_out) = &self.way_out {
            write!(f, "; {way_out}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {}

/// Reads a whole file; the error names it.
pub fn read_file(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|e| Error::new(format!("cannot read: {e}")).at_path(path))
}

/// Writes a whole file through a temporary neighbour and a rename, so that a half-written
/// file never stands under the final name; the error names it.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let part = Path::new(&part);
    std::fs::write(part, bytes)
        .and_then(|()| std::fs::rename(part, path))
        .map_err(|e| Error::new(format!("cannot write: {e}")).at_path(path))
}

/// Creates a directory with its parents; the error names it.
pub fn create_dir(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path)
        .map_err(|e| Error::new(format!("cannot create the directory: {e}")).at_path(path))
}
