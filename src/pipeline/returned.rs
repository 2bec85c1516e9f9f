//! This module takes images from outside as the targets of virtual views: renders that came back from a network which
//! repairs them, say.
//!
//! `render` writes views with a list of their cameras, `views.json`. An image is the view's whose name it has; a camera
//! that the list has and that is no virtual view of the run becomes one more.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;

use super::Prepared;
use super::posed::MAX_LISTED;
use crate::camera::json::read_cameras;
use crate::camera::{Camera, Frame, Motion};
use crate::error::{Error, Result};
use crate::run::{VirtualImages, file_names};
use crate::scene::{Image, PhotographFile, Scene, find_photographs, read_photograph};
use crate::train::TrainingView;

/// Name of the list of cameras beside rendered images.
pub(super) const VIEWS: &str = "views.json";

/// What virtual views are called at least; `render --views virtual` finds them by it.
const PREFIX: &str = "virtual_";

/// Poses that differ by no more are one: radians, and shares of the sphere's radius.
const SAME_POSE: f64 = 1e-6;

/// The view of an image.
enum Place {
    /// Index into the views that are trained on.
    Trained(usize),
    /// Index into those held out.
    HeldOut(usize),
    /// A view that the run does not have otherwise; world frame.
    New(Camera),
}

impl Prepared {
    /// Replaces the targets of virtual views by the images that are named like them, and adds views for cameras that come
    /// with the images. Every pixel of such a view counts, and its loss is multiplied by the images' weight.
    ///
    /// # Errors
    /// Images that cannot be read, that are of no view, or of another size or pose than their view.
    pub fn take_images(&mut self, scene: &Scene, images: &VirtualImages) -> Result<()> {
        let folder = Path::new(&images.folder);
        let files = find_photographs(&[folder.to_owned()])?;
        let listed = listed(folder)?;
        let places = self.places(scene, &files, &listed, folder)?;
        let decoded: Vec<Result<Image>> = files
            .par_iter()
            .map(|file| Ok(read_photograph(&file.path)?.image))
            .collect();
        let (mut n_held_out, mut n_new) = (0, 0);
        for ((place, file), image) in places.into_iter().zip(&files).zip(decoded) {
            let image = image?;
            let supervision = &mut self.supervision;
            let (camera, weight) = match &place {
                Place::Trained(i) => of(&supervision.virtual_views[*i]),
                Place::HeldOut(i) => of(&supervision.held_out[*i]),
                Place::New(camera) => (self.frame.camera_to_canonical(camera), 1.0),
            };
            check_size(&image, &camera).map_err(|e| e.at_path(&file.path))?;
            let view = TrainingView {
                weight: images.weight * weight,
                ..TrainingView::photograph(camera, &image.texels())
            };
            match place {
                Place::Trained(i) => supervision.virtual_views[i] = view,
                Place::HeldOut(i) => {
                    supervision.held_out[i] = view;
                    n_held_out += 1;
                }
                Place::New(camera) => {
                    supervision.virtual_views.push(view);
                    self.virtual_cameras.push(camera);
                    n_new += 1;
                }
            }
        }
        log::info!(
            "{} virtual views show the images in {}, {n_new} of them beyond those drawn and {n_held_out} held out",
            files.len(),
            folder.display()
        );
        Ok(())
    }

