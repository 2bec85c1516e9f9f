//! A config is a preset, overlaid by a file, overlaid by `key=value` settings.
//!
//! A config is edited as JSON: what the declared config does not have is an unknown key. Each new
//! value is checked against the schema the moment it is set, so that the error names its key.

use std::path::Path;

use serde_json::Value;

use super::{Config, Exp2Choice, RasterizerChoice};
use crate::error::{Error, Result, did_you_mean};
use crate::files::read_file;

/// Name of every preset and what it changes, in JSON, of the one under its `"preset"`, or of the
/// declared defaults; the first is the default of the command.
///
/// Sources, choices and deviations: `configs/README.md`.
pub const PRESETS: &[(&str, &str)] = &[
    (
        "gspotential",
        include_str!("../../configs/gspotential.json"),
    ),
    ("fast", include_str!("../../configs/fast.json")),
    // The declared defaults.
    ("paper", "{}"),
    ("3dgs", include_str!("../../configs/3dgs.json")),
    (
        "instantsplat",
        include_str!("../../configs/instantsplat.json"),
    ),
    (
        "dropgaussian",
        include_str!("../../configs/dropgaussian.json"),
    ),
    ("d2gs", include_str!("../../configs/d2gs.json")),
    ("corgs", include_str!("../../configs/corgs.json")),
    ("fsgs", include_str!("../../configs/fsgs.json")),
    ("sparsegs", include_str!("../../configs/sparsegs.json")),
    (
        "gaussianobject",
        include_str!("../../configs/gaussianobject.json"),
    ),
    (
        "splatfields",
        include_str!("../../configs/splatfields.json"),
    ),
    ("sparsesurf", include_str!("../../configs/sparsesurf.json")),
    (
        "ablation-virtual",
        include_str!("../../configs/ablation/virtual.json"),
    ),
    (
        "ablation-info",
        include_str!("../../configs/ablation/info.json"),
    ),
    (
        "ablation-prune",
        include_str!("../../configs/ablation/prune.json"),
    ),
    (
        "ablation-densify",
        include_str!("../../configs/ablation/densify.json"),
    ),
    (
        "ablation-both",
        include_str!("../../configs/ablation/both.json"),
    ),
];

/// A key whose value differs between two configs.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// As `--set` takes it, `section.name`.
    pub key: String,
    /// Its value in the config that was asked.
    pub here: Value,
    /// Its value in the other config.
    pub there: Value,
}

impl Difference {
    /// Returns `key=value` with the value of the config that was asked, as `--set` takes it.
    pub fn setting(&self) -> String {
        format!("{}={}", self.key, self.here)
    }
}

impl Config {
    /// Returns the preset of this name; a usage error lists those that exist.
    pub fn preset(name: &str) -> Result<Config> {
        let Some((_, text)) = PRESETS.iter().find(|(known, _)| *known == name) else {
            let names = PRESETS.iter().map(|(known, _)| *known);
            return Err(
                Error::usage(format!("there is no preset `{name}`")).way_out(
                    did_you_mean(name, names.clone())
                        .unwrap_or_else(|| format!("choose from {}", quoted(names))),
                ),
            );
        };
        let config = Config::overlay_of(text.as_bytes(), || Ok(Config::default()));
        config
            .map(|config| Config {
                preset: name.to_owned(),
                ..config
            })
            .map_err(|e| e.at(format!("preset `{name}`")))
    }

    /// Returns the config of a file: a JSON object that states what it changes and, under
    /// `"preset"`, what it changes it from (`gspotential` unless stated). The `config.json` of a
    /// run is one, too. The values' ranges are left to [`Config::validate`].
    pub fn from_file(path: &Path) -> Result<Config> {
        let bytes = read_file(path)?;
        Self::overlay_of(&bytes, || Config::preset(PRESETS[0].0)).map_err(|e| e.at_path(path))
    }

