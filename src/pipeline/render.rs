//! This module renders a model from a scene's or a file's cameras.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::depth::depth;
use super::orbit::orbit;
use super::{CameraSource, RenderFormat, RenderJob, ViewSelection, cameras, focus_of, load_scene};
use crate::camera::json::read_cameras;
use crate::camera::{Camera, Frame};
use crate::config::{Config, PRESETS};
use crate::error::{Error, Result};
use crate::field::{Field, Focus};
use crate::files::create_dir;
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::metrics::quantize;
use crate::render::{Kernels, Model, Rendered, Renderer, ViewUniform};
use crate::report::{write_animation, write_exr, write_grey_png, write_png};
use crate::run::{RunDir, file_names};
use crate::scene::{LoadOptions, PointCloud};
use crate::terminal::progress::Progress;
use crate::views::virtual_views;

/// Names of views that an error lists: a line of hundreds helps nobody.
const MAX_LISTED: usize = 8;

/// Renders a model; returns the number of images written.
pub fn render(job: &RenderJob) -> Result<usize> {
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
    let (cameras, frame) = choose(job, &config)?;
    if cameras.is_empty() {
        return Err(Error::new("no camera to render from")
            .way_out("name others with --views, or a scene that has test views"));
    }
    let gpu = Gpu::open()?;
    create_dir(&job.out)?;
    log::info!("adapter: {}", gpu.describe());
    let mut progress = Progress::stage("rendering", cameras.len() as u32);
    let kernels = Kernels::new(&gpu);
    let gaussians = stored.to_canonical(&frame);
    let model = Model::upload(&gpu, &gaussians, gaussians.len())?;
    let mut renderer = Renderer::new(&gpu, &kernels);
    let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    let files = file_names(&names, "png");
    let near = frame.near(config.model.near);
    let mut render = |i: usize| {
        let camera = frame.camera_to_canonical(&cameras[i]);
        let path = job.out.join(&files[i]);
        let view = ViewUniform::new(&camera, near, config.model.background);
        let at = |e: Error| e.at(&cameras[i].name);
        let image = renderer.render(&model, &view).map_err(at)?;
        write_image(job, &path, &image)?;
        if job.depth {
            let depth = depth(&gpu, &mut renderer, &gaussians, &camera, near).map_err(at)?;
            let grey = depth.iter().flat_map(|d| [d * frame.radius as f32; 3]);
            let path = beside(&path, "_depth.exr");
            write_exr(
                &path,
                image.width,
                image.height,
                &grey.collect::<Vec<f32>>(),
            )?;
        }
        progress.advance(i as u32 + 1);
        quantize(image.width, image.height, &image.rgb)
    };
    match job.views {
        Some(ViewSelection::Orbit(n)) => {
            let size = (cameras[0].width, cameras[0].height);
            let path = job.out.join("orbit.png");
            write_animation(&path, size, n, |i| render(i as usize))?;
        }
        _ => (0..cameras.len()).try_for_each(|i| render(i).map(|_| ()))?,
    }
    progress.finish();
    Ok(cameras.len())
}

/// Writes a render and, where the job asks for it, its opacity.
fn write_image(job: &RenderJob, png: &Path, image: &Rendered) -> Result<()> {
    let &Rendered { width, height, .. } = image;
    match job.format {
        RenderFormat::Png => write_png(png, &quantize(width, height, &image.rgb)?)?,
        RenderFormat::Exr => write_exr(&beside(png, ".exr"), width, height, &image.rgb)?,
    }
    if job.alpha {
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

/// Chooses the cameras to render from, and the frame that sets the near plane.
fn choose(job: &RenderJob, config: &Config) -> Result<(Vec<Camera>, Frame)> {
    match &job.cameras {
        CameraSource::Scene(source) => {
            let scene = load_scene(source, &LoadOptions::new(config))?;
            let (focus, frame) = focus_of(&scene)?;
            let train = cameras(&scene.train);
            let chosen = match &job.views {
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
            Ok((chosen, frame))
        }
        CameraSource::File(path) => {
            let all = read_cameras(path)?;
            let frame = frame_of_run(path, &all).unwrap_or_else(|| around(&all));
            let is_virtual = |camera: &&Camera| camera.name.starts_with("virtual_");
            let chosen = match &job.views {
                None => all,
                Some(ViewSelection::Virtual) => all.iter().filter(is_virtual).cloned().collect(),
                Some(ViewSelection::Names(names)) => named(names, &all)?,
                Some(ViewSelection::Orbit(n)) => {
                    let taken: Vec<Camera> =
                        all.iter().filter(|c| !is_virtual(c)).cloned().collect();
                    // Without a cloud only cameras that look at one place say where it is.
                    orbit(&taken, &Focus::find(&taken, &PointCloud::default())?, *n)?
                }
                Some(ViewSelection::Train | ViewSelection::Test) => {
                    return Err(Error::usage(
                        "a camera file does not say which views are for training or testing",
                    )
                    .way_out("name views, or give the scene with --scene"));
                }
            };
            Ok((chosen, frame))
        }
    }
}

fn named(names: &[String], cameras: &[Camera]) -> Result<Vec<Camera>> {
    names
        .iter()
        .map(|name| {
            let found = cameras.iter().find(|camera| camera.name == *name);
            found.cloned().ok_or_else(|| {
                let mut known: Vec<&str> = cameras.iter().map(|c| c.name.as_str()).collect();
                let n_known = known.len();
                if n_known > MAX_LISTED {
                    known.truncate(MAX_LISTED);
                    known.push("...");
                }
                Error::usage(format!("no view is named `{}`", name.escape_debug()))
                    .way_out(format!("the {n_known} views are {}", known.join(", ")))
            })
        })
        .collect()
}

/// Finds the frame of the run whose `cameras.json` it is, so that near planes are where its
/// evaluation has them; `None` where the file is no run's, or its training cameras span none.
fn frame_of_run(path: &Path, all: &[Camera]) -> Option<Frame> {
    let run = RunDir::open(path.parent()?).ok()?;
    if run.cameras().file_name() != path.file_name() {
        return None;
    }
    let train = named(&run.metrics().ok()?.scene.train_views, all).ok()?;
    let focus = Focus::find(&train, &PointCloud::default()).ok()?;
    Some(focus.frame())
}

/// Returns a frame about cameras alone: their mean, and the greatest distance from it.
fn around(cameras: &[Camera]) -> Frame {
    let n = cameras.len().max(1) as f64;
    let center = cameras
        .iter()
        .map(|camera| camera.center() / n)
        .sum::<DVec3>();
    let reach = cameras
        .iter()
        .map(|c| c.center().distance(center))
        .fold(0.0, f64::max);
    let radius = if reach > 0.0 { reach } else { 1.0 };
    Frame {
        center,
        radius,
        extent: radius,
    }
}
