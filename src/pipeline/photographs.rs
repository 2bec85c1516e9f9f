//! This module turns photographs into a scene folder, by the network that finds depth and cameras.

use std::fs;
use std::path::{Path, PathBuf};

use crate::camera::{Camera, check_lens};
use crate::dense::{self, CloudOptions, DepthMap};
use crate::error::{Error, Result};
use crate::files::{create_dir, read_file, write_file};
use crate::prior::{self, DOWNLOAD, Images, Model, Network, Outputs, Prediction, prepare};
use crate::scene::{
    Image, LoadOptions, PhotographFile, PointCloud, SceneSource, find_photographs, read_photograph,
    thin, write_cloud, write_model,
};
use crate::terminal::progress::Progress;

/// Views beyond which the network is asked for more than it saw in training.
const MANY_VIEWS: usize = 18;
/// Disagreement between photographs beyond which a scene can hardly be one: exact cameras have .63 to .82
/// on real and ray-traced scenes, views turned by a degree up to .91, unrelated ones 1.
const HARDLY_AGREE: f64 = 0.95;
/// Diagonal of 35 mm film, mm.
const FILM_DIAGONAL: f64 = 43.266_615;

/// Options of the network, and of what is made from its answer.
#[derive(Clone, Debug, PartialEq)]
pub struct PriorOptions {
    /// File of weights.
    pub weights: Option<PathBuf>,
    /// Longer side of what the network sees, pixels.
    pub size: u32,
    /// Share of each view's pixels that become points, the surest.
    pub share: f64,
    /// Whether cameras and depth scales are refined on the photographs where that helps.
    pub adjust: bool,
    /// Whether cameras are those of the network's rays, not those of its camera decoder.
    pub ray_cameras: bool,
    /// Whether focal lengths in the photographs' EXIF replace those found.
    pub exif_focal: bool,
    /// Most points of the cloud.
    pub max_points: usize,
}

impl Default for PriorOptions {
    fn default() -> PriorOptions {
        PriorOptions {
            weights: None,
            size: 504,
            share: 0.6,
            adjust: true,
            ray_cameras: false,
            exif_focal: false,
            max_points: 1_000_000,
        }
    }
}

/// Makes a scene of the photographs that are named, in that order, or of those in a folder:
/// cameras, a cloud, and the photographs as they are, in the folder `out`.
///
/// # Errors
/// Photographs or weights that cannot be used, an `out` that holds something, or no room for it.
pub fn scene_of_photographs(paths: &[PathBuf], options: &PriorOptions, out: &Path) -> Result<()> {
    check_empty(out)?;
    let files = find_photographs(paths)?;
    let weights = Weights::of(options)?;
    let mut prepared = Vec::new();
    let mut facts = Vec::new();
    for file in &files {
        let photograph = read_photograph(&file.path)?;
        prepared.push(prepare(&photograph.image, options.size));
        facts.push((photograph.turned, photograph.focal_35mm));
    }
    let shape = |p: &prior::Prepared| (p.image.width, p.image.height);
    if prepared.iter().any(|p| shape(p) != shape(&prepared[0])) {
        log::warn!(
            "the photographs have several shapes: the network sees the middle that all share"
        );
    }
    let images = Images::new(&prepared)?;
    drop(prepared);
    if files.len() == 1 {
        log::warn!("a single photograph gives a relief: nothing tells what lies behind it");
    }
    let outputs = match options.ray_cameras {
        true => Outputs::DepthAndRays,
        false => Outputs::Depth,
    };
    let prediction = weights.predict(outputs, &images, None)?;
    let (width, height) = (images.width as u32, images.height as u32);
    let mut maps = Vec::new();
    let mut n_focal = 0;
    for (i, view) in prediction.views.iter().enumerate() {
        let mut camera = match &view.rays {
            Some(rays) => prior::camera_of_rays(rays, &files[i].name, width, height)?,
            None => prior::decode(&view.pose, &files[i].name, width, height)?,
        };
        if let (true, Some(mm)) = (options.exif_focal, facts[i].1) {
            let whole = images.camera_of_photograph(i, &camera);
            let focal = mm * f64::from(whole.width).hypot(f64::from(whole.height)) / FILM_DIAGONAL;
            camera = images.camera_of_image(
                i,
                &Camera {
                    fx: focal,
                    fy: focal,
                    ..whole
                },
            );
            n_focal += 1;
        }
        check_lens([camera.fx, camera.fy], [camera.cx, camera.cy])
            .map_err(|e| e.at_path(&files[i].path))?;
        maps.push(map(&images, &prediction, i, camera));
    }
    if options.exif_focal {
        log::info!(
            "focal lengths from the EXIF of {n_focal} of {} photographs",
            files.len()
        );
    }
    if options.adjust {
        maps = adjusted(maps);
    }
    let SourcedCloud { cloud, views } = SourcedCloud::of(&maps, options)?;
    let cameras = maps.iter().enumerate();
    let cameras: Vec<Camera> = cameras
        .map(|(i, map)| images.camera_of_photograph(i, &map.camera))
        .collect();
    for (file, (turned, _)) in files.iter().zip(&facts) {
        copy(file, &out.join("images").join(&file.name), *turned)?;
    }
    write_model(out, &cameras, &cloud, &views)?;
    log::info!(
        "wrote {} points and {} cameras to {}",
        cloud.len(),
        cameras.len(),
        out.display()
    );
    Ok(())
}

