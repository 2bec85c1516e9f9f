//! This module makes a [`Scene`] of a scene folder: the format's reader finds what there is, the
//! rest is shared.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rayon::prelude::*;

use super::builtin::{self, BuiltinOptions};
use super::cloud::{clean, random_like, read_cloud};
use super::cut_out::keep_within_masks;
use super::decode::{Decoded, decode};
use super::fitted::Fit;
use super::formats::{self, confidence_of};
use super::images::{PosedImage, match_images};
use super::inverted::{are_inverted, turned};
use super::layout::PosedCamera;
use super::masks::{AlphaIs, Masks, Unbelieved};
use super::origin;
use super::protocol::PoseProtocol;
use super::split::{choose, regroup};
use super::undistort::Cut;
use super::window::Window;
use super::{CloudSource, LoadOptions, Outside, PointCloud, Scene, View};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::files::bytes::read_regular;
use crate::files::npy::read_vector;

/// COLMAP's points are newer than a PLY only by so much: files that are copied together differ a
/// little.
const NEWER: Duration = Duration::from_secs(60);
/// Times as many points are far more.
const FAR_MORE: u64 = 10;

/// Loads the scene in the folder `dir`: poses, intrinsics and cloud in the format that is found
/// there, the split, and the photographs of the training and test views, scaled as asked.
///
/// # Errors
///
/// Everything that keeps the scene from being trained on, naming the file and the place in it.
/// What can be left out is, with a counted line in [`Scene::warnings`].
pub fn load(dir: &Path, options: &LoadOptions) -> Result<Scene> {
    if options.max_width == 0 || options.max_size == Some(0) {
        return Err(Error::usage("images cannot be scaled down to 0 pixels"));
    }
    if !dir.is_dir() {
        return Err(Error::new("no such scene folder")
            .at_path(dir)
            .way_out("give a folder with `images/` and a COLMAP model"));
    }
    let layout = formats::read(dir, options)?;
    let cloud_path = match &options.cloud {
        Some(CloudSource::File(path)) => Some(path.clone()),
        _ => own_cloud(layout.cloud, dir, options)?,
    };
    let confidence_path = cloud_path.as_deref().and_then(confidence_of);
    let mut warnings = layout.warnings;
    let posed = (layout.cameras, layout.unusable);
    let matched = match_images(posed, (dir, &layout.image_dir), &mut warnings)?;
    let split = choose(dir, &matched, layout.split, options, &mut warnings)?;

    // The cloud is read while the images are decoded; both are done before either may fail,
    // so that the error does not depend on which was faster.
    let chosen: Vec<&PosedImage> = split
        .train
        .iter()
        .chain(&split.test)
        .map(|&i| &matched.views[i])
        .collect();
    let names: Vec<&str> = chosen
        .iter()
        .map(|v| v.posed.camera.name.as_str())
        .collect();
    let shown = names.split_at(split.train.len());
    let masks = Masks::of(dir);
    let (cloud, decoded) = rayon::join(
        || match &cloud_path {
            Some(path) => read_points(path, confidence_path.as_deref(), &options.cloud, shown),
            None => Ok((PointCloud::default(), None)),
        },
        || decode_all(&chosen, &masks, options),
    );
    let by_folder = chosen.iter().filter(|v| v.posed.mask.is_none());
    warnings.extend(masks.missing(by_folder.map(|v| v.posed.camera.name.as_str())));
    let (mut cloud, left_out) = cloud?;
    warnings.extend(left_out);
    let mut train = views(decoded, &mut warnings)?;
    let mut test = train.split_off(split.train.len());
    let mut cameras: Vec<Camera> = matched
        .views
        .iter()
        .map(|v| v.posed.camera.clone())
        .collect();
    if are_inverted(&train, &cloud) {
        let shown = train.iter_mut().chain(&mut test);
        for camera in shown.map(|view| &mut view.camera).chain(&mut cameras) {
            *camera = turned(camera);
        }
        warnings.push(
            "the poses fit the photographs only when they are read as camera-to-world, so they \
             are: the program that wrote them has them the wrong way round"
                .to_owned(),
        );
    }

    let count = |has: fn(&PosedCamera) -> bool| chosen.iter().filter(|v| has(&v.posed)).count();
    let n_distorted = count(|posed| posed.distortion.is_some());
    let pose_protocol = protocol(count(|posed| posed.interpolated), &mut warnings);
    let n_stored = cloud.len();
    if let (None, Some(path)) = (&options.cloud, &cloud_path) {
        warnings.extend(stale(path, n_stored));
    }
    clean(&mut cloud, &cameras, &mut warnings);
    if let (true, true, Some(path)) = (options.needs_cloud, cloud.is_empty(), &cloud_path) {
        return Err(no_point(path, n_stored).way_out(make_a_cloud(dir)));
    }
    let mut whole_cloud = keep_within_masks(&mut cloud, &train, &mut warnings);
    if let (true, true, Some(path)) = (options.needs_cloud, cloud.is_empty(), &cloud_path) {
        return Err(Error::new("no point of the cloud lies within the masks of all training views")
            .at_path(path)
            .way_out("masks are white where the subject is, and cloud and poses must share one frame; `--set scene.outside_mask=ignored` keeps all points"));
    }
    let random = options.cloud == Some(CloudSource::Random);
    if random {
        cloud = random_like(&cloud, options.seed);
        whole_cloud = None;
    }
    let relative = |path: &Path| path.strip_prefix(dir).unwrap_or(path).display().to_string();
    let mut source = layout.source;
    if n_distorted > 0 {
        source += &format!(", {n_distorted} images undistorted");
    }
    let how = match &options.cloud {
        Some(CloudSource::Random) => "random as far as ",
        Some(CloudSource::Views(1)) => "of the first view in ",
        Some(CloudSource::Views(n)) => &format!("of the first {n} views in "),
        _ => "",
    };
    source += &match &cloud_path {
        Some(path) => format!(", cloud {how}{}", relative(path)),
        None => ", no cloud".to_owned(),
    };
    if let Some(path) = &confidence_path {
        source += &format!(", confidence {}", relative(path));
    }
    Ok(Scene {
        name: folder_name(dir),
        source,
        train,
        test,
        cloud,
        whole_cloud,
        pose_protocol,
        warnings,
    })
}

