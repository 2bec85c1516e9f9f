//! Renders a model from a scene's or a file's cameras.

use glam::DVec3;

use super::{CameraSource, RenderFormat, RenderJob, ViewSelection, cameras, focus_of, load_scene};
use crate::camera::{Camera, Frame};
use crate::cameras_json::read_cameras;
use crate::config::{Config, PRESETS};
use crate::error::{Error, Result, create_dir};
use crate::field::Field;
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::metrics;
use crate::render::{Kernels, Model, Renderer, ViewUniform};
use crate::report::{write_exr, write_png};
use crate::run::file_names;
use crate::scene::LoadOptions;
use crate::views::virtual_views;

/// Names of views that an error lists: a line of hundreds helps nobody.
const MAX_LISTED: usize = 8;

/// Renders a model; returns the number of images written.
pub fn render(job: &RenderJob) -> Result<usize> {
    let config = Config::preset(PRESETS[0].0)?;
    let gaussians = read_ply(&job.model)?;
    let n_not_finite = gaussians.n_not_finite();
    if n_not_finite > 0 {
        log::warn!(
            "{}: {n_not_finite} of {} Gaussians are not finite and are not drawn",
            job.model.display(),
            gaussians.len()
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
    log::info!("rendering {} views", cameras.len());
    let kernels = Kernels::new(&gpu);
    let gaussians = gaussians.to_canonical(&frame);
    let model = Model::upload(&gpu, &gaussians, gaussians.len())?;
    let mut renderer = Renderer::new(&gpu, &kernels);
    let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    let extension = match job.format {
        RenderFormat::Png => "png",
        RenderFormat::Exr => "exr",
    };
    for (camera, file) in cameras.iter().zip(file_names(&names, extension)) {
        let path = job.out.join(file);
        let view = frame.camera_to_canonical(camera);
        let view = ViewUniform::new(&view, config.model.near, config.model.background);
        let image = renderer
            .render(&model, &view)
            .map_err(|e| e.at(&camera.name))?;
        match job.format {
            RenderFormat::Png => {
                write_png(
                    &path,
                    &metrics::quantize(image.width, image.height, &image.rgb)?,
                )?;
            }
            RenderFormat::Exr => write_exr(&path, image.width, image.height, &image.rgb)?,
        }
    }
    Ok(cameras.len())
}

/// The cameras to render from, and the frame that sets the near plane.
fn choose(job: &RenderJob, config: &Config) -> Result<(Vec<Camera>, Frame)> {
    match &job.cameras {
        CameraSource::Scene(source) => {
            let scene = load_scene(
                source,
                &LoadOptions {
                    max_width: config.scene.max_width_px,
                    max_size: None,
                    train_views: None,
                    n_train: config.scene.n_train,
                    n_test: config.scene.n_test,
                },
            )?;
            let (focus, frame) = focus_of(&scene)?;
            let train = cameras(&scene.train);
            let chosen = match &job.views {
                Some(ViewSelection::Train) => train,
                Some(ViewSelection::Test) | None => cameras(&scene.test),
                Some(ViewSelection::Virtual) => {
                    let field = Field::new(&train, &focus, &config.field);
                    let views = virtual_views(&train, &focus, &field, config)?;
                    views.into_iter().map(|view| view.camera).collect()
                }
                Some(ViewSelection::Names(names)) => {
                    named(names, &[train, cameras(&scene.test)].concat())?
                }
            };
            Ok((chosen, frame))
        }
        CameraSource::File(path) => {
            let all = read_cameras(path)?;
            let frame = around(&all);
            let is_virtual = |camera: &&Camera| camera.name.starts_with("virtual_");
            let chosen = match &job.views {
                None => all,
                Some(ViewSelection::Virtual) => all.iter().filter(is_virtual).cloned().collect(),
                Some(ViewSelection::Names(names)) => named(names, &all)?,
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

/// A frame about cameras alone: their mean, and the greatest distance from it.
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
    Frame {
        center,
        radius: if reach > 0.0 { reach } else { 1.0 },
    }
}
