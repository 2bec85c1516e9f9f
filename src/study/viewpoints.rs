//! This module has the viewpoints that a trained model is measured at, and what is known of them
//! beforehand.

use glam::DVec3;

use super::runs::Finished;
use crate::camera::{Camera, Frame};
use crate::config::FieldConfig;
use crate::error::{Error, Result};
use crate::eval::{self, EvalOptions};
use crate::field::{Field, Focus};
use crate::gaussians::ply::read_ply;
use crate::gpu::Gpu;
use crate::pipeline::{TrainJob, focus_of};
use crate::render::{Device, Kernels};
use crate::report::plot::{Axis, Plot, Point, Style};
use crate::report::stats::{Figure, partial_spearman, spearman};
use crate::run::Evaluation;
use crate::scene::builtin::{self, surface_distance};
use crate::scene::{Scene, SceneSource, View};
use crate::views::candidates;

/// Directions tried on the sphere for a rank correlation; those below the floor or in an object
/// fall out.
const N_DIRECTIONS: usize = 400;

/// Free space that a viewpoint needs around it, in `R`.
const CLEARANCE: f64 = 0.05;

/// A scene as a run was trained on it, with its sphere.
pub(crate) struct Setting {
    pub scene: Scene,
    pub focus: Focus,
    pub frame: Frame,
    pub field: Field,
    job: TrainJob,
}

impl Setting {
    /// Loads the scene of a finished run, and finds its sphere and field.
    ///
    /// # Errors
    /// What loading the scene refuses.
    pub(crate) fn of(run: &Finished) -> Result<Setting> {
        let scene = run.job.load()?;
        let (focus, frame) = focus_of(&scene)?;
        let field = Field::new(&cameras(&scene.train), &focus, &run.job.config.field);
        Ok(Setting {
            job: run.job.clone(),
            scene,
            focus,
            frame,
            field,
        })
    }

    /// Makes the field of another config.
    pub(crate) fn field_of(&self, config: &FieldConfig) -> Field {
        Field::new(&cameras(&self.scene.train), &self.focus, config)
    }

    /// Returns the unit direction from the focus to a camera.
    pub(crate) fn direction(&self, camera: &Camera) -> DVec3 {
        (camera.center() - self.focus.center).normalize_or(-camera.forward())
    }

    /// Returns the angle to the nearest training camera, degrees.
    pub(crate) fn nearest_deg(&self, direction: DVec3) -> f64 {
        self.field.u_conf(direction).to_degrees()
    }

    /// Returns views all over the sphere if the truth is at hand, as it is for the built-in still life:
    /// of `n` directions, those outside objects and above the floor. For other scenes it returns
    /// the test views.
    ///
    /// # Errors
    /// No training camera to take the intrinsics from.
    pub(crate) fn viewpoints(&self, n: usize) -> Result<Vec<View>> {
        let SceneSource::Builtin { .. } = self.job.source else {
            return Ok(self.scene.test.clone());
        };
        let mut config = self.job.config.clone();
        config.field.n_candidates = n;
        let train = cameras(&self.scene.train);
        let placed = candidates(&train, &self.focus, &self.field, &config)?;
        let cameras = placed.into_iter().map(|view| view.camera);
        let free = CLEARANCE * self.focus.radius;
        Ok(cameras
            .filter(|camera| surface_distance(camera.center()) > free)
            .map(|camera| View {
                image: builtin::render(&camera),
                camera,
                mask: None,
                prior: None,
            })
            .collect())
    }
}

/// Measures of what a variant renders around a scene.
pub(crate) struct Survey {
    pub setting: Setting,
    /// Directions of the viewpoints from the focus.
    pub directions: Vec<DVec3>,
    /// To the nearest training camera, degrees.
    pub angles: Vec<f64>,
    /// dB at the viewpoints, of every seed.
    pub psnr: Vec<Vec<f64>>,
}

