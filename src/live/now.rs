//! This module holds what there is to see by now.

use std::sync::{Arc, OnceLock};
use std::time::Instant;

use serde::Serialize;

use crate::camera::{Camera, Frame};
use crate::config::Config;
use crate::gaussians::Gaussians;
use crate::report::Course;
use crate::run::{CurvePoint, ModelSize, SceneRecord};
use crate::scene::Scene;
use crate::train::{LossSample, SignalPoint};

/// A phase says what is being done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// The scene is read, and made ready for training.
    #[default]
    Loading,
    /// It is trained.
    Training,
    /// The test views are measured, and results written.
    Measuring,
    /// Nothing more is to come.
    Finished,
}

/// A subject is what a page shows, but for what changes with time.
#[derive(Clone, Debug)]
pub struct Subject {
    /// Name of the run or the file.
    pub name: String,
    /// Cameras in the world, one at least.
    pub cameras: Vec<Camera>,
    /// The canonical frame.
    pub frame: Frame,
    /// The resolved config.
    pub config: Config,
    /// The scene that was trained on; `None` of a file that belongs to no run.
    pub scene: Option<SceneRecord>,
}

/// Gaussians that the page shows.
#[derive(Debug)]
pub(super) struct Shown {
    /// Counts up with every change.
    number: u32,
    iteration: u32,
    pub(super) gaussians: Gaussians,
    /// As the page reads them, once one has asked.
    pub(super) packed: OnceLock<Vec<u8>>,
}

/// All that there is to see by now.
#[derive(Debug, Default)]
pub(super) struct Now {
    pub(super) phase: Phase,
    pub(super) subject: Option<Subject>,
    pub(super) scene: Option<Arc<Scene>>,
    pub(super) course: Course,
    /// Counts up with every change of `course`.
    curves: u32,
    done: u32,
    /// 0: not known yet.
    pub(super) total: u32,
    seconds_left: Option<f64>,
    n_gaussians: usize,
    pub(super) shown: Option<Arc<Shown>>,
    /// When the Gaussians may be copied again.
    pub(super) next: Option<Instant>,
}

/// What the page asks for every few seconds.
#[derive(Debug, Serialize)]
pub(super) struct Status {
    phase: Phase,
    has_scene: bool,
    done: u32,
    total: u32,
    seconds_left: Option<f64>,
    loss: Option<f64>,
    /// PSNR of the views held out, dB.
    held_out: Option<f64>,
    /// PSNR of the test views, dB.
    test: Option<f64>,
    gaussians: usize,
    /// Number of the Gaussians to show; 0: none yet.
    model: u32,
    model_iteration: u32,
    model_gaussians: usize,
    /// Number of the curves to show; 0: none yet.
    curves: u32,
}

impl Now {
    pub(super) fn set_course(&mut self, course: Course, done: u32) {
        self.done = done;
        self.seconds_left = None;
        self.n_gaussians = course.model_size.last().map_or(0, |size| size.n_gaussians);
        self.course = course;
        self.curves += 1;
    }

    pub(super) fn look(&mut self, sample: &LossSample, n_gaussians: usize, seconds_left: f64) {
        self.done = sample.iteration;
        self.seconds_left = seconds_left.is_finite().then_some(seconds_left);
        self.course.loss.push(*sample);
        if n_gaussians != self.n_gaussians {
            self.n_gaussians = n_gaussians;
            self.course.model_size.push(ModelSize {
                iteration: sample.iteration,
                n_gaussians,
                plan: None,
            });
        }
        self.curves += 1;
    }

    pub(super) fn measured(&mut self, point: &SignalPoint) {
        self.course.signal.push(*point);
        self.curves += 1;
    }

    pub(super) fn tested(&mut self, point: &CurvePoint) {
        self.course.curve.push(*point);
        self.curves += 1;
    }

    pub(super) fn show(&mut self, iteration: u32, gaussians: Gaussians) {
        self.n_gaussians = gaussians.len();
        self.shown = Some(Arc::new(Shown {
            number: self.shown.as_ref().map_or(1, |shown| shown.number + 1),
            iteration,
            gaussians,
            packed: OnceLock::new(),
        }));
    }

    pub(super) fn status(&self) -> Status {
        let (course, shown) = (&self.course, self.shown.as_deref());
        Status {
            phase: self.phase,
            has_scene: self.subject.is_some(),
            done: self.done,
            total: self.total,
            seconds_left: self.seconds_left,
            loss: course.loss.last().map(|sample| sample.loss),
            held_out: course.signal.last().map(|point| point.held_out),
            test: course.curve.last().and_then(|point| point.psnr),
            gaussians: self.n_gaussians,
            model: shown.map_or(0, |shown| shown.number),
            model_iteration: shown.map_or(0, |shown| shown.iteration),
            model_gaussians: shown.map_or(0, |shown| shown.gaussians.len()),
            curves: self.curves,
        }
    }
}
