//! Shader composition: a stage's source is its file with `#import shared/NAME` lines replaced by
//! `shaders/shared/NAME.wgsl`, behind the constants of [`super::constants`].

use super::constants;

macro_rules! sources {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../shaders/", $name, ".wgsl")))),*]
    };
}

const SHARED: &[(&str, &str)] = sources![
    "shared/view",
    "shared/gaussian",
    "shared/sh",
    "shared/sh_read",
    "shared/tile",
    "shared/loss",
];

/// Every stage's name and source, as written.
pub const STAGES: &[(&str, &str)] = sources![
    "project",
    "bin",
    "scan",
    "sort",
    "rasterize",
    "ssim",
    "loss_sum",
    "rasterize_backward",
    "project_backward",
    "adam",
    "rearrange",
    "reset_opacity",
];

/// The complete WGSL of a stage.
///
/// # Panics
/// On a stage or import that does not exist: a fault in this program.
pub fn compose(stage: &str) -> String {
    let mut out = constants::prelude();
    for line in lookup(STAGES, stage).lines() {
        match line.strip_prefix("#import ") {
            Some(import) => out.push_str(lookup(SHARED, import.trim())),
            None => out.push_str(line),
        }
        out.push('\n');
    }
    out
}

fn lookup(sources: &[(&str, &'static str)], name: &str) -> &'static str {
    let found = sources.iter().find(|(n, _)| *n == name);
    found
        .unwrap_or_else(|| panic!("no shader source named {name}"))
        .1
}
