//! This module makes the reference of all keys from their declaration.

use std::fmt::Write as _;

use serde_json::Value;

use super::Config;
use super::declare::{Allowed, Entry, Rule};
use super::overlay::{PRESETS, pointer};
use crate::error::{Error, Result};

/// A key of the config.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// Dotted name as `--set` takes it, `section.name`.
    pub key: String,
    /// Meaning, one line.
    pub doc: String,
    /// Allowed values, unit and place in the paper.
    pub rule: Rule,
    /// The words that it may be; empty for what is no word.
    pub choices: &'static [&'static str],
    /// Whether it may be null.
    pub nullable: bool,
    /// Its value in each of [`PRESETS`].
    pub values: Vec<Value>,
}

impl Key {
    /// Returns whether the presets have different values for it; their own names always differ.
    pub fn differs(&self) -> bool {
        self.key != "preset" && self.values.iter().any(|value| *value != self.values[0])
    }
}

/// Returns in one line what a preset is for; empty for an unknown one.
pub fn summary(preset: &str) -> &'static str {
    match preset {
        "paper" => "the paper's method: virtual views, coverage-aware pruning and densification",
        "3dgs" => "the baseline: the same cloud and settings, no virtual views, no coverage rules",
        "gspotential" => {
            "our best: views of what photographs see, carving, filled holes, a far shell; no densification"
        }
        "fast" => "gspotential in a tenth of the time: fewer iterations and views, SH degree 0",
        "instantsplat" => {
            "InstantSplat's settings: refined poses, high rates, by confidence; no densification"
        }
        "dropgaussian" => "DropGaussian's settings: 3dgs with uniform dropout, slow densification",
        "d2gs" => {
            "D2GS's settings: as dropgaussian, guided by depth and density, far pixels counted again"
        }
        "gaussianobject" => {
            "GaussianObject's coarse stage, for cut-out subjects: visual hull, silhouettes"
        }
        "corgs" => {
            "CoR-GS's settings: two sets of Gaussians that learn from each other, random backgrounds"
        }
        "fsgs" => {
            "FSGS's settings: growth towards far neighbours, held to the cloud's depth, no pseudo views"
        }
        "sparsegs" => {
            "SparseGS's settings: held to the cloud's depth, also in patches, floaters pruned; no SDS"
        }
        "splatfields" => {
            "SplatFields' settings: a convolutional network, trained on the CPU, makes the Gaussians"
        }
        "sparsesurf" => {
            "SparseSurf's settings: flat Gaussians, held to the cloud's depths and normals in place of stereo"
        }
        "ablation-virtual" => {
            "ablation: virtual views between photographs, no field, no coverage rules"
        }
        "ablation-info" => "ablation: views by the information term alone, no coverage rules",
        "ablation-prune" => "ablation-info and coverage-aware pruning",
        "ablation-densify" => "ablation-info and coverage-aware densification",
        "ablation-both" => "ablation-info and both coverage rules",
        _ => "",
    }
}

/// Returns every key in the order of its declaration.
///
/// # Errors
/// A preset that is no config.
pub fn keys() -> Result<Vec<Key>> {
    let presets = PRESETS
        .iter()
        .map(|(name, _)| Config::preset(name)?.tree())
        .collect::<Result<Vec<Value>>>()?;
    let entries = Config::default().entries().into_iter();
    entries
        .filter(|entry| !entry.is_section)
        .map(|entry| key(entry, &presets))
        .collect()
}

fn key(entry: Entry, presets: &[Value]) -> Result<Key> {
    let values = presets
        .iter()
        .map(|preset| preset.pointer(&pointer(&entry.key)).cloned());
    let values = values.collect::<Option<Vec<Value>>>();
    Ok(Key {
        values: values.ok_or_else(|| Error::new(format!("config: `{}` is nowhere", entry.key)))?,
        key: entry.key,
        doc: entry.doc,
        rule: entry.rule,
        choices: entry.choices,
        nullable: entry.nullable,
    })
}

/// Returns every key with its values in the presets, its meaning, unit, range and place in the
/// paper: a list in Markdown under a heading for each section.
///
/// # Errors
/// A preset that is no config.
pub fn reference() -> Result<String> {
    let mut keys = keys()?.into_iter();
    let mut text = String::new();
    for entry in Config::default().entries() {
        // Writing to a string cannot fail.
        let _ = if entry.is_section {
            writeln!(text, "\n### `{}`\n\n{}\n", entry.key, entry.doc)
        } else {
            let key = keys
                .next()
                .ok_or_else(|| Error::new("config: a key is missing"))?;
            writeln!(text, "- {}", line(&key))
        };
    }
    Ok(text)
}

/// How many presets with one value are named; more are "all others", if not yet more have the first value.
const MOST_NAMED: usize = 3;

/// Returns the line `` `key` = value, other in `preset`. What it means. Unit: R. Allowed: 0 to 1.
/// Paper: Eq. 1.``
fn line(key: &Key) -> String {
    let mut line = format!("`{}` = {}", key.key, key.values[0]);
    if key.differs() {
        let mut groups: Vec<(&Value, Vec<&str>)> = Vec::new();
        for ((name, _), value) in PRESETS.iter().zip(&key.values) {
            match groups.iter_mut().find(|(of, _)| *of == value) {
                Some((_, names)) => names.push(name),
                None => groups.push((value, vec![name])),
            }
        }
        let (_, as_first) = groups.remove(0);
        groups.sort_by_key(|(_, names)| names.len());
        let largest = groups.len() - 1;
        for (i, (value, names)) in groups.iter().enumerate() {
            let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
            line += &match names.len() {
                n if n > MOST_NAMED.max(as_first.len()) && i == largest => {
                    format!(", {value} in all others")
                }
                _ => format!(", {value} in {}", names.join(" and ")),
            };
        }
    }
    line += &format!(". {}", key.doc);
    let mut add = |what: &str, text: &str| {
        if !text.is_empty() {
            line += &format!(" {what}: {text}.");
        }
    };
    add("Unit", key.rule.unit);
    let choices: Vec<String> = key.choices.iter().map(|word| format!("`{word}`")).collect();
    add("Choices", &choices.join(", "));
    if key.rule.allowed != Allowed::Any {
        let null = if key.nullable { "null, or " } else { "" };
        add("Allowed", &format!("{null}{}", key.rule.allowed));
    }
    add("Paper", key.rule.paper);
    line
}
