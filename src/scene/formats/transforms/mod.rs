//! This module reads `transforms.json` of nerfstudio and instant-ngp, and NeRF's Blender scenes
//! (`transforms_train.json`, `transforms_test.json`).
//!
//! `transform_matrix` is camera-to-world with OpenGL's camera axes: x right, y up, z backwards.
//! Intrinsics stand at a frame or, for all that lack them, at the top.

mod frame;
mod nan;

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use self::frame::{Optics, SCALE_TOLERANCE, pose};
use self::nan::quoted_nan;
use super::{Probe, first_file};
use crate::error::{Error, Result, without_mark};
use crate::files::bytes::read_regular;
use crate::scene::LoadOptions;
use crate::scene::image_file::size_of;
use crate::scene::images::check_relative;
use crate::scene::layout::{Layout, NamedSplit, PosedCamera};
use crate::scene::lookup::{Folder, Lookup};
use crate::scene::split::uniform;

type Object = Map<String, Value>;

pub(super) fn find(dir: &Path, _: &LoadOptions) -> Result<Option<Probe>> {
    let probe = Probe::new(dir, "transforms.json");
    Ok(probe.path.is_file().then_some(probe))
}

pub(super) fn read(dir: &Path, probe: &Probe, _: &LoadOptions) -> Result<Layout> {
    let in_file = |e: Error| e.at_path(&probe.path);
    let file = read_object(&probe.path)?;
    let folder = Folder::new(dir);
    let mut views = Views::default();
    views.add((dir, &folder), &file).map_err(in_file)?;
    views.check().map_err(in_file)?;
    let split = read_split(&folder, &file).map_err(in_file)?;
    let cloud = find_cloud(dir, &file).map_err(in_file);
    Ok(views.layout(dir, probe, split, cloud))
}

/// Looks for the marker of NeRF's Blender scenes.
pub(super) fn find_blender(dir: &Path, _: &LoadOptions) -> Result<Option<Probe>> {
    let probe = Probe::new(dir, "transforms_train.json");
    Ok(probe.path.is_file().then_some(probe))
}

/// Reads a Blender scene. The training views are drawn from those of the training file, the test
/// views from the other.
pub(super) fn read_blender(dir: &Path, probe: &Probe, options: &LoadOptions) -> Result<Layout> {
    let folder = Folder::new(dir);
    let mut views = Views::default();
    let mut drawn = Vec::new();
    for (name, n) in [
        ("transforms_train.json", options.n_train),
        ("transforms_test.json", options.n_test),
    ] {
        let path = dir.join(name);
        let first = views.cameras.len();
        let file = read_object(&path)?;
        views
            .add((dir, &folder), &file)
            .map_err(|e| e.at_path(&path))?;
        let mut names: Vec<String> = views.cameras[first..]
            .iter()
            .map(|view| view.camera.name.clone())
            .collect();
        names.sort();
        drawn.push(uniform(&names, n));
    }
    views.check().map_err(|e| e.at_path(&probe.path))?;
    let cloud = find_cloud(dir, &Object::new()).map_err(|e| e.at_path(dir));
    let split = NamedSplit {
        test: drawn.pop(),
        train: drawn.pop().unwrap_or_default(),
        place: probe.path.clone(),
    };
    Ok(views.layout(dir, probe, Some(split), cloud))
}

fn read_object(path: &Path) -> Result<Object> {
    serde_json::from_slice(&quoted_nan(without_mark(&read_regular(path)?)))
        .map_err(|e| Error::new(format!("not a JSON object: {e}")).at_path(path))
}

/// The frames that can be used, under their paths relative to the scene folder.
#[derive(Default)]
struct Views {
    cameras: Vec<PosedCamera>,
    /// Frames of no stated size whose image is missing.
    n_without_image: usize,
    /// Frames without a pose, or with one that is not finite: they could not be posed.
    n_without_pose: usize,
    /// Poses that scale by more than rounding explains.
    n_scaled: usize,
}

