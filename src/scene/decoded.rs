//! This module decodes the photographs of a scene into views, and counts what a user must know of
//! them.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::decode::{Decoded, decode};
use super::fitted::Fit;
use super::images::PosedImage;
use super::masks::{AlphaIs, Masks, Unbelieved};
use super::undistort::Cut;
use super::window::Window;
use super::{LoadOptions, Outside, View};
use crate::error::Result;

/// Decodes the photographs in order. Alpha channels say that a subject is cut out, unless all of
/// them are one and the same window, in which case what they leave out is ignored.
pub(super) fn decode_all(
    chosen: &[&PosedImage],
    masks: &Masks,
    options: &LoadOptions,
) -> Vec<Result<Decoded>> {
    let as_if = |alpha: AlphaIs| -> Vec<Result<Decoded>> {
        let views = chosen.par_iter();
        views.map(|v| decode(v, masks, alpha, options)).collect()
    };
    let decoded = as_if(AlphaIs::CutOut);
    let all = decoded.iter().filter_map(|d| d.as_ref().ok());
    let windows: Vec<Option<Window>> = all.filter_map(|d| d.window).collect();
    if !Window::are_one(&windows) {
        return decoded;
    }
    // The background has been put behind them.
    drop(decoded);
    as_if(AlphaIs::Window)
}

/// Returns the views in order, or the first error in order.
pub(super) fn views(
    decoded: Vec<Result<Decoded>>,
    warnings: &mut Vec<String>,
) -> Result<Vec<View>> {
    let mut views = Vec::with_capacity(decoded.len());
    let (mut rescaled, mut seen, mut cut) = (Vec::new(), Vec::new(), Vec::new());
    let (mut turned, mut windows) = (Vec::new(), Vec::new());
    let mut unbelieved: BTreeMap<Unbelieved, Vec<String>> = BTreeMap::new();
    for decoded in decoded {
        let decoded = decoded?;
        let (name, (width, height)) = (&decoded.view.camera.name, decoded.stated);
        if decoded.is_turned {
            turned.push(name.clone());
        }
        let outside = decoded.view.mask.as_ref().map(|mask| mask.outside);
        if decoded.window.is_some() && outside == Some(Outside::Ignored) {
            windows.push(name.clone());
        }
        if let Some(why) = decoded.unbelieved {
            unbelieved.entry(why).or_default().push(name.clone());
        }
        let example = format!("`{name}`, camera {width}x{height}");
        match decoded.fit {
            Fit::Same => {}
            Fit::Rescaled => rescaled.push(example),
            Fit::Seen(program) => seen.push((program, example)),
        }
        if let Some(Cut { angles, shown }) = decoded.cut {
            let [across, down] = angles;
            cut.push(format!(
                "{across:.0} x {down:.0} degrees, which leaves out {:.0} % of the photograph: `{name}`",
                100.0 * (1.0 - shown)
            ));
        }
        views.push(decoded.view);
    }
    let more = |n: usize| if n > 1 { ", ..." } else { "" };
    if let Some(example) = rescaled.first() {
        let n = rescaled.len();
        warnings.push(format!(
            "{n} images are not of their camera's size, intrinsics rescaled: {example}{}",
            more(n)
        ));
    }
    if let Some((program, example)) = seen.first() {
        let n = seen.len();
        warnings.push(format!(
            "{n} cameras are of what {program} sees of a photograph, mapped to all of it: {example}{}",
            more(n)
        ));
    }
    if let Some(example) = cut.first() {
        let n = cut.len();
        warnings.push(format!(
            "{n} fisheye photographs became pinhole images of {example}{}",
            more(n)
        ));
    }
    warnings.extend(unbelieved.iter().map(|(why, names)| why.line(names)));
    if let Some(example) = windows.first() {
        warnings.push(format!(
            "the alpha channels of {} photographs leave out the same border (`{}`{}), which is ignored: if a \
             subject is cut out, say so with `--set scene.outside_mask=background`",
            windows.len(),
            example.escape_debug(),
            more(windows.len())
        ));
    }
    if let Some(example) = turned.first() {
        warnings.push(format!(
            "{} photographs have an EXIF orientation (`{}`{}): it is not applied, so poses must be those of \
             the pixels as stored",
            turned.len(),
            example.escape_debug(),
            if turned.len() > 1 { ", ..." } else { "" }
        ));
    }
    Ok(views)
}
