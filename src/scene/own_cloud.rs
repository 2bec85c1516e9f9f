//! This module finds and reads the cloud that comes with a scene, with its confidences, and tells
//! if it is stale.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::cloud::read_cloud;
use super::{CloudSource, LoadOptions, PointCloud, origin};
use crate::error::{Error, Result};
use crate::files::bytes::read_regular;
use crate::files::npy::read_vector;

/// COLMAP's points are newer than a PLY only by so much: files that are copied together differ a
/// little.
const NEWER: Duration = Duration::from_secs(60);
/// Times as many points are far more.
const FAR_MORE: u64 = 10;

/// Returns the scene's own cloud; `None` only if none is needed.
pub(super) fn own_cloud(
    found: Result<PathBuf>,
    dir: &Path,
    options: &LoadOptions,
) -> Result<Option<PathBuf>> {
    match found {
        Err(_) if !options.needs_cloud => Ok(None),
        Err(e) => Err(e.or_way_out(make_a_cloud(dir))),
        Ok(path) => Ok(Some(path)),
    }
}

/// Says how a scene with cameras and photographs gets a cloud.
pub(super) fn make_a_cloud(dir: &Path) -> String {
    format!(
        "`gspotential scene --cameras {} --weights model.safetensors --out dense.ply` makes a cloud, \
         which `train --cloud dense.ply` takes",
        dir.display()
    )
}

/// Reads the cloud, with the confidences of a file of their own where there is one, as far as it is
/// asked for and came from no test view; `shown` names training and test views. A warning tells what
/// is left out.
pub(super) fn read_points(
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

/// Refuses a cloud of which no point can be used.
pub(super) fn no_point(path: &Path, n_stored: usize) -> Error {
    Error::new(format!(
        "the point cloud has no usable point ({n_stored} in the file)"
    ))
    .at_path(path)
    .way_out("make the cloud again: training starts from it")
}

/// Returns a line if a cloud is taken although COLMAP's own points beside it are newer or far more:
/// files are left behind by earlier reconstructions and by programs that thin them. Text of as many
/// points is what COLMAP's converter makes to be looked at.
pub(super) fn stale(taken: &Path, n_taken: usize) -> Option<String> {
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