    /// Returns the config that `bytes`, a JSON object, makes of the preset that it names, or of
    /// `unnamed`.
    fn overlay_of(bytes: &[u8], unnamed: impl FnOnce() -> Result<Config>) -> Result<Config> {
        let overlay: Value = serde_json::from_slice(bytes)
            .map_err(|e| Error::usage(format!("not valid JSON: {e}")))?;
        let Value::Object(mut overlay) = overlay else {
            return Err(Error::usage("a config is a JSON object")
                .way_out("write for example {\"preset\": \"paper\", \"iterations\": 3000}"));
        };
        let config = match overlay.remove("preset") {
            None => unnamed()?,
            Some(Value::String(name)) => Config::preset(&name)?,
            Some(other) => {
                return Err(Error::usage(format!(
                    "`preset` is {other}, which is not a preset's name"
                )));
            }
        };
        config.overlaid(Value::Object(overlay))
    }

    /// Applies one `key=value` setting, as in `loss.ssim_weight=0.3`. The value is JSON, or
    /// else a string.
    pub fn set(&self, setting: &str) -> Result<Config> {
        let Some((key, text)) = setting.split_once('=') else {
            return Err(Error::usage(format!("`{setting}` is not a setting"))
                .way_out("write key=value, for example loss.ssim_weight=0.3"));
        };
        let key = key.trim();
        let value =
            serde_json::from_str(text).unwrap_or_else(|_| Value::String(text.trim().to_owned()));
        let nested = key
            .rsplit('.')
            .fold(value, |inner, part| serde_json::json!({ part: inner }));
        self.overlaid(nested)
    }

    /// Returns the config with every value that `overlay`, an object, has.
    fn overlaid(&self, overlay: Value) -> Result<Config> {
        let mut tree = self.tree()?;
        let mut leaves = Vec::new();
        collect_leaves(&tree, &overlay, String::new(), &mut leaves)?;
        let mut config = self.clone();
        for (key, value) in leaves {
            let shown = value.to_string();
            if let Some(slot) = tree.pointer_mut(&format!("/{}", key.replace('.', "/"))) {
                *slot = value;
            }
            config = Config::deserialize_at(&tree, &key, &shown)?;
        }
        Ok(config)
    }

    /// Returns every value in which this config differs from another, the preset's name aside.
    ///
    /// # Errors
    /// A config that cannot be written.
    pub fn differences(&self, from: &Config) -> Result<Vec<Difference>> {
        let (here, there) = (self.tree()?, from.tree()?);
        let mut keys = Vec::new();
        list_keys(&here, "", &mut keys);
        let value = |tree: &Value, key: &str| tree.pointer(&pointer(key)).cloned();
        let values = keys.into_iter().filter_map(|key| {
            let (here, there) = (value(&here, &key)?, value(&there, &key)?);
            let differs = here != there && !here.is_object() && key != "preset";
            differs.then_some(Difference { key, here, there })
        });
        Ok(values.collect())
    }

    /// Returns the values in which a run's config is not what was asked for; as [`Config::differences`], but that
    /// the run has decided what `auto` leaves to its adapter.
    ///
    /// # Errors
    /// A config that cannot be written.
    pub fn departures(&self, asked: &Config) -> Result<Vec<Difference>> {
        let mut asked = asked.clone();
        if asked.render.rasterizer == RasterizerChoice::Auto {
            asked.render.rasterizer = self.render.rasterizer;
        }
        if asked.render.exp2 == Exp2Choice::Auto {
            asked.render.exp2 = self.render.exp2;
        }
        self.differences(&asked)
    }

    /// Returns the values that differ from the preset's, in the order of the keys; neither the seed nor what
    /// the preset leaves to the adapter is one of them.
    pub fn changes(&self) -> Result<Vec<Difference>> {
        let mut changes = self.departures(&Config::preset(&self.preset)?)?;
        changes.retain(|change| change.key != "seed");
        Ok(changes)
    }