/// Decodes the photographs in order. Alpha channels say that a subject is cut out, unless all of
/// them are one and the same window, in which case what they leave out is ignored.
fn decode_all(
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

/// Returns the scene's own cloud; `None` only if none is needed.
fn own_cloud(found: Result<PathBuf>, dir: &Path, options: &LoadOptions) -> Result<Option<PathBuf>> {
    match found {
        Err(_) if !options.needs_cloud => Ok(None),
        Err(e) => Err(e.or_way_out(make_a_cloud(dir))),
        Ok(path) => Ok(Some(path)),
    }
}

/// Says how a scene with cameras and photographs gets a cloud.
fn make_a_cloud(dir: &Path) -> String {
    format!(
        "`gspotential scene --cameras {} --weights model.safetensors --out dense.ply` makes a cloud, \
         which `train --cloud dense.ply` takes",
        dir.display()
    )
}

/// Returns the protocol of the poses, and warns if some were only interpolated.
fn protocol(n_interpolated: usize, warnings: &mut Vec<String>) -> PoseProtocol {
    if n_interpolated == 0 {
        return PoseProtocol::SharedFrame;
    }
    warnings.push(format!(
        "{n_interpolated} views have poses that were only interpolated between others: their \
         photographs show something else, and figures at them say little"
    ));
    PoseProtocol::Interpolated
}

/// Reads the cloud, with the confidences of a file of their own where there is one, as far as it is
/// asked for and came from no test view; `shown` names training and test views. A warning tells what
/// is left out.
fn read_points(
    path: &Path,
    confidence: Option<&Path>,
    source: &Option<CloudSource>,
    shown: (&[&str], &[&str]),
) -> Result<(PointCloud, Option<String>)> {
    let mut cloud = read_cloud(path)?;
    if let Some(path) = confidence {
        let values = read_vector(&read_regular(path)?).map_err(|e| e.at_path(path))?;
        if values.len() != cloud.len() {
            return Err(Error::new(format!(
                "{} confidences for a cloud of {} points",
                values.len(),
                cloud.len()
            ))
            .at_path(path)
            .way_out("make both again, or remove the confidences"));
        }
        cloud.confidence = Some(values);
    }
    let first = match source {
        Some(CloudSource::Views(n)) => Some(*n),
        _ => None,
    };
    let Some(kept) = origin::kept(path, first, shown)? else {
        return Ok((cloud, None));
    };
    let n = cloud.len();
    cloud.retain(&kept);
    let left_out = n - cloud.len();
    let told = (first.is_none() && left_out > 0).then(|| {
        format!(
            "{left_out} of {n} points come from the depth of test views: left out, as test views \
             must not shape what is trained"
        )
    });
    Ok((cloud, told))
}

/// Makes the built-in scene `width` pixels wide, with the views and the cloud that are asked for.
/// Fewer training views than it has are taken uniformly around it; its cloud stays.
///
/// # Errors
///
/// Views that it does not have, or a cloud file that cannot be used.
pub fn load_builtin(width: u32, options: &LoadOptions) -> Result<Scene> {
    let mut scene = builtin::scene(&BuiltinOptions {
        width,
        n_test: options.n_test,
        cloud_views: match options.cloud {
            Some(CloudSource::Views(n)) => n,
            _ => BuiltinOptions::default().cloud_views,
        },
        ..BuiltinOptions::default()
    });
    match &options.cloud {
        Some(CloudSource::File(path)) => {
            let mut cloud = read_cloud(path)?;
            let views = scene.train.iter().chain(&scene.test);
            let cameras: Vec<Camera> = views.map(|view| view.camera.clone()).collect();
            let n_stored = cloud.len();
            clean(&mut cloud, &cameras, &mut scene.warnings);
            if cloud.is_empty() {
                return Err(no_point(path, n_stored));
            }
            scene.cloud = cloud;
        }
        Some(CloudSource::Random) => scene.cloud = random_like(&scene.cloud, options.seed),
        Some(CloudSource::Views(_)) | None => {}
    }
    regroup(&mut scene, options)?;
    Ok(scene)
}

fn no_point(path: &Path, n_stored: usize) -> Error {
    Error::new(format!(
        "the point cloud has no usable point ({n_stored} in the file)"
    ))
    .at_path(path)
    .way_out("make the cloud again: training starts from it")
}

/// Returns the views in order, or the first error in order.
fn views(decoded: Vec<Result<Decoded>>, warnings: &mut Vec<String>) -> Result<Vec<View>> {
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

/// Returns a line if a cloud is taken although COLMAP's own points beside it are newer or far more:
/// files are left behind by earlier reconstructions and by programs that thin them. Text of as many
/// points is what COLMAP's converter makes to be looked at.
fn stale(taken: &Path, n_taken: usize) -> Option<String> {
    let changed = |path: &Path| std::fs::metadata(path).ok()?.modified().ok();
    let of = |name: &str| {
        let beside = taken.with_file_name(name);
        let n_beside = n_points(&beside)?;
        let age = changed(&beside)?.duration_since(changed(taken)?).ok();
        let is_newer = age.is_some_and(|age| age >= NEWER);
        let is_larger = n_beside >= FAR_MORE.saturating_mul(n_taken as u64);
        let how = match (is_newer, is_larger) {
            _ if beside == taken => return None,
            _ if name.ends_with("txt") && n_beside == n_taken as u64 => return None,
            (true, true) => "is newer and has far more points",
            (true, false) => "is newer",
            (false, true) => "has far more points",
            (false, false) => return None,
        };
        Some(format!(
            "`{name}` beside `{}` {how} ({n_beside} beside {n_taken}); `--cloud {name}` takes it",
            taken.file_name()?.to_string_lossy().escape_debug()
        ))
    };
    ["points3D.bin", "points3D.txt"].into_iter().find_map(of)
}

/// Returns the number of points that a file of COLMAP's begins with.
fn n_points(path: &Path) -> Option<u64> {
    let mut file = File::open(path).ok()?;
    if path.extension()? == "bin" {
        let mut count = [0; 8];
        file.read_exact(&mut count).ok()?;
        return Some(u64::from_le_bytes(count));
    }
    let mut head = [0; 512];
    let n = file.read(&mut head).ok()?;
    let head = String::from_utf8_lossy(&head[..n]);
    let (_, count) = head.split_once("# Number of points: ")?;
    let digits = count.split(|c: char| !c.is_ascii_digit()).next()?;
    digits.parse().ok()
}

/// Returns the folder's own name, also for `.` and `..`.
fn folder_name(dir: &Path) -> String {
    let full = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    full.file_name()
        .map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned())
}