/// Makes a dense cloud for the training views of a scene whose cameras are known, in its frame, as
/// the file `out`.
///
/// # Errors
/// As [`scene_of_photographs`], and what keeps the scene from being loaded.
pub fn cloud_of_scene(
    source: &SceneSource,
    load: &LoadOptions,
    options: &PriorOptions,
    out: &Path,
) -> Result<()> {
    let weights = Weights::of(options)?;
    let scene = super::load_scene(source, load)?;
    for warning in &scene.warnings {
        log::warn!("{warning}");
    }
    let prepared: Vec<_> = scene
        .train
        .iter()
        .map(|view| prepare(&view.image, options.size))
        .collect();
    let images = Images::new(&prepared)?;
    let known: Vec<Camera> = scene
        .train
        .iter()
        .enumerate()
        .map(|(i, view)| images.camera_of_image(i, &view.camera))
        .collect();
    let prediction = weights.predict(Outputs::Depth, &images, Some(&known))?;
    let found: Vec<Camera> = prediction
        .views
        .iter()
        .zip(&known)
        .map(|(view, known)| prior::decode(&view.pose, &known.name, known.width, known.height))
        .collect::<Result<_>>()?;
    let mut maps: Vec<DepthMap> = known
        .iter()
        .enumerate()
        .map(|(i, camera)| map(&images, &prediction, i, camera.clone()))
        .collect();
    let (scale, by) = match dense::scale_to_points(&maps, &scene.cloud.positions) {
        Some(scale) => (scale, "the scene's points"),
        None => (
            1.0 / dense::scale_of_cameras(&known, &found),
            "the cameras' distances",
        ),
    };
    log::info!("depths are {scale:.4} times the network's, by {by}");
    for map in &mut maps {
        map.depth
            .iter_mut()
            .for_each(|depth| *depth *= scale as f32);
    }
    let SourcedCloud { cloud, views } = SourcedCloud::of(&maps, options)?;
    let names: Vec<&str> = known.iter().map(|camera| camera.name.as_str()).collect();
    write_cloud(out, &cloud, &views, &names)?;
    log::info!("wrote {} points to {}", cloud.len(), out.display());
    Ok(())
}

/// A file of weights, which is there, and the model in it.
struct Weights<'a> {
    path: &'a Path,
    model: Model,
}

impl Weights<'_> {
    fn of(options: &PriorOptions) -> Result<Weights<'_>> {
        let path = options.weights.as_deref().ok_or_else(|| {
            Error::usage("no weights are given")
                .way_out(format!("{DOWNLOAD}, and name it with --weights"))
        })?;
        let model = prior::check(path)?;
        if let Some(notice) = model.licence_notice() {
            log::warn!("{}: {notice}", model.name());
        }
        Ok(Weights { path, model })
    }

    fn predict(
        &self,
        outputs: Outputs,
        images: &Images,
        known: Option<&[Camera]>,
    ) -> Result<Prediction> {
        let model = &self.model;
        let n_views = images.n_views;
        let size = (images.width as u32, images.height as u32);
        let memory = prior::memory(model, n_views, size, rayon::current_num_threads());
        let mb = |bytes: u64| bytes.div_ceil(1 << 20);
        log::info!(
            "{}: {n_views} views of {}x{} take about {} MiB: {} for the weights, {} for the views",
            model.name(),
            size.0,
            size.1,
            mb(memory.total()),
            mb(memory.weights),
            mb(memory.activations)
        );
        if n_views > MANY_VIEWS {
            log::warn!(
                "{n_views} photographs are more than the network saw at once in training \
             ({MANY_VIEWS}): cameras may be worse, and time grows with the square of their number"
            );
        }
        let network = Network::read(self.path, outputs)?;
        let n_steps = (model.n_blocks + n_views) as u32;
        let mut progress = Progress::stage("depth and cameras", n_steps);
        let mut done = 0;
        let prediction = network.predict(images, known, &mut |stage, _| {
            if stage.starts_with("block_") || stage == "depth" {
                done += 1;
                progress.advance(done);
            }
        });
        progress.finish();
        Ok(prediction)
    }
}

