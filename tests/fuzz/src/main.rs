//! Feeds one reader with files that libFuzzer makes up, guided by the branches they take:
//!
//! `GSPOTENTIAL_FUZZ=READER gspotential-fuzz CORPUS [libFuzzer's options]`; see `.ci/fuzz`.
//!
//! What is a finding: a panic; more than a second; more memory than [`room`] for the file's
//! size; an error that is more than a line; a scene that breaks what its type promises.
#![no_main]

#[path = "../../scene/build.rs"]
#[expect(dead_code, reason = "shared with the tests of the scene")]
mod build;
#[path = "../../scene/fixtures.rs"]
#[expect(dead_code, reason = "shared with the tests of the scene")]
mod fixtures;
mod readers;

use std::alloc::System;
use std::sync::OnceLock;

use cap::Cap;
use libfuzzer_sys::fuzz_target;
use readers::Target;

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, usize::MAX);

static TARGET: OnceLock<Target> = OnceLock::new();

/// Bytes that reading a file of `len` bytes may take: images grow most, by 24,768 and copies.
fn room(len: usize) -> usize {
    (32 << 20) + 65_536 * len
}

fuzz_target!(
    init: start(),
    |file: &[u8]| {
        let Some(target) = TARGET.get() else { return };
        // An allocation beyond the limit fails, which ends the process: a finding.
        let limit = MEMORY.allocated() + room(file.len());
        MEMORY.set_limit(limit).expect("a limit above what is taken");
        target.read(file);
        MEMORY.set_limit(usize::MAX).expect("no limit");
    }
);

/// Chooses the reader, and gives its corpus the undamaged file.
fn start() {
    let name = std::env::var("GSPOTENTIAL_FUZZ").unwrap_or_default();
    let target = readers::target(&name).unwrap_or_else(|| {
        eprintln!("GSPOTENTIAL_FUZZ is one of {}", readers::names().join(", "));
        std::process::exit(2)
    });
    let corpus = std::env::args().skip(1).find(|arg| !arg.starts_with('-'));
    if let Some(corpus) = corpus
        && std::path::Path::new(&corpus).is_dir()
    {
        std::fs::write(format!("{corpus}/undamaged"), target.undamaged()).expect("a seed");
    }
    let _ = TARGET.set(target);
}
