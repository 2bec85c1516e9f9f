//! The one error type says what went wrong, where, and the way out.

use std::borrow::Cow;
use std::fmt;
use std::path::Path;

/// Result of everything fallible in this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Decides the process's exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// The command line or the config asks for something that does not exist: exit code 2.
    Usage,
    /// Ctrl-C or SIGTERM: exit code 130, as of a shell's interrupted command.
    Interrupted,
    /// The GPU is gone, and with it all that it held; worth another try. Exit code 1.
    DeviceLost,
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
    /// Returns a failure (exit code 1) described by `what`.
    pub fn new(what: impl Into<String>) -> Self {
        Self::of(ErrorKind::Failure, what)
    }

    /// Returns a usage error (exit code 2) described by `what`.
    pub fn usage(what: impl Into<String>) -> Self {
        Self::of(ErrorKind::Usage, what)
    }

    /// Returns an error of this kind described by `what`.
    pub fn of(kind: ErrorKind, what: impl Into<String>) -> Self {
        Self {
            kind,
            place: None,
            what: what.into(),
            way_out: None,
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

    /// Does what [`Error::at`] does, for a path.
    pub fn at_path(self, path: &Path) -> Self {
        self.at(path.display())
    }

    /// Names what the user can do about it.
    pub fn way_out(mut self, way_out: impl Into<String>) -> Self {
        self.way_out = Some(way_out.into());
        self
    }

    /// Does what [`Error::way_out`] does, if no way out is named yet.
    pub fn or_way_out(self, way_out: impl Into<String>) -> Self {
        match self.way_out {
            None => self.way_out(way_out),
            Some(_) => self,
        }
    }

    /// Returns the kind of the error, which decides the exit code.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// Returns the process's exit code for this error.
    pub fn exit_code(&self) -> u8 {
        match self.kind {
            ErrorKind::Usage => 2,
            ErrorKind::Interrupted => 130,
            ErrorKind::DeviceLost | ErrorKind::Failure => 1,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{}: ", one_line(place))?;
        }
        f.write_str(&one_line(&self.what))?;
        if let Some(way_out) = &self.way_out {
            write!(f, "; {}", one_line(way_out))?;
        }
        Ok(())
    }
}

/// Returns a text file's bytes without the byte-order mark that Windows' editors put before UTF-8.
pub fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// Names and messages of decoders quote files, which may hold line breaks and terminal codes:
/// each run of control characters becomes a space.
fn one_line(text: &str) -> Cow<'_, str> {
    if !text.contains(char::is_control) {
        return Cow::Borrowed(text);
    }
    let words = text.split(char::is_control).filter(|part| !part.is_empty());
    Cow::Owned(words.collect::<Vec<_>>().join(" "))
}

impl std::error::Error for Error {}

/// Returns a way out: the nearest of `known`, if it is near.
pub(crate) fn did_you_mean<'a>(
    wrong: &str,
    known: impl Iterator<Item = &'a str>,
) -> Option<String> {
    // The distance takes time in both lengths; nobody mistypes a whole page.
    known
        .filter(|k| wrong.len().max(k.len()) <= 256)
        .map(|k| (strsim::damerau_levenshtein(wrong, k), k))
        .min()
        .filter(|(distance, k)| *distance <= 1 + k.len() / 4)
        .map(|(_, k)| format!("did you mean `{k}`?"))
}
