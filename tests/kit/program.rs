//! The program as a user starts it.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output};

/// Path of the program under test.
pub(crate) const PATH: &str = env!("CARGO_BIN_EXE_gspotential");

/// What a command line is given as: one text, split at blanks, or its arguments.
pub(crate) trait Args {
    fn give(&self, command: &mut Command);
}

impl Args for str {
    fn give(&self, command: &mut Command) {
        command.args(self.split_whitespace());
    }
}

impl Args for String {
    fn give(&self, command: &mut Command) {
        self.as_str().give(command);
    }
}

impl<S: AsRef<OsStr>> Args for [S] {
    fn give(&self, command: &mut Command) {
        command.args(self);
    }
}

impl<S: AsRef<OsStr>, const N: usize> Args for [S; N] {
    fn give(&self, command: &mut Command) {
        command.args(self);
    }
}

/// The program with these arguments, to be started in `folder`.
pub(crate) fn command(folder: &Path, args: &(impl Args + ?Sized)) -> Command {
    let mut command = Command::new(PATH);
    args.give(&mut command);
    command.current_dir(folder);
    command
}

/// Runs the program to its end.
pub(crate) fn run(folder: &Path, args: &(impl Args + ?Sized)) -> Ended {
    ended(&mut command(folder, args))
}

/// Runs the program, which must succeed.
#[track_caller]
pub(crate) fn succeed(folder: &Path, args: &(impl Args + ?Sized)) -> Ended {
    let ended = run(folder, args);
    assert_eq!(ended.code, Some(0), "{:?}: {}", ended.command, ended.log);
    ended
}

/// Runs a command to its end.
pub(crate) fn ended(command: &mut Command) -> Ended {
    let Output {
        status,
        stdout,
        stderr,
    } = command.output().expect("the program starts");
    let text = |bytes| String::from_utf8(bytes).expect("the program writes UTF-8");
    Ended {
        command: format!("{command:?}"),
        code: status.code(),
        stdout: text(stdout),
        log: text(stderr),
    }
}

/// A program that has ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub command: String,
    /// Exit code; None after a signal.
    pub code: Option<i32>,
    pub stdout: String,
    /// What it wrote to stderr.
    pub log: String,
}