impl Views {
    fn add(&mut self, place: (&Path, &Folder), file: &Object) -> Result<()> {
        let Some(Value::Array(frames)) = file.get("frames") else {
            return Err(Error::new("there is no list `frames`"));
        };
        for (i, frame) in frames.iter().enumerate() {
            self.add_frame(place, file, frame)
                .map_err(|e| e.at(format_args!("frame {i}")))?;
        }
        Ok(())
    }

    fn add_frame(
        &mut self,
        (dir, folder): (&Path, &Folder),
        file: &Object,
        frame: &Value,
    ) -> Result<()> {
        let frame = frame
            .as_object()
            .ok_or_else(|| Error::new("not an object"))?;
        let name = match frame.get("file_path") {
            Some(Value::String(path)) => with_suffix(folder, relative(path)?),
            _ => return Err(Error::new("there is no `file_path`")),
        };
        let Some(pose) = pose(frame.get("transform_matrix"))? else {
            self.n_without_pose += 1;
            return Ok(());
        };
        let optics = Optics { frame, file };
        let size = match (optics.size()?, folder.find(&name, |_| true)) {
            (Some(size), _) => size,
            (None, Lookup::Found(image, _)) => {
                let (width, height) = size_of(&dir.join(image))?;
                [f64::from(width), f64::from(height)]
            }
            (None, Lookup::Unread(_) | Lookup::Missing) => {
                self.n_without_image += 1;
                return Ok(());
            }
        };
        let intrinsics = optics.intrinsics(size)?;
        self.n_scaled += usize::from((pose.scale - 1.0).abs() > SCALE_TOLERANCE);
        let translation = -(pose.rotation * pose.position);
        let mut posed = intrinsics.posed(name, pose.rotation, translation);
        posed.mask = mask(dir, folder, frame)?;
        self.cameras.push(posed);
        Ok(())
    }

    /// Refuses what the frames are together.
    fn check(&self) -> Result<()> {
        let mut names: Vec<&str> = self.cameras.iter().map(|v| &*v.camera.name).collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            let name = twice[0].escape_debug();
            return Err(Error::new(format!("image `{name}` has two frames")));
        }
        if names.is_empty() {
            return Err(Error::new(format!(
                "no frame can be used ({} have neither a size nor an image, {} no pose)",
                self.n_without_image, self.n_without_pose
            )));
        }
        Ok(())
    }

    /// Names images relative to the folder that holds them all, as COLMAP does.
    fn layout(
        mut self,
        dir: &Path,
        probe: &Probe,
        mut split: Option<NamedSplit>,
        cloud: Result<PathBuf>,
    ) -> Layout {
        let mut image_dir = dir.to_owned();
        let first_folder = self.cameras.first().and_then(|view| {
            let (folder, _) = view.camera.name.split_once('/')?;
            Some(format!("{folder}/"))
        });
        if let Some(folder) = first_folder
            && self
                .cameras
                .iter()
                .all(|v| v.camera.name.starts_with(&folder))
        {
            image_dir.push(&folder);
            let lists = split
                .iter_mut()
                .flat_map(|split| std::iter::once(&mut split.train).chain(&mut split.test));
            let listed = lists.flatten();
            let own = self.cameras.iter_mut().map(|view| &mut view.camera.name);
            for name in own.chain(listed) {
                if let Some(rest) = name.strip_prefix(&folder) {
                    *name = rest.to_owned();
                }
            }
        }
        let mut warnings = Vec::new();
        for (n, what) in [
            (
                self.n_without_image,
                "frames have no image and are not used",
            ),
            (
                self.n_without_pose,
                "frames have no pose, or one that is not finite, and are not used",
            ),
            (self.n_scaled, "poses scale as well as rotate: normalised"),
        ] {
            if n > 0 {
                warnings.push(format!("{n} {what}"));
            }
        }
        Layout {
            source: probe.name.clone(),
            cameras: self.cameras,
            unusable: Vec::new(),
            image_dir,
            cloud,
            split,
            warnings,
        }
    }
}

