//! This module renders a model from a scene's or a file's cameras.

use std::path::{Path, PathBuf};

use super::depth::depth;
use super::orbit::orbit;
use super::posed::{around, frame_of_cameras, named};
use super::returned::VIEWS;
use super::{CameraSource, ImageFiles, RenderFormat, RenderJob, RenderTarget, ViewSelection};
use super::{cameras, focus_of, load_scene};
use crate::camera::json::{read_cameras, write_views};
use crate::camera::{Camera, Frame, path};
use crate::config::{Config, PRESETS};
use crate::error::{Error, Result};
use crate::field::{Field, Focus};
use crate::files::create_dir;
use crate::gaussians::Gaussians;
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::metrics::quantize;
use crate::render::{Kernels, Model, Rendered, Renderer, ViewUniform};
use crate::report::{film_size, write_animation, write_exr, write_film, write_grey_png, write_png};
use crate::run::{RunDir, SceneRecord, file_names};
use crate::scene::{Image, LoadOptions, PointCloud};
use crate::terminal::progress::Progress;
use crate::views::virtual_views;

/// Renders a model; returns the number of images written.
pub fn render(job: &RenderJob) -> Result<usize> {
    if let RenderTarget::Film(target) = &job.target {
        target.check()?;
    }
    let config = Config::preset(PRESETS[0].0)?;
    let stored = read_ply(&job.model)?;
    let n_broken = stored.gaussians.n_broken();
    if n_broken > 0 {
        log::warn!(
            "{}: {n_broken} of {} Gaussians are not finite or have no rotation and are not drawn",
            job.model.display(),
            stored.gaussians.len()
        );
    }
    let Chosen {
        mut cameras,
        frame,
        photographs,
    } = choose(job, &config)?;
    if cameras.is_empty() {
        return Err(Error::new("no camera to render from")
            .way_out("name others with --views, or a scene that has test views"));
    }
    if let Some(n) = job.path {
        cameras = path::along(&cameras, n)?;
    }
    let gpu = Gpu::open()?;
    if let RenderTarget::Images(files) = &job.target {
        create_dir(&files.folder)?;
    }
    log::info!("adapter: {}", gpu.describe());
    let kernels = Kernels::new(&gpu);
    let gaussians = stored.to_canonical(&frame);
    let mut shots = Shots {
        gpu: &gpu,
        model: Model::upload(&gpu, &gaussians, gaussians.len())?,
        renderer: Renderer::new(&gpu, &kernels),
        gaussians: &gaussians,
        cameras: &cameras,
        frame,
        near: frame.near(config.model.near),
        background: config.model.background,
        progress: Progress::stage("rendering", cameras.len() as u32),
    };
    let n = cameras.len() as u32;
    let size = (cameras[0].width, cameras[0].height);
    match &job.target {
        RenderTarget::Film(target) => {
            let film = film_size(size);
            if film != size {
                log::info!(
                    "the film is {}x{}: its chroma needs even sizes, so a row or column is left out",
                    film.0,
                    film.1
                );
            }
            write_film(target, size, n, |i| {
                let image = shots.take(i as usize)?;
                quantize(image.width, image.height, &image.rgb)
            })?;
        }
        RenderTarget::Images(files) => {
            let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
            let names = file_names(&names, "png");
            let mut write = |i: usize| shots.write(i, files, &files.folder.join(&names[i]));
            match job.views {
                Some(ViewSelection::Orbit(n)) => {
                    let path = files.folder.join("orbit.png");
                    write_animation(&path, size, n, |i| write(i as usize))?;
                }
                _ => (0..cameras.len()).try_for_each(|i| write(i).map(|_| ()))?,
            }
            let views: Vec<(&str, &Camera)> =
                names.iter().map(String::as_str).zip(&cameras).collect();
            write_views(&files.folder.join(VIEWS), &views, &photographs)?;
        }
    }
    shots.progress.finish();
    Ok(cameras.len())
}

/// A model that is rendered from cameras, one after the other.
struct Shots<'a> {
    gpu: &'a Gpu,
    model: Model,
    renderer: Renderer<'a>,
    /// The model, in the canonical frame.
    gaussians: &'a Gaussians,
    /// In the scene's own frame.
    cameras: &'a [Camera],
    frame: Frame,
    near: f64,
    background: [f64; 3],
    progress: Progress,
}

