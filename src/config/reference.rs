//! The reference of all keys, from the schema's own documentation.

use schemars::generate::SchemaSettings;
use serde_json::Value;

use super::Config;
use super::overlay::PRESETS;
use crate::error::{Error, Result};

/// A key of the config.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// As `--set` takes it, `section.name`.
    pub key: String,
    /// What it means, one line.
    pub doc: String,
    /// Its value in each of [`PRESETS`].
    pub values: Vec<Value>,
}

impl Key {
    /// Whether the presets have different values for it, as all have for their own name.
    pub fn differs(&self) -> bool {
        self.key != "preset" && self.values.iter().any(|value| *value != self.values[0])
    }
}

/// What a preset is for, one line; empty for an unknown one.
pub fn summary(preset: &str) -> &'static str {
    match preset {
        "paper" => "the paper's method: virtual views, coverage-aware pruning and densification",
        "3dgs" => "the baseline: the same cloud and settings, no virtual views, no coverage rules",
        "gspotential" => {
            "our best: views of what photographs see, carving, filled holes, a far shell; no densification"
        }
        "fast" => "gspotential in a tenth of the time: fewer iterations and views, SH degree 0",
        "instantsplat" => {
            "InstantSplat's settings: refined poses, high rates, no densification, no virtual views"
        }
        "dropgaussian" => "DropGaussian's settings: 3dgs with uniform dropout, slow densification",
        "d2gs" => {
            "D2GS's settings: as dropgaussian, guided by depth and density; no far-field loss"
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

/// Every key, sorted by name within its section.
///
/// # Errors
/// A preset that is no config.
pub fn keys() -> Result<Vec<Key>> {
    let mut settings = SchemaSettings::default();
    settings.inline_subschemas = true;
    let schema = settings.into_generator().into_root_schema_for::<Config>();
    let presets = PRESETS
        .iter()
        .map(|(name, _)| Config::preset(name)?.tree())
        .collect::<Result<Vec<Value>>>()?;
    let mut keys = Vec::new();
    collect(schema.as_value(), &presets, "", &mut keys)?;
    Ok(keys)
}

fn collect(schema: &Value, values: &[Value], prefix: &str, keys: &mut Vec<Key>) -> Result<()> {
    let Value::Object(properties) = &schema["properties"] else {
        return Err(Error::new(format!("config: `{prefix}` has no keys")));
    };
    for (name, property) in properties {
        let of_name: Vec<Value> = values.iter().map(|value| value[name].clone()).collect();
        let key = format!("{prefix}{name}");
        if property["properties"].is_object() {
            collect(property, &of_name, &format!("{key}."), keys)?;
            continue;
        }
        let doc = property["description"].as_str().unwrap_or_default();
        keys.push(Key {
            doc: doc.split_whitespace().collect::<Vec<_>>().join(" "),
            values: of_name,
            key,
        });
    }
    Ok(())
}
