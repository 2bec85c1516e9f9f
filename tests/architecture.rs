//! Modules use one another one way only: every module may use those above it in the list, and the
//! parts of a folder use one another without a circle. The f64 twin stands apart: it uses none of
//! them, and only what compares with it uses it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The modules from the ground up; the flow of data from `scene` to `report` in its order.
const ORDER: &[&str] = &[
    "version",
    "error",
    "files",
    "terminal",
    "camera",
    "config",
    "scene",
    "prior",
    "dense",
    "gaussians",
    "gpu",
    "metrics",
    "field",
    "views",
    "cloud",
    "render",
    "mesh",
    "train",
    "eval",
    "run",
    "report",
    "live",
    "pipeline",
    "study",
    "doctor",
    "cli",
];

/// The f64 twin, which shares no arithmetic with what is held to it.
const TWIN: &str = "doctor/twin";

/// What the twin may use: itself, the standard library, threads and random bits.
const TWIN_NEEDS: &[&str] = &["super", "std", "rayon", "rand_chacha"];

fn rank(module: &str) -> Option<usize> {
    ORDER.iter().position(|name| *name == module)
}

/// The modules of the crate that `code`, a file of `module`, names; `depth` is how many `super`
/// lead from the file to the crate's root.
fn used_modules(code: &str, depth: usize) -> Vec<String> {
    names_after(code, &["crate::", &"super::".repeat(depth)])
}

/// The first names of the paths in `code` that begin with one of `prefixes`.
fn names_after(code: &str, prefixes: &[&str]) -> Vec<String> {
    let code: String = code
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .collect::<Vec<_>>()
        .join("\n");
    let mut used = Vec::new();
    for prefix in prefixes {
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
    if path.starts_with(TWIN) {
        return foreign_to_twin(path, code);
    }
    let depth = parts.len() - usize::from(parts.last().is_some_and(|part| part == "mod"));
    let Some(own) = rank(module) else {
        return vec![format!(
            "{}: `{module}` is not in the order",
            path.display()
        )];
    };
    let mut refused = used_modules(code, depth);
    refused.retain(|used| rank(used).is_some_and(|theirs| theirs > own));
    if module != "doctor" && names_after(code, &["crate::doctor::"]).contains(&"twin".to_owned()) {
        refused.push(TWIN.to_owned());
    }
    refused
        .iter()
        .map(|used| format!("{}: `{module}` may not use `{used}`", path.display()))
        .collect()
}

/// What a file of the twin uses beyond [`TWIN_NEEDS`], and files that it takes in whole.
fn foreign_to_twin(path: &Path, code: &str) -> Vec<String> {
    let is_mod = path.file_stem().is_some_and(|stem| stem == "mod");
    let above = "super::".repeat(if is_mod { 1 } else { 2 });
    let mut found = names_after(code, &["crate::", &above]);
    let lines = code.lines().map(str::trim);
    let lines = lines.map(|line| line.strip_prefix("pub ").unwrap_or(line));
    for line in lines {
        let uses = line.strip_prefix("use ").map(first_names);
        let foreign = |name: &String| !TWIN_NEEDS.contains(&name.as_str());
        found.extend(uses.into_iter().flatten().filter(foreign));
        if line.contains("include!") || line.starts_with("#[path") {
            found.push(line.to_owned());
        }
    }
    found
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

/// Every Rust file of `src` with its text, by its path there.
fn sources() -> Vec<(PathBuf, String)> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    rust_files(&src, &mut files);
    assert!(files.len() > 10, "found {} files", files.len());
    let read = |file: PathBuf| {
        let code = fs::read_to_string(&file).unwrap();
        (file.strip_prefix(&src).unwrap().to_owned(), code)
    };
    files.into_iter().map(read).collect()
}

#[test]
fn modules_depend_one_way() {
    let found = sources()
        .into_iter()
        .flat_map(|(path, code)| violations(&path, &code));
    let found: Vec<String> = found.collect();
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
    assert_eq!(n("field/focus.rs", "fn f() { crate::render::draw() }"), 1);
    assert_eq!(n("field/mod.rs", "use super::render;"), 1);
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
            "field/mod.rs",
            "use crate::field::Kernel; use wgpu::crate_train::x;"
        ),
        0
    );
    assert_eq!(n("lib.rs", "use crate::train;"), 0);
}

/// The parts of `folder` that `code`, the file at `path` below it, names.
fn used_parts(folder: &Path, path: &Path, code: &str) -> Vec<String> {
    let is_mod = path.file_stem().is_some_and(|stem| stem == "mod");
    let below = path.iter().count() - folder.iter().count();
    let from_root: String = folder
        .iter()
        .map(|part| format!("{}::", part.to_string_lossy()))
        .collect();
    let above = "super::".repeat(below - usize::from(is_mod));
    names_after(code, &[&format!("crate::{from_root}"), &above])
}

