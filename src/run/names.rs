//! This module names files after views, whose names come from a scene's files.

use std::collections::{BTreeMap, BTreeSet};

/// Returns one file name a view with extension `ext`: the view's name with its own extension
/// replaced, folders joined by `_`. No name leaves its folder, and no two are alike, not even in
/// case; that of the contact sheet is taken.
pub fn file_names(views: &[&str], ext: &str) -> Vec<String> {
    let stems: Vec<String> = views.iter().map(|view| stem(&flat(view))).collect();
    let mut n_alike: BTreeMap<String, usize> = BTreeMap::new();
    for stem in &stems {
        *n_alike.entry(stem.to_lowercase()).or_default() += 1;
    }
    let mut taken = BTreeSet::from([super::SHEET.to_owned()]);
    let mut names = Vec::with_capacity(views.len());
    for (view, stem) in views.iter().zip(stems) {
        // `a.jpg` and `a.png` keep their own extension, and what is alike even then a number.
        let base = if n_alike[&stem.to_lowercase()] > 1 {
            flat(view)
        } else {
            stem
        };
        let mut name = format!("{base}.{ext}");
        let mut n = 1;
        while !taken.insert(name.to_lowercase()) {
            n += 1;
            name = format!("{base}_{n}.{ext}");
        }
        names.push(name);
    }
    names
}

/// Keeps letters, digits, `.`, `-`, `_` and spaces inside; everything else becomes `_`.
fn flat(view: &str) -> String {
    let flat: String = view
        .chars()
        .map(|c| match c {
            '.' | '-' | '_' | ' ' => c,
            c if c.is_alphanumeric() => c,
            _ => '_',
        })
        .collect();
    let flat = flat.trim_matches(['.', ' ']);
    if flat.is_empty() {
        "view".to_owned()
    } else {
        flat.to_owned()
    }
}

fn stem(flat: &str) -> String {
    match flat.rsplit_once('.') {
        Some((stem, _)) if !stem.is_empty() => stem.to_owned(),
        _ => flat.to_owned(),
    }
}
