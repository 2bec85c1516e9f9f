//! Prose: the mechanical part of how comments and documents are written.

use std::fs;
use std::path::{Path, PathBuf};

/// Words that make a sentence foreign when it begins with them.
const OPENINGS: [&str; 3] = ["Of", "Where", "Otherwise"];

/// Folders that other rules of their own hold for, or that are results of programs.
const LEFT_OUT: [&str; 4] = ["tests/fuzz/corpus", "benches/runs", "target", ".git"];

fn texts(folder: &Path, files: &mut Vec<PathBuf>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if LEFT_OUT
            .iter()
            .any(|left| path.starts_with(root.join(left)))
        {
            continue;
        }
        if path.is_dir() {
            texts(&path, files);
        } else if matches!(
            path.extension().and_then(|e| e.to_str()),
            Some("rs" | "wgsl" | "md")
        ) {
            files.push(path);
        }
    }
}

/// The prose of a line: what follows `//` in code, the whole line in a document.
fn prose(line: &str, is_code: bool) -> Option<&str> {
    let line = line.trim_start();
    if !is_code {
        return Some(line.trim_start_matches(['-', '|', ' ']));
    }
    let comment = line.strip_prefix("//")?;
    Some(comment.trim_start_matches(['/', '!']).trim_start())
}

fn opens(text: &str) -> bool {
    OPENINGS.iter().any(|word| {
        let rest = text.strip_prefix(word);
        rest.is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric()))
    })
}

/// Lines, from 1, with a sentence that begins with one of [`OPENINGS`].
fn foreign(text: &str, is_code: bool) -> Vec<usize> {
    let mut found = Vec::new();
    let mut goes_on = false;
    for (i, line) in text.lines().enumerate() {
        let Some(prose) = prose(line, is_code) else {
            goes_on = false;
            continue;
        };
        let later = prose
            .match_indices(". ")
            .any(|(at, _)| opens(&prose[at + 2..]));
        if (!goes_on && opens(prose)) || later {
            found.push(i + 1);
        }
        goes_on = !prose.is_empty() && !prose.ends_with(['.', ':']);
    }
    found
}

#[test]
fn no_sentence_opens_with_a_word_that_leaves_it_without_a_subject() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    texts(root, &mut files);
    assert!(files.contains(&root.join("src/lib.rs")) && files.contains(&root.join("README.md")));
    let mut found = Vec::new();
    for path in files {
        let text = fs::read_to_string(&path).expect("text");
        let is_code = path.extension().is_some_and(|e| e != "md");
        let shown = path
            .strip_prefix(root)
            .expect("below")
            .display()
            .to_string();
        let lines = foreign(&text, is_code).into_iter();
        found.extend(lines.map(|line| format!("{shown}:{line}")));
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn planted_openings_are_found() {
    let code = |text: &str| foreign(text, true);
    assert_eq!(code("/// Of two, the first."), [1]);
    assert_eq!(
        code("fn f() {}\n    // It ends. Where it does not, it stays."),
        [2]
    );
    assert_eq!(code("//! It ends.\n//! Otherwise it goes on."), [2]);
    // A line of a sentence that began above, another word, and code.
    assert_eq!(
        code("// It is a part\n// Of nothing. Office, Wherever."),
        [0; 0]
    );
    assert_eq!(code("let x = \"Where is it? Of all\";"), [0; 0]);
    assert_eq!(foreign("| Where | what |", false), [1]);
}
