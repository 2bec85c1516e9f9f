//! This module serves a page to browsers on this machine: a training as it runs, or a finished model.
//!
//! Whoever trains tells a [`Live`] what there is to see. What costs time is made on the server's own
//! threads and only for a browser that asks: the page, curves, small photographs, packed Gaussians. The one thing
//! that training itself does is to copy the Gaussians from the GPU, and only once a browser has asked since the
//! last time ([`Live::is_due`]). The page draws them itself, from every photograph's camera, too: to
//! render as many views for it would take the trainer a second on a machine without a GPU.
//!
//! | name | holds |
//! |---|---|
//! | (none) | the page |
//! | `state` | how far it is (JSON) |
//! | `gaussians` | the newest Gaussians, packed |
//! | `curves` | plots (SVG in a JSON list) |
//! | `photograph-I` | the photograph of view I, training views first (JPEG) |

mod http;
mod now;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use http::{Answer, Found};
use now::Now;
pub use now::{Phase, Subject};

use crate::error::{Error, Result};
use crate::gaussians::Gaussians;
use crate::report::{Course, LivePage, live_asset, live_gaussians, live_photograph};
use crate::run::{CurvePoint, ModelSize};
use crate::scene::{Scene, View};
use crate::terminal::logging;
use crate::train::{LossSample, SignalPoint, State};

/// Least time between two copies of the Gaussians, and in how many times its own time one is made: 1 %.
const INTERVAL: Duration = Duration::from_secs(3);
const COST_MULTIPLE: u32 = 100;

/// Bytes of the secret in the address.
const SECRET_BYTES: usize = 16;

/// This serves a page and knows what it shows; copies share one page.
#[derive(Clone, Debug)]
pub struct Live {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    address: String,
    /// Whether a browser has asked since the Gaussians were last copied.
    asked: AtomicBool,
    now: Mutex<Now>,
}

impl PartialEq for Live {
    /// Says whether both are the same page.
    fn eq(&self, other: &Live) -> bool {
        Arc::ptr_eq(&self.shared, &other.shared)
    }
}

impl Live {
    /// Serves a page on a port of the loopback address until the process ends, and says where on
    /// stderr; 0 is any port that is free.
    ///
    /// # Errors
    /// A port that is in use or may not be listened on.
    pub fn serve(port: u16) -> Result<Live> {
        let cannot = |e: std::io::Error| {
            Error::new(format!("cannot serve a page: {e}"))
                .at(format!("port {port} of 127.0.0.1"))
                .way_out("name another port, or 0 for any that is free")
        };
        let listener = http::listen(port).map_err(cannot)?;
        let port = listener.local_addr().map_err(cannot)?.port();
        let mut secret = [0; SECRET_BYTES];
        getrandom::fill(&mut secret)
            .map_err(|e| Error::new(format!("the system gives no random bytes: {e}")))?;
        let secret: String = secret.iter().map(|byte| format!("{byte:02x}")).collect();
        let live = Live {
            shared: Arc::new(Shared {
                address: format!("http://127.0.0.1:{port}/{secret}/"),
                asked: AtomicBool::new(false),
                now: Mutex::default(),
            }),
        };
        let served = live.clone();
        thread::Builder::new()
            .name("pages".into())
            .spawn(move || http::serve(&listener, &secret, move |name| served.answer(name)))
            .map_err(cannot)?;
        logging::page(live.address());
        Ok(live)
    }

    /// Returns the address of the page, with its secret.
    pub fn address(&self) -> &str {
        &self.shared.address
    }

    /// Has the scene's photographs shown.
    pub fn photographs(&self, scene: Arc<Scene>) {
        self.now().scene = Some(scene);
    }

    /// Has a scene shown: from now on there is something to see.
    pub fn subject(&self, subject: Subject) {
        self.now().subject = Some(subject);
    }

    /// Says what is being done.
    pub fn phase(&self, phase: Phase) {
        self.now().phase = phase;
    }

    /// Begins with the state that a training goes on from.
    pub fn begin(&self, state: &State, curve: &[CurvePoint], ssim_weight: f64) {
        let size = |iteration, n_gaussians| ModelSize {
            iteration,
            n_gaussians,
            plan: None,
        };
        let plans = state.plans.iter();
        let mut model_size: Vec<ModelSize> = plans
            .map(|plan| size(plan.iteration, plan.n_gaussians))
            .collect();
        if model_size.is_empty() {
            model_size.push(size(state.done, state.n_gaussians));
        }
        let course = Course {
            ssim_weight,
            loss: state.samples.clone(),
            model_size,
            curve: curve.to_vec(),
            signal: state.signal.clone(),
        };
        self.course(course, state.done);
        self.phase(Phase::Training);
    }

