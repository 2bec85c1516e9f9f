//! This module makes a [`Scene`] of a scene folder: the format's reader finds what there is, the
//! rest is shared.

use std::path::Path;

use super::builtin::{self, BuiltinOptions, Imperfections};
use super::cloud::{clean, random_like, read_cloud};
use super::cut_out::keep_within_masks;
use super::decoded::{decode_all, views};
use super::formats::{self, confidence_of};
use super::images::{Folders, PosedImage, Poses, match_images};
use super::inverted::{are_inverted, turned};
use super::layout::PosedCamera;
use super::masks::Masks;
use super::own_cloud::{make_a_cloud, no_point, own_cloud, read_points, stale};
use super::priors::read_priors;
use super::protocol::PoseProtocol;
use super::split::{choose, regroup};
use super::{CloudSource, LoadOptions, Outside, PointCloud, Scene};
use crate::camera::Camera;
use crate::config::OutsideMask;
use crate::error::{Error, Result};

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
    if options.cloud == Some(CloudSource::Exact) {
        return Err(Error::usage("only the built-in scene has an exact cloud")
            .at_path(dir)
            .way_out("name a file with --cloud, or leave it out for the scene's own"));
    }
    let layout = formats::read(dir, options)?;
    let cloud_path = match &options.cloud {
        Some(CloudSource::File(path)) => Some(path.clone()),
        _ => own_cloud(layout.cloud, dir, options)?,
    };
    let confidence_path = cloud_path.as_deref().and_then(confidence_of);
    let mut warnings = layout.warnings;
    let poses = Poses {
        cameras: layout.cameras,
        unusable: layout.unusable,
    };
    let folders = Folders {
        scene: dir,
        images: &layout.image_dir,
    };
    let matched = match_images(poses, folders, &mut warnings)?;
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
    if let Some(wanted) = &options.priors {
        let distorted = chosen[..train.len()]
            .iter()
            .map(|v| v.posed.distortion.is_some());
        read_priors(dir, &mut train, &distorted.collect::<Vec<bool>>(), wanted)?;
    }
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

/// Makes the built-in scene `width` pixels wide, with the views and the cloud that are asked for.
/// Fewer training views than it has are taken uniformly around it; its cloud stays.
///
/// # Errors
///
/// Views that it does not have, or a cloud file that cannot be used.
pub fn load_builtin(width: u32, options: &LoadOptions) -> Result<Scene> {
    no_priors(options)?;
    let scene = builtin::scene(&builtin_options(width, options));
    let mut scene = as_asked(scene, options)?;
    randomise(&mut scene, options);
    Ok(scene)
}

/// Does so for the built-in object; what its masks leave out is the background unless the options say otherwise.
///
/// # Errors
///
/// As [`load_builtin`], and a cloud of which no point lies within all masks.
pub fn load_object(width: u32, options: &LoadOptions) -> Result<Scene> {
    no_priors(options)?;
    let outside = match options.outside_mask {
        OutsideMask::Auto | OutsideMask::Background => Outside::Background,
        OutsideMask::Ignored => Outside::Ignored,
        OutsideMask::Kept => Outside::Kept,
    };
    let made = builtin_options(width, options);
    let scene = builtin::object(&made, outside, options.background);
    let mut scene = as_asked(scene, options)?;
    let Scene {
        cloud,
        train,
        warnings,
        ..
    } = &mut scene;
    scene.whole_cloud = keep_within_masks(cloud, train, warnings);
    if options.needs_cloud && scene.cloud.is_empty() {
        return Err(Error::new(
            "no point of the cloud lies within the masks of all training views",
        ));
    }
    randomise(&mut scene, options);
    Ok(scene)
}

fn no_priors(options: &LoadOptions) -> Result<()> {
    if options.priors.is_some() {
        return Err(
            Error::usage("the built-in scene has no files of depths and normals")
                .way_out("take `--set prior.source=cloud`"),
        );
    }
    Ok(())
}

fn builtin_options(width: u32, options: &LoadOptions) -> BuiltinOptions {
    BuiltinOptions {
        width,
        n_test: options.n_test,
        cloud_views: match options.cloud {
            Some(CloudSource::Views(n)) => n,
            _ => BuiltinOptions::default().cloud_views,
        },
        imperfections: match options.cloud {
            Some(CloudSource::Exact) => Imperfections::NONE,
            _ => Imperfections::default(),
        },
        ..BuiltinOptions::default()
    }
}

/// Gives a built-in scene the cloud and the views that are asked for.
fn as_asked(mut scene: Scene, options: &LoadOptions) -> Result<Scene> {
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
        Some(CloudSource::Random | CloudSource::Views(_) | CloudSource::Exact) | None => {}
    }
    regroup(&mut scene, options)?;
    Ok(scene)
}

/// Makes the cloud random where that is asked for.
fn randomise(scene: &mut Scene, options: &LoadOptions) {
    if options.cloud == Some(CloudSource::Random) {
        scene.cloud = random_like(&scene.cloud, options.seed);
        scene.whole_cloud = None;
    }
}

/// Returns the folder's own name, also for `.` and `..`.
fn folder_name(dir: &Path) -> String {
    let full = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    full.file_name()
        .map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned())
}
