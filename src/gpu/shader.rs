//! Shader composition: a stage's source is its file with `#import shared/NAME` lines replaced by
//! `shaders/shared/NAME.wgsl`, each file once, and `#repeat` blocks written out, behind the
//! constants of [`super::constants`].

use super::constants;

macro_rules! sources {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../shaders/", $name, ".wgsl")))),*]
    };
}

const SHARED: &[(&str, &str)] = sources![
    "shared/thread",
    "shared/view",
    "shared/splat",
    "shared/splat_gradient",
    "shared/entries",
    "shared/pair_gradient",
    "shared/pair_sums",
    "shared/on_screen",
    "shared/double",
    "shared/gaussian",
    "shared/normal",
    "shared/dropout",
    "shared/sh",
    "shared/sh_mean",
    "shared/whole",
    "shared/tile",
    "shared/thread_tile",
    "shared/group_tile",
    "shared/depth",
    "shared/depth_forward",
    "shared/depth_backward",
    "shared/bin",
    "shared/loss",
    "shared/ssim_windows",
    "shared/ssim",
    "shared/radix",
    "shared/radix_thread",
    "shared/radix_group",
    "shared/scan",
];

/// Every stage's name and source, as written.
pub const STAGES: &[(&str, &str)] = sources![
    "project",
    "radix",
    "radix_workgroup",
    "bin",
    "bin_workgroup",
    "scan",
    "scan_workgroup",
    "tile_ranges",
    "exp2",
    "rasterize",
    "rasterize_workgroup",
    "ssim",
    "ssim_workgroup",
    "loss_sum",
    "rasterize_backward",
    "rasterize_backward_workgroup",
    "sum_pairs",
    "project_backward",
    "pose_backward",
    "project_depth",
    "rasterize_depth",
    "rasterize_depth_workgroup",
    "depth_loss",
    "rasterize_depth_backward",
    "rasterize_depth_backward_workgroup",
    "project_depth_backward",
    "adam",
    "rearrange",
    "reset_opacity",
    "exchange",
];

/// A function that gives kernels the complete WGSL of a stage and an SH degree: [`compose`], or
/// what a test has made of it.
pub type Sources<'a> = &'a (dyn Fn(&str, u32) -> String + Sync);

/// Returns the complete WGSL of a stage, with `SH_DEGREE` for the active degree: a constant,
/// because a software driver runs both sides of every branch. 2^x is the program's polynomial.
///
/// # Panics
/// On a stage, import or count that does not exist: a fault in this program.
pub fn compose(stage: &str, sh_degree: u32) -> String {
    compose_with(stage, sh_degree, false)
}

/// Does the same as [`compose`] with 2^x as the adapter has it.
///
/// # Panics
/// As [`compose`].
pub fn compose_with_exp2_of_adapter(stage: &str, sh_degree: u32) -> String {
    compose_with(stage, sh_degree, true)
}

fn compose_with(stage: &str, sh_degree: u32, exp2_of_adapter: bool) -> String {
    let mut source = String::new();
    import(lookup(STAGES, stage), &mut Vec::new(), &mut source);
    let lines: Vec<&str> = source.lines().collect();
    constants::prelude(sh_degree, exp2_of_adapter) + &unroll(&lines)
}

/// Lists every shader that a driver gets: its name, and its complete WGSL. A stage that depends on the active
/// SH degree has one a degree.
pub fn programs() -> Vec<(String, String)> {
    let of_stage = |(stage, _): &(&str, &str)| {
        let source = compose(stage, 0);
        // The prelude names the degree once, whoever asks for it.
        let by_degree = source.matches("SH_DEGREE").count() > 1;
        match by_degree {
            false => vec![((*stage).to_owned(), source)],
            true => (0..4)
                .map(|degree| (format!("{stage}_degree_{degree}"), compose(stage, degree)))
                .collect(),
        }
    };
    STAGES.iter().flat_map(of_stage).collect()
}

/// Appends `text` to `source`, with each file that it imports in place of the first line that asks
/// for it; `imported` names the files that are there already. A shared file imports what it needs.
fn import<'a>(text: &'a str, imported: &mut Vec<&'a str>, source: &mut String) {
    for line in text.lines() {
        match line.strip_prefix("#import ").map(str::trim) {
            Some(name) if imported.contains(&name) => {}
            Some(name) => {
                imported.push(name);
                import(lookup(SHARED, name), imported, source);
            }
            None => {
                source.push_str(line);
                source.push('\n');
            }
        }
    }
}

/// Writes the lines between `#repeat NAME COUNT` and `#end` out COUNT times, `{NAME}` replaced by
/// 0, 1, ...: drivers do not unroll a loop over an array into registers, names they do.
fn unroll(lines: &[&str]) -> String {
    let mut out = String::new();
    let mut i = 0;
    while i < lines.len() {
        let Some(head) = lines[i].trim().strip_prefix("#repeat ") else {
            out.push_str(lines[i]);
            out.push('\n');
            i += 1;
            continue;
        };
        let (name, count) = head
            .split_once(' ')
            .unwrap_or_else(|| panic!("#repeat {head}"));
        let count = constants::repeat_count(count);
        let mut depth = 1;
        let length = lines[i + 1..]
            .iter()
            .position(|line| {
                depth += i32::from(line.trim().starts_with("#repeat "));
                depth -= i32::from(line.trim() == "#end");
                depth == 0
            })
            .unwrap_or_else(|| panic!("#repeat {head} without #end"));
        let body = unroll(&lines[i + 1..][..length]);
        for value in 0..count {
            out.push_str(&body.replace(&format!("{{{name}}}"), &value.to_string()));
        }
        i += length + 2;
    }
    out
}

fn lookup(sources: &[(&str, &'static str)], name: &str) -> &'static str {
    let found = sources.iter().find(|(n, _)| *n == name);
    found
        .unwrap_or_else(|| panic!("no shader source named {name}"))
        .1
}