    /// Finds the view of every file.
    fn places(
        &self,
        scene: &Scene,
        files: &[PhotographFile],
        listed: &BTreeMap<String, Camera>,
        folder: &Path,
    ) -> Result<Vec<Place>> {
        let supervision = &self.supervision;
        let own = by_stem(&supervision.virtual_views);
        let held_out = by_stem(&supervision.held_out);
        let taken: Vec<&str> = scene
            .train
            .iter()
            .chain(&scene.test)
            .map(|view| view.camera.name.as_str())
            .collect();
        let mut unknown = Vec::new();
        let mut places = Vec::with_capacity(files.len());
        for file in files {
            let stem = stem_of(&file.name);
            let drawn = match (own.get(&stem), held_out.get(&stem)) {
                (Some(i), _) => Some((Place::Trained(*i), &supervision.virtual_views[*i])),
                (None, Some(i)) => Some((Place::HeldOut(*i), &supervision.held_out[*i])),
                (None, None) => None,
            };
            match (drawn, listed.get(&stem)) {
                (Some((place, view)), camera) => {
                    if let Some(camera) = camera {
                        check_pose(camera, &view.camera, &self.frame)
                            .map_err(|e| e.at_path(&file.path))?;
                    }
                    places.push(place);
                }
                (None, Some(camera)) => {
                    if taken.iter().any(|name| stem_of(name) == stem) {
                        return Err(Error::new(format!("`{stem}` is the name of a photograph"))
                            .at_path(&file.path)
                            .way_out(
                                "render virtual views or a path for this, not photographs' places",
                            ));
                    }
                    let name = match stem.starts_with(PREFIX) {
                        true => stem,
                        false => format!("{PREFIX}{stem}"),
                    };
                    let camera = camera.clone();
                    places.push(Place::New(Camera { name, ..camera }));
                }
                (None, None) => unknown.push(format!("`{}`", file.name)),
            }
        }
        if unknown.is_empty() {
            return Ok(places);
        }
        let n = unknown.len();
        if n > MAX_LISTED {
            unknown.truncate(MAX_LISTED);
            unknown.push("...".to_owned());
        }
        Err(Error::new(format!(
            "{n} images are of no virtual view: {}",
            unknown.join(", ")
        ))
        .at_path(folder)
        .way_out(format!(
            "keep the names that `gspotential render` gave, and for other views than the run's {} virtual ones its {VIEWS} beside \
             the images",
            own.len() + held_out.len()
        )))
    }
}

/// Returns a view's camera and weight.
fn of(view: &TrainingView) -> (Camera, f64) {
    (view.camera.clone(), view.weight)
}

/// Reads the list of cameras beside the images, by the images' names without their suffixes; there may be none.
fn listed(folder: &Path) -> Result<BTreeMap<String, Camera>> {
    let path = folder.join(VIEWS);
    if !path.is_file() {
        return Ok(BTreeMap::new());
    }
    let cameras = read_cameras(&path)?.into_iter();
    Ok(cameras.map(|c| (stem_of(&c.name), c)).collect())
}

/// Returns the indices of views by the names of their files, without suffixes.
fn by_stem(views: &[TrainingView]) -> BTreeMap<String, usize> {
    let names: Vec<&str> = views.iter().map(|v| v.camera.name.as_str()).collect();
    let files = file_names(&names, "png").into_iter().enumerate();
    files.map(|(i, file)| (stem_of(&file), i)).collect()
}

fn stem_of(name: &str) -> String {
    let stem = Path::new(name).file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

fn check_size(image: &Image, camera: &Camera) -> Result<()> {
    let (image, view) = ((image.width, image.height), (camera.width, camera.height));
    if image == view {
        return Ok(());
    }
    Err(Error::new(format!(
        "the image is {}x{} pixels but its view is {}x{}",
        image.0, image.1, view.0, view.1
    ))
    .way_out("scale it to that size"))
}

/// Refuses an image that was rendered from elsewhere than the virtual view of its name lies; `drawn` is canonical.
fn check_pose(rendered: &Camera, drawn: &Camera, frame: &Frame) -> Result<()> {
    let Motion { turn, shift } = frame.camera_to_canonical(rendered).difference(drawn);
    if turn <= SAME_POSE && shift <= SAME_POSE {
        return Ok(());
    }
    Err(Error::new(format!(
        "{VIEWS} has another camera for it than this run, turned by {:.2} degrees and {:.3} R off",
        turn.to_degrees(),
        shift
    ))
    .way_out("train with the scene, preset, seed and --set of the run whose views were rendered"))
}