    /// Shows the course of a training after `done` iterations.
    pub fn course(&self, course: Course, done: u32) {
        self.now().set_course(course, done);
    }

    /// Learns how many iterations there will be.
    pub fn ends(&self, iterations: u32) {
        self.now().total = iterations;
    }

    /// Learns of a look at the losses, and how many seconds are left.
    pub fn look(&self, sample: &LossSample, n_gaussians: usize, seconds_left: f64) {
        self.now().look(sample, n_gaussians, seconds_left);
    }

    /// Learns what the held-out views said.
    pub fn measured(&self, point: &SignalPoint) {
        self.now().measured(point);
    }

    /// Learns of the errors at the test views.
    pub fn tested(&self, point: &CurvePoint) {
        self.now().tested(point);
    }

    /// Says whether the Gaussians are to be shown anew: a browser has asked since the last time,
    /// and that is long enough ago.
    pub fn is_due(&self) -> bool {
        self.shared.asked.load(Ordering::Relaxed)
            && self.now().next.is_none_or(|next| Instant::now() >= next)
    }

    /// Shows the Gaussians after `iteration` iterations, in the canonical frame; to copy them took
    /// `cost`.
    pub fn show(&self, iteration: u32, gaussians: Gaussians, cost: Duration) {
        let mut now = self.now();
        now.next = Some(Instant::now() + INTERVAL.max(COST_MULTIPLE * cost));
        now.show(iteration, gaussians);
        drop(now);
        self.shared.asked.store(false, Ordering::Relaxed);
    }

    /// What a thread that has died in the middle of it wrote is whole: no writer stops halfway.
    fn now(&self) -> MutexGuard<'_, Now> {
        self.shared
            .now
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn answer(&self, name: &str) -> Answer {
        match name {
            "" => self.page(),
            "state" => {
                self.shared.asked.store(true, Ordering::Relaxed);
                json(&self.now().status())
            }
            "gaussians" => self.gaussians(),
            "curves" => {
                let course = self.now().course.clone();
                json(&course.plots().ok()?)
            }
            _ => match name.strip_prefix("photograph-") {
                Some(number) => self.photograph(number.parse().ok()?),
                None => {
                    let (kind, text) = live_asset(name)?;
                    found(kind, text.as_bytes().to_vec())
                }
            },
        }
    }

    fn page(&self) -> Answer {
        let (subject, scene) = {
            let now = self.now();
            (now.subject.clone(), now.scene.clone())
        };
        let html = match &subject {
            None => LivePage::waiting(),
            Some(subject) => {
                let page = LivePage {
                    name: &subject.name,
                    cameras: &subject.cameras,
                    frame: &subject.frame,
                    config: &subject.config,
                    scene: subject.scene.as_ref(),
                    views: &scene.as_deref().map_or_else(Vec::new, views),
                };
                page.html().ok()?
            }
        };
        found("text/html", html.into_bytes())
    }

    /// Packs the newest Gaussians, once for all who ask.
    fn gaussians(&self) -> Answer {
        let shown = self.now().shown.clone()?;
        let packed = shown
            .packed
            .get_or_init(|| live_gaussians(&shown.gaussians));
        found("application/octet-stream", packed.clone())
    }

    fn photograph(&self, number: usize) -> Answer {
        let scene = self.now().scene.clone()?;
        let views = views(&scene);
        let view = views.get(number)?;
        found(
            "image/jpeg",
            live_photograph(&view.image, views.len()).ok()?,
        )
    }
}

/// Returns the views with photographs, each once: some are for training and testing.
fn views(scene: &Scene) -> Vec<&View> {
    let is_new = |view: &&View| {
        scene
            .train
            .iter()
            .all(|v| v.camera.name != view.camera.name)
    };
    scene
        .train
        .iter()
        .chain(scene.test.iter().filter(is_new))
        .collect()
}

fn found(kind: &'static str, body: Vec<u8>) -> Answer {
    Some(Found { kind, body })
}

fn json(value: &impl serde::Serialize) -> Answer {
    found("application/json", serde_json::to_vec(value).ok()?)
}
