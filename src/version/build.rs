//! This build script names the commit that the program is built from, where that can be told.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=src/version/build.rs");
    let version = env!("CARGO_PKG_VERSION");
    match commit_of_package().or_else(commit_of_repository) {
        Some(commit) => {
            println!("cargo::rustc-env=GSPOTENTIAL_COMMIT={commit}");
            println!("cargo::rustc-env=GSPOTENTIAL_VERSION={version} ({commit})");
        }
        None => println!("cargo::rustc-env=GSPOTENTIAL_VERSION={version}"),
    }
}

/// Returns the commit that `cargo package` noted. It comes first: a package may lie unpacked within
/// another project's repository.
fn commit_of_package() -> Option<String> {
    let text = std::fs::read_to_string(".cargo_vcs_info.json").ok()?;
    let (_, rest) = text.split_once("\"sha1\"")?;
    short(rest.split('"').nth(1)?)
}

/// Returns the commit at the repository's head.
fn commit_of_repository() -> Option<String> {
    let root = git(&["rev-parse", "--show-toplevel"])?;
    let here = std::env::current_dir().ok()?.canonicalize().ok()?;
    if Path::new(&root).canonicalize().ok()? != here {
        return None;
    }
    // It grows whenever the head moves, on a branch or to another; where there is none, HEAD tells
    // of the latter alone. Files that are not there would have this run in every build.
    let watched = ["logs/HEAD", "HEAD"].map(|file| git(&["rev-parse", "--git-path", file]));
    let watched = watched.into_iter().flatten();
    if let Some(file) = watched.into_iter().find(|file| Path::new(file).is_file()) {
        println!("cargo::rerun-if-changed={file}");
    }
    short(&git(&["rev-parse", "HEAD"])?)
}

fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git").args(args).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

/// Returns the first digits of a commit, as many as tell it apart.
fn short(commit: &str) -> Option<String> {
    let is_commit = commit.len() >= 40 && commit.bytes().all(|b| b.is_ascii_hexdigit());
    is_commit.then(|| commit[..12].to_owned())
}
