//! Tiny studies and what they leave.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::kit::program::{Ended, run, succeed};

pub(super) fn study(folder: &Path, args: &str) -> Ended {
    run(folder, &format!("study {args}"))
}

/// What a study that must succeed printed: its report and its log.
#[track_caller]
pub(super) fn succeeds(folder: &Path, args: &str) -> (String, String) {
    let Ended { stdout, log, .. } = succeed(folder, &format!("study {args}"));
    (stdout, log)
}

/// The error of a study that must fail.
#[track_caller]
pub(super) fn fails(folder: &Path, args: &str, code: i32, parts: &[&str]) -> String {
    let output = study(folder, args);
    let log = output.log;
    assert_eq!(output.code, Some(code), "{args}: {log}");
    assert!(output.stdout.is_empty(), "{args}");
    let error = log.lines().find(|line| line.starts_with("error: "));
    let error = error.unwrap_or_else(|| panic!("{args}: {log}"));
    for part in parts {
        assert!(error.contains(part), "{args}: no `{part}` in: {error}");
    }
    log
}

/// Every file below a folder with its bytes.
pub(super) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = fs::read(&path).expect("a file");
                found.insert(path.display().to_string(), bytes);
            }
        }
    }
    found
}

pub(super) fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).expect("a file")).expect("JSON")
}

pub(super) const TINY: &str = "--scene builtin:32 --iterations 3 --max-points 40 --set scene.n_test=6 \
                    --set field.n_candidates=1024 --set views.count=3";