/// Returns the name of an image that may come without its suffix, as NeRF's Blender scenes have
/// them: that of the file, or else a PNG's.
fn with_suffix(folder: &Folder, name: String) -> String {
    if name.rsplit('/').next().unwrap_or(&name).contains('.') {
        return name;
    }
    match folder.find(&name, |_| true) {
        Lookup::Found(file, _) => file,
        Lookup::Unread(_) | Lookup::Missing => name + ".png",
    }
}

/// Returns the file of a frame's mask, where it names one.
fn mask(dir: &Path, folder: &Folder, frame: &Object) -> Result<Option<PathBuf>> {
    let here = |e: Error| e.at("`mask_path`");
    let name = match frame.get("mask_path") {
        None | Some(Value::Null) => return Ok(None),
        Some(Value::String(path)) => with_suffix(folder, relative(path).map_err(here)?),
        Some(_) => return Err(here(Error::new("not a file name"))),
    };
    match folder.find(&name, |_| true) {
        Lookup::Found(file, _) => Ok(Some(dir.join(file))),
        Lookup::Unread(_) | Lookup::Missing => Err(here(
            Error::new(format!("there is no file `{}`", name.escape_debug()))
                .way_out("put the masks there, or take `mask_path` out"),
        )),
    }
}

/// Returns a path in the scene folder without `./` in front, and with `/` between.
fn relative(path: &str) -> Result<String> {
    let path = path.replace('\\', "/");
    let mut name = path.as_str();
    while let Some(rest) = name.strip_prefix("./") {
        name = rest;
    }
    check_relative("path", name)?;
    Ok(name.to_owned())
}

/// Reads nerfstudio's lists of views.
fn read_split(folder: &Folder, file: &Object) -> Result<Option<NamedSplit>> {
    let list = |key: &str| -> Result<Option<Vec<String>>> {
        let Some(value) = file.get(key) else {
            return Ok(None);
        };
        let names: Vec<String> = serde_json::from_value(value.clone())
            .map_err(|_| Error::new(format!("`{key}` is not a list of file names")))?;
        let name = |name: &String| Ok(with_suffix(folder, relative(name)?));
        let names: Result<_> = names.iter().map(name).collect();
        names.map(Some).map_err(|e| e.at(format_args!("`{key}`")))
    };
    let test = match list("test_filenames")? {
        None => list("val_filenames")?,
        test => test,
    };
    let Some(train) = list("train_filenames")? else {
        return match test {
            None => Ok(None),
            Some(_) => Err(Error::new(
                "`train_filenames` is missing beside the other lists",
            )),
        };
    };
    Ok(Some(NamedSplit {
        train,
        test,
        place: PathBuf::from("transforms.json"),
    }))
}

fn find_cloud(dir: &Path, file: &Object) -> Result<PathBuf> {
    if let Some(path) = file.get("ply_file_path").filter(|path| !path.is_null()) {
        let here = |e: Error| e.at("`ply_file_path`");
        let path = path
            .as_str()
            .ok_or_else(|| here(Error::new("not a file name")))?;
        let cloud = dir.join(relative(path).map_err(here)?);
        return first_file(&[cloud]).ok_or_else(|| {
            here(Error::new(format!(
                "there is no file `{}`",
                path.escape_debug()
            )))
        });
    }
    first_file(&["points3D.ply", "points.ply", "sparse_pc.ply"].map(|name| dir.join(name)))
        .ok_or_else(|| {
            Error::new("there is no point cloud").way_out(
                "add points3D.ply in the frame of the poses, or name one in `ply_file_path`; `gspotential scene --cameras` makes one of the photographs",
            )
        })
}
