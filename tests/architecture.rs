//! Modules use one another one way only: every module may use those above it in the list.

use std::fs;
use std::path::{Path, PathBuf};

/// The modules from the ground up; the flow of data from `scene` to `report` in its order.
const ORDER: &[&str] = &[
    "error",
    "digest",
    "camera",
    "config",
    "progress",
    "scene",
    "gaussians",
    "cameras_json",
    "gpu",
    "metrics",
    "run",
    "field",
    "views",
    "splat",
    "render",
    "train",
    "eval",
    "report",
    "pipeline",
    "cli",
];

fn rank(module: &str) -> Option<usize> {
    ORDER.iter().position(|name| *name == module)
}

/// The modules of the crate that `code`, a file of `module`, names; `depth` is how many `super`
/// lead from the file to the crate's root.
fn used_modules(code: &str, depth: usize) -> Vec<String> {
    let code: String = code
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .collect::<Vec<_>>()
        .join("\n");
    let root = ["super::"; 8][..depth].concat();
    let mut used = Vec::new();
    for prefix in ["crate::", root.as_str()] {
        for (at, _) in code.match_indices(prefix) {
            let before = code[..at].chars().next_back();
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
                continue;
            }
            used.extend(first_names(&code[at + prefix.len()..]));
        }
    }
    used.sort();
    used.dedup();
    used
}

/// `a` of `a::b`, and `a` and `c` of `{a::{x, y}, c}`.
fn first_names(path: &str) -> Vec<String> {
    let name = |text: &str| -> String {
        let text = text.trim_start();
        text.chars()
            .take_while(|c| c.is_alphanumeric() || *c == '_')
            .collect()
    };
    let Some(group) = path.strip_prefix('{') else {
        return vec![name(path)];
    };
    let (mut level, mut names, mut start) = (0, Vec::new(), 0);
    for (i, c) in group.char_indices() {
        match c {
            '{' => level += 1,
            '}' if level > 0 => level -= 1,
            ',' | '}' if level == 0 => {
                names.push(name(&group[start..i]));
                start = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

/// What is wrong with a file: `path` is relative to `src`.
fn violations(path: &Path, code: &str) -> Vec<String> {
    let parts: Vec<String> = path
        .with_extension("")
        .iter()
        .map(|part| part.to_string_lossy().into_owned())
        .collect();
    let module = &parts[0];
    if parts.len() == 1 && (module == "main" || module == "lib") {
        return Vec::new();
    }
    let Some(own) = rank(module) else {
        return vec![format!(
            "{}: `{module}` is not in the order",
            path.display()
        )];
    };
    let depth = parts.len() - usize::from(parts.last().is_some_and(|part| part == "mod"));
    used_modules(code, depth)
        .iter()
        .filter(|used| rank(used).is_some_and(|theirs| theirs > own))
        .map(|used| format!("{}: `{module}` may not use `{used}`", path.display()))
        .collect()
}

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, files);
        } else if path.extension().is_some_and(|ext| ext == "rs") {
            files.push(path);
        }
    }
}

#[test]
fn modules_depend_one_way() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    rust_files(&src, &mut files);
    assert!(files.len() > 10, "found {} files", files.len());
    let found: Vec<String> = files
        .iter()
        .flat_map(|file| {
            let code = fs::read_to_string(file).unwrap();
            violations(file.strip_prefix(&src).unwrap(), &code)
        })
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn planted_violations_are_found() {
    let n = |path: &str, code: &str| violations(Path::new(path), code).len();
    assert_eq!(n("scene/load.rs", "use crate::train::Loop;"), 1);
    assert_eq!(
        n(
            "scene/mod.rs",
            "pub use crate::{\n  error::Error,\n  views::{a, b}, eval};"
        ),
        2
    );
    assert_eq!(n("field.rs", "fn f() { crate::render::draw() }"), 1);
    assert_eq!(n("field.rs", "use super::render;"), 1);
    assert_eq!(n("gpu/limits.rs", "use super::super::views::View;"), 1);
    assert_eq!(n("unheard_of.rs", ""), 1);

    assert_eq!(
        n(
            "train/mod.rs",
            "use crate::render::Renderer;\nuse super::scene;"
        ),
        0
    );
    assert_eq!(
        n("scene/load.rs", "use super::train_split; // crate::train"),
        0
    );
    assert_eq!(
        n(
            "field.rs",
            "use crate::field::Kernel; use wgpu::crate_train::x;"
        ),
        0
    );
    assert_eq!(n("lib.rs", "use crate::train;"), 0);
}