fn map(images: &Images, prediction: &Prediction, view: usize, camera: Camera) -> DepthMap {
    let found = &prediction.views[view];
    DepthMap {
        camera,
        depth: found.depth.clone(),
        confidence: found.confidence.clone(),
        colors: images.colors(view),
    }
}

/// Returns the views adjusted so that they agree better, or as they were.
fn adjusted(maps: Vec<DepthMap>) -> Vec<DepthMap> {
    if maps.len() < 2 {
        return maps;
    }
    let adjusted = dense::adjust(&maps);
    let [before, after] = adjusted.residual;
    if before.min(after) > HARDLY_AGREE {
        log::warn!(
            "the photographs hardly agree where the cameras and depths lay them over one another \
             ({:.3} of 1 disagrees): they may not overlap, or not show one scene at one time; look at \
             the cloud before you train",
            before.min(after)
        );
    }
    if !adjusted.kept {
        log::info!(
            "cameras stay as the network has them: views disagree by {before:.3} of 1 at most, and by \
             {after:.3} refined"
        );
        return maps;
    }
    let differences = maps
        .iter()
        .zip(&adjusted.maps)
        .map(|(a, b)| a.camera.difference(&b.camera));
    let most = differences
        .map(|motion| motion.turn.to_degrees())
        .fold(0.0, f64::max);
    log::info!(
        "cameras refined, by {most:.2} degrees at most: views disagree by {after:.3}, before by \
         {before:.3}, of 1 at most"
    );
    adjusted.maps
}

/// A cloud whose points know the view that they came from.
struct SourcedCloud {
    cloud: PointCloud,
    /// The view of each point.
    views: Vec<u32>,
}

impl SourcedCloud {
    /// Makes the cloud of the maps and thins it.
    fn of(maps: &[DepthMap], options: &PriorOptions) -> Result<SourcedCloud> {
        let made = dense::cloud(
            maps,
            CloudOptions {
                share: options.share,
            },
        );
        let n_pixels: usize = maps.iter().map(|map| map.depth.len()).sum();
        log::info!(
            "{} of {n_pixels} pixels become points: {} are unsure, {} at edges, {} denied by another view",
            made.points.len(),
            made.n_unsure,
            made.n_edges,
            made.n_denied
        );
        if made.points.is_empty() {
            return Err(Error::new("no pixel of any view becomes a point").way_out(
                "the views contradict one another: give photographs of one scene that overlap",
            ));
        }
        let all = SourcedCloud {
            cloud: made.points,
            views: made.views,
        };
        Ok(all.thinned(options.max_points))
    }

    /// Thins the cloud to `n` points, as [`thin`] does.
    fn thinned(&self, n: usize) -> SourcedCloud {
        let points = &self.cloud;
        // Which points are left is told by what stands in place of their confidence: their number.
        let numbered = PointCloud {
            confidence: Some(
                (0..points.len())
                    .map(|i| f32::from_bits(i as u32))
                    .collect(),
            ),
            ..points.clone()
        };
        let mut thinned = thin(&numbered, n, 0);
        let chosen: Vec<usize> = thinned
            .confidence
            .iter()
            .flatten()
            .map(|bits| bits.to_bits() as usize)
            .collect();
        thinned.confidence = points
            .confidence
            .as_ref()
            .map(|confidence| chosen.iter().map(|i| confidence[*i]).collect());
        SourcedCloud {
            cloud: thinned,
            views: chosen.iter().map(|i| self.views[*i]).collect(),
        }
    }
}

/// Copies a photograph as it is, or as a PNG that is turned upright: it keeps its name, whatever
/// suffix that has, as readers tell a file by its content.
fn copy(file: &PhotographFile, to: &Path, turned: bool) -> Result<()> {
    if let Some(folder) = to.parent() {
        create_dir(folder)?;
    }
    if !turned {
        return write_file(to, &read_file(&file.path)?);
    }
    let Image { width, height, rgb } = read_photograph(&file.path)?.image;
    let mut png = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut png);
    image::ImageEncoder::write_image(encoder, &rgb, width, height, image::ExtendedColorType::Rgb8)
        .map_err(|e| Error::new(format!("cannot be encoded: {e}")).at_path(to))?;
    write_file(to, &png)
}

fn check_empty(out: &Path) -> Result<()> {
    let is_used = match fs::read_dir(out) {
        Ok(mut entries) => entries.next().is_some(),
        Err(_) => out.exists(),
    };
    if is_used {
        return Err(Error::new("is there already")
            .at_path(out)
            .way_out("name a folder that is not there"));
    }
    Ok(())
}