impl Shots<'_> {
    /// Renders from camera `i`.
    fn take(&mut self, i: usize) -> Result<Rendered> {
        let camera = self.frame.camera_to_canonical(&self.cameras[i]);
        let view = ViewUniform::new(&camera, self.near, self.background);
        let image = self.renderer.render(&self.model, &view);
        self.progress.advance(i as u32 + 1);
        image.map_err(|e| e.at(&camera.name))
    }

    /// Renders from camera `i` and writes what `files` asks for, the image as `path` or beside it;
    /// returns the image.
    fn write(&mut self, i: usize, files: &ImageFiles, path: &Path) -> Result<Image> {
        let image = self.take(i)?;
        write_image(files, path, &image)?;
        if files.depth {
            let camera = self.frame.camera_to_canonical(&self.cameras[i]);
            let renderer = &mut self.renderer;
            let depth = depth(self.gpu, renderer, self.gaussians, &camera, self.near);
            let depth = depth.map_err(|e| e.at(&camera.name))?;
            let radius = self.frame.radius as f32;
            let grey: Vec<f32> = depth.iter().flat_map(|d| [d * radius; 3]).collect();
            let path = beside(path, "_depth.exr");
            write_exr(&path, image.width, image.height, &grey)?;
        }
        quantize(image.width, image.height, &image.rgb)
    }
}

/// Writes a render and, where that is asked for, its opacity.
fn write_image(files: &ImageFiles, png: &Path, image: &Rendered) -> Result<()> {
    let &Rendered { width, height, .. } = image;
    match files.format {
        RenderFormat::Png => write_png(png, &quantize(width, height, &image.rgb)?)?,
        RenderFormat::Exr => write_exr(&beside(png, ".exr"), width, height, &image.rgb)?,
    }
    if files.alpha {
        write_grey_png(&beside(png, "_alpha.png"), width, height, &image.alpha)?;
    }
    Ok(())
}

/// Returns `views/a_alpha.png` for `views/a.png`.
fn beside(png: &Path, ending: &str) -> PathBuf {
    let stem = png.file_stem().unwrap_or_default();
    let mut name = stem.to_owned();
    name.push(ending);
    png.with_file_name(name)
}

/// The cameras to render from.
struct Chosen {
    cameras: Vec<Camera>,
    /// It sets the near plane.
    frame: Frame,
    /// The training cameras, where they are known.
    photographs: Vec<Camera>,
}

/// Chooses the cameras to render from.
fn choose(job: &RenderJob, config: &Config) -> Result<Chosen> {
    match &job.cameras {
        CameraSource::Scene(source) => {
            let scene = load_scene(source, &LoadOptions::new(config))?;
            let (focus, frame) = focus_of(&scene)?;
            let train = cameras(&scene.train);
            let photographs = train.clone();
            let chosen = match &job.views {
                None if job.path.is_some() => train,
                Some(ViewSelection::Train) => train,
                Some(ViewSelection::Test) | None => cameras(&scene.test),
                Some(ViewSelection::Virtual) => {
                    let field = Field::new(&train, &focus, &config.field);
                    let views = virtual_views(&train, &focus, &field, None, config)?;
                    views.into_iter().map(|view| view.camera).collect()
                }
                Some(ViewSelection::Orbit(n)) => orbit(&train, &focus, *n)?,
                Some(ViewSelection::Names(names)) => {
                    named(names, &[train, cameras(&scene.test)].concat())?
                }
            };
            Ok(Chosen {
                cameras: chosen,
                frame,
                photographs,
            })
        }
        CameraSource::File(path) => {
            let all = read_cameras(path)?;
            let record = record_beside(path);
            let train = record
                .as_ref()
                .map(|record| named(&record.train_views, &all));
            let photographs = train.and_then(Result::ok).unwrap_or_default();
            let frame = frame_of_cameras(&photographs);
            let frame = frame.unwrap_or_else(|| around(&all));
            let is_virtual = |camera: &&Camera| camera.name.starts_with("virtual_");
            let chosen = match (&job.views, &record) {
                (None, Some(record)) if job.path.is_some() => named(&record.train_views, &all)?,
                (None, _) => all,
                (Some(ViewSelection::Virtual), _) => {
                    all.iter().filter(is_virtual).cloned().collect()
                }
                (Some(ViewSelection::Names(names)), _) => named(names, &all)?,
                (Some(ViewSelection::Orbit(n)), _) => {
                    let taken: Vec<Camera> =
                        all.iter().filter(|c| !is_virtual(c)).cloned().collect();
                    // Without a cloud only cameras that look at one place say where it is.
                    orbit(&taken, &Focus::find(&taken, &PointCloud::default())?, *n)?
                }
                (Some(ViewSelection::Train), Some(record)) => named(&record.train_views, &all)?,
                (Some(ViewSelection::Test), Some(record)) => named(&record.test_views, &all)?,
                (Some(ViewSelection::Train | ViewSelection::Test), None) => {
                    return Err(Error::usage(
                        "only a run's own cameras.json says which views are for training or testing",
                    )
                    .way_out("name views, or give the scene with --scene"));
                }
            };
            Ok(Chosen {
                cameras: chosen,
                frame,
                photographs,
            })
        }
    }
}

/// Returns what the run whose `cameras.json` it is says of its scene; `None` where the file is no
/// run's.
fn record_beside(path: &Path) -> Option<SceneRecord> {
    let run = RunDir::open(path.parent()?).ok()?;
    if run.cameras().file_name() != path.file_name() {
        return None;
    }
    Some(run.metrics().ok()?.scene)
}