/// A circle among the parts of a module, if there is one.
fn circle(uses: &BTreeMap<String, BTreeSet<String>>) -> Option<Vec<String>> {
    fn visit(
        part: &str,
        uses: &BTreeMap<String, BTreeSet<String>>,
        trail: &mut Vec<String>,
        done: &mut BTreeSet<String>,
    ) -> bool {
        if let Some(start) = trail.iter().position(|t| t == part) {
            trail.drain(..start);
            return true;
        }
        if !done.insert(part.to_owned()) {
            return false;
        }
        trail.push(part.to_owned());
        if uses[part].iter().any(|used| visit(used, uses, trail, done)) {
            return true;
        }
        trail.pop();
        false
    }
    let mut done = BTreeSet::new();
    uses.keys().find_map(|part| {
        let mut trail = Vec::new();
        visit(part, uses, &mut trail, &mut done).then_some(trail)
    })
}

/// What each file or folder right below `folder` uses of its siblings.
fn sibling_uses(folder: &Path, files: &[(PathBuf, String)]) -> BTreeMap<String, BTreeSet<String>> {
    let part = |path: &Path| {
        let rest = path.strip_prefix(folder).ok()?.with_extension("");
        let first = rest.iter().next()?.to_string_lossy().into_owned();
        (!["mod", "lib", "main"].contains(&first.as_str())).then_some(first)
    };
    let mut uses: BTreeMap<String, BTreeSet<String>> = files
        .iter()
        .filter_map(|(path, _)| Some((part(path)?, BTreeSet::new())))
        .collect();
    for (path, code) in files {
        let Some(own) = part(path) else { continue };
        for used in used_parts(folder, path, code) {
            if used != own && uses.contains_key(&used) {
                uses.entry(own.clone()).or_default().insert(used);
            }
        }
    }
    uses
}

#[test]
fn no_folder_holds_a_circle() {
    let files = sources();
    let folders: BTreeSet<&Path> = files
        .iter()
        .flat_map(|(path, _)| path.ancestors().skip(1))
        .collect();
    assert!(folders.contains(Path::new("scene/formats")), "{folders:?}");
    let circles: Vec<String> = folders
        .iter()
        .filter_map(|folder| {
            let circle = circle(&sibling_uses(folder, &files))?;
            Some(format!("{}: {}", folder.display(), circle.join(" -> ")))
        })
        .collect();
    assert!(circles.is_empty(), "{}", circles.join("\n"));
}

#[test]
fn planted_circles_are_found() {
    let files = sources();
    let uses = sibling_uses(Path::new("scene"), &files);
    assert!(
        uses["load"].contains("formats") && uses["formats"].contains("layout"),
        "{uses:?}"
    );
    let planted = |path: &str, code: &str| {
        let mut files = files.clone();
        files.push((PathBuf::from(path), code.to_owned()));
        let folders = Path::new(path).ancestors().skip(1);
        folders
            .into_iter()
            .find_map(|folder| circle(&sibling_uses(folder, &files)))
    };
    assert!(planted("scene/formats/x.rs", "use crate::scene::load::load;").is_some());
    assert!(planted("scene/formats/x.rs", "use super::super::load::load;").is_some());
    assert!(planted("scene/lens.rs", "use super::undistort::undistort;").is_some());
    assert!(planted("train/schedule.rs", "use super::policy::plan;").is_some());
    assert!(planted("pipeline/job.rs", "use super::train::train;").is_some());
    assert!(planted("scene/builtin/noise.rs", "use super::texture::Texture;").is_some());
    assert_eq!(
        planted("scene/formats/x.rs", "use crate::scene::lens::pinhole;"),
        None
    );
}

#[test]
fn a_module_with_parts_is_a_folder_with_a_mod_file() {
    let files = sources();
    let beside = files.iter().filter(|(path, _)| {
        let folder = path.with_extension("");
        files
            .iter()
            .any(|(other, _)| other != path && other.starts_with(&folder))
    });
    let beside: Vec<_> = beside.map(|(path, _)| path.display().to_string()).collect();
    assert!(beside.is_empty(), "{}", beside.join("\n"));
}

#[test]
fn planted_violations_around_the_twin_are_found() {
    let n = |path: &str, code: &str| violations(Path::new(path), code).len();
    // It shares nothing: neither modules, nor crates that do arithmetic, nor files.
    let twin = |code: &str| n("doctor/twin/sh.rs", code);
    assert_eq!(twin("use crate::gpu::constants::SH_0;"), 2);
    assert_eq!(twin("use super::super::rig;"), 1);
    assert_eq!(
        n("doctor/twin/mod.rs", "pub use super::finding::Finding;"),
        1
    );
    assert_eq!(twin("fn f() { crate::files::read_file() }"), 1);
    assert_eq!(twin("use glam::DVec3;"), 1);
    assert_eq!(twin("include!(\"../field.rs\");"), 1);
    assert_eq!(twin("#[path = \"../field.rs\"]\nmod field;"), 1);
    // Nor does anything but the comparisons use it.
    assert!(n("render/pass.rs", "use crate::doctor::twin::sh;") > 0);
    assert_eq!(n("cli/doctor.rs", "use crate::doctor::twin::sh;"), 1);

    assert_eq!(
        twin("use super::linalg::{Vec3, dot};\nuse rayon::prelude::*;"),
        0
    );
    assert_eq!(n("doctor/view.rs", "use crate::doctor::twin::sh;"), 0);
}