impl Survey {
    /// Measures the seeds of a variant, at least one.
    ///
    /// # Errors
    /// What loading the scene refuses, or a GPU fault.
    pub(crate) fn of(gpu: &Gpu, runs: &[&Finished]) -> Result<Survey> {
        let Some(first) = runs.first() else {
            return Err(Error::new("there is no run to measure"));
        };
        let setting = Setting::of(first)?;
        let views = setting.viewpoints(N_DIRECTIONS)?;
        let directions = views.iter().map(|v| setting.direction(&v.camera));
        let directions: Vec<DVec3> = directions.collect();
        let angles = directions.iter().map(|d| setting.nearest_deg(*d)).collect();
        Ok(Survey {
            angles,
            psnr: psnr_at(gpu, runs, &setting.frame, &views)?,
            directions,
            setting,
        })
    }

    /// Returns the rank correlation of a predictor with PSNR, whole and at equal angle.
    pub(crate) fn correlations(&self, predictor: &[f64]) -> [Option<Figure>; 2] {
        correlations(predictor, &self.psnr, &self.angles)
    }
}

/// Measures the PSNR of every run at `views`, dB.
///
/// # Errors
/// A GPU fault, or a view that the adapter cannot hold.
pub(crate) fn psnr_at(
    gpu: &Gpu,
    runs: &[&Finished],
    frame: &Frame,
    views: &[View],
) -> Result<Vec<Vec<f64>>> {
    let of_run = |run: &&Finished| {
        let scores = measure(gpu, run, frame, views, &EvalOptions::default())?.views;
        Ok(scores
            .iter()
            .map(|v| v.psnr.unwrap_or(f64::INFINITY))
            .collect())
    };
    runs.iter().map(of_run).collect()
}

pub(crate) fn cameras(views: &[View]) -> Vec<Camera> {
    views.iter().map(|view| view.camera.clone()).collect()
}

/// Measures a run's model at `views`.
///
/// # Errors
/// A GPU fault, or a view that the adapter cannot hold.
pub(crate) fn measure(
    gpu: &Gpu,
    run: &Finished,
    frame: &Frame,
    views: &[View],
    options: &EvalOptions,
) -> Result<Evaluation> {
    let kernels = Kernels::of(&run.job.config.render, gpu)?;
    let device = Device {
        gpu,
        kernels: &kernels,
    };
    let gaussians = read_ply(&run.run.point_cloud())?.to_canonical(frame);
    let config = &run.job.config.model;
    let mut scores = Vec::with_capacity(views.len());
    eval::render_views(device, &gaussians, frame, views, config, |view, render| {
        scores.push(eval::score(render, view, None, options)?);
        Ok(())
    })?;
    let train_s = run.evaluation.train_s;
    Ok(Evaluation::new(scores, gaussians.len(), train_s))
}

/// Returns the rank correlation of a predictor with the PSNR of every seed, whole and given the
/// angles.
pub(crate) fn correlations(
    predictor: &[f64],
    psnr: &[Vec<f64>],
    angles: &[f64],
) -> [Option<Figure>; 2] {
    let pairs = |a: &[f64], b: &[f64]| -> Vec<(f64, f64)> {
        a.iter().copied().zip(b.iter().copied()).collect()
    };
    let whole = psnr.iter().map(|psnr| spearman(&pairs(predictor, psnr)));
    let partial = psnr
        .iter()
        .map(|psnr| partial_spearman(predictor, psnr, angles));
    [Figure::of(whole), Figure::of(partial)]
}

/// Plots PSNR, the mean over the seeds, against a predictor; colour is the angle to the nearest
/// view.
pub(crate) fn scatter(
    title: &str,
    (label, predictor): (&str, &[f64]),
    psnr: &[Vec<f64>],
    angles: &[f64],
) -> Plot {
    let mean = |i: usize| psnr.iter().map(|of_seed| of_seed[i]).sum::<f64>() / psnr.len() as f64;
    let places = predictor.iter().enumerate();
    let points = places.map(|(i, x)| Point::new(*x, mean(i))).collect();
    let label = format!("{label}; colour: degrees to the nearest training view");
    let mut plot = Plot::new(title, Axis::linear(&label), Axis::linear("PSNR, dB"));
    plot.color_label = "degrees".to_owned();
    plot.with("", Style::Colored(angles.to_vec()), points)
}