    fn deserialize_at(tree: &Value, key: &str, shown: &str) -> Result<Config> {
        serde_json::from_value(tree.clone()).map_err(|e| {
            let why = e.to_string();
            let error = Error::usage(format!("`{key}` cannot be {shown}: {why}"));
            match near_choice(shown, &why) {
                Some(way_out) => error.way_out(way_out),
                None => error,
            }
        })
    }

    pub(super) fn tree(&self) -> Result<Value> {
        serde_json::to_value(self).map_err(|e| Error::new(format!("config: {e}")))
    }

    /// Returns the whole config as indented JSON with a newline at the end.
    pub fn to_json(&self) -> Result<String> {
        serde_json::to_string_pretty(self)
            .map(|text| text + "\n")
            .map_err(|e| Error::new(format!("config: {e}")))
    }
}

/// Lists `overlay`'s values with their dotted keys, in its order; every key must be in `tree`.
fn collect_leaves(
    tree: &Value,
    overlay: &Value,
    key: String,
    leaves: &mut Vec<(String, Value)>,
) -> Result<()> {
    let Value::Object(section) = tree.pointer(&pointer(&key)).unwrap_or(&Value::Null) else {
        leaves.push((key, overlay.clone()));
        return Ok(());
    };
    let Value::Object(overlay) = overlay else {
        return Err(
            Error::usage(format!("`{key}` is a section and cannot be {overlay}")).way_out(format!(
                "set one of {}",
                quoted(section.keys().map(|name| format!("{key}.{name}")))
            )),
        );
    };
    for (name, value) in overlay {
        let inner = if key.is_empty() {
            name.clone()
        } else {
            format!("{key}.{name}")
        };
        if inner == "preset" {
            return Err(Error::usage("`preset` is not a setting")
                .way_out("choose one with --preset, or with \"preset\" in a config file"));
        }
        if !section.contains_key(name) {
            return Err(unknown_key(tree, &inner));
        }
        collect_leaves(tree, value, inner, leaves)?;
    }
    Ok(())
}

fn unknown_key(tree: &Value, key: &str) -> Error {
    let mut known = Vec::new();
    list_keys(tree, "", &mut known);
    if known.iter().any(|k| k == key) {
        return Error::usage(format!("`{key}` stands in a file as one dotted key"))
            .way_out("nest it: {\"section\": {\"key\": value}}");
    }
    let last = key.rsplit('.').next().unwrap_or(key);
    // A key under the wrong section is a likelier slip than three wrong letters.
    let same_name = known
        .iter()
        .find(|k| k.rsplit('.').next() == Some(last))
        .map(|k| format!("did you mean `{k}`?"));
    Error::usage(format!("there is no config key `{key}`")).way_out(
        same_name
            .or_else(|| did_you_mean(key, known.iter().map(String::as_str)))
            .unwrap_or_else(|| "`config.json` of any run lists all keys".to_owned()),
    )
}

fn list_keys(tree: &Value, prefix: &str, keys: &mut Vec<String>) {
    let Value::Object(section) = tree else { return };
    for (name, value) in section {
        let key = format!("{prefix}{name}");
        list_keys(value, &format!("{key}."), keys);
        keys.push(key);
    }
}

/// Returns the JSON pointer of a dotted key; that of the empty key is the whole.
pub(super) fn pointer(key: &str) -> String {
    if key.is_empty() {
        String::new()
    } else {
        format!("/{}", key.replace('.', "/"))
    }
}

/// Returns the nearest of the names that serde's message expects, as in "expected `a` or `b`", to
/// the JSON string `shown`: so that no second list of an enum's names exists.
fn near_choice(shown: &str, why: &str) -> Option<String> {
    let wrong: String = serde_json::from_str(shown).ok()?;
    let (_, expected) = why.split_once(", expected ")?;
    did_you_mean(&wrong, expected.split('`').skip(1).step_by(2))
}

fn quoted(names: impl Iterator<Item = impl std::fmt::Display>) -> String {
    names
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ")
}
