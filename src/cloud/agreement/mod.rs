//! This module tells whether cloud and cameras belong together, before anything is trained on them.
//!
//! Each training view is asked which share of the cloud it has in its image, and whether the
//! colours of the nearest points there are those of its photograph, better than by chance
//! ([`Colors`]). If a view fits nothing, what would mend it is looked for: other axes or another
//! unit of the cloud, another photograph, a turned one, a camera astray.
//!
//! Nothing is claimed where nothing can be told: of colours that hardly vary, of a cloud whose
//! colours are noise (3DGS starts from random points where there is no cloud), of few points.

mod cause;
mod probe;

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::scene::{PointCloud, Scene, thin};
use cause::{STILL, better_still, likely_cause, view_cause};
use probe::{Photo, Probe, Sight};

pub use probe::Colors;

/// Points that are looked for: figures of more would be the same.
const MAX_POINTS: usize = 60_000;
/// Fewer points than these are hardly a scene.
const FEW_POINTS: usize = 100;
/// A view that has less than this share of the cloud in its image sees none of it.
const MIN_SHARE: f64 = 5e-4;
/// Colours that agree less than this do not, whatever chance would give.
const MIN_AGREEMENT: f64 = 0.2;

/// What a training view says of the cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Its photograph has the cloud's colours where the cloud is.
    Fits,
    /// There is too little to tell by.
    Unclear,
    /// Its photograph is no more like the cloud than by chance.
    Disagrees,
    /// It has none of the cloud in its image.
    SeesNothing,
}

impl Verdict {
    /// Returns the words for a table's cell.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Fits => "fits",
            Verdict::Unclear => "too little to tell by",
            Verdict::Disagrees => "fits no better than by chance",
            Verdict::SeesNothing => "sees nothing of the cloud",
        }
    }

    fn is_bad(self) -> bool {
        matches!(self, Verdict::Disagrees | Verdict::SeesNothing)
    }
}

/// How a training view and the cloud agree.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewAgreement {
    /// Name of the training view.
    pub name: String,
    /// Share of the cloud in front of the camera, 0 to 1.
    pub in_front: f64,
    /// Share of the cloud in its image.
    pub in_image: f64,
    /// How far colours agree; `None` if there is too little to tell by.
    pub colors: Option<Colors>,
    /// What follows from these figures.
    pub verdict: Verdict,
}

/// How the cloud and all training views agree.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// One entry a training view, in the scene's order.
    pub views: Vec<ViewAgreement>,
    /// Lines that say what does not belong together, with the likely cause.
    pub warnings: Vec<String>,
}

impl Agreement {
    /// Compares the training views with the cloud of `scene`. It is deterministic, and takes
    /// time in the number of views.
    ///
    /// # Errors
    /// No training view sees anything of the cloud.
    pub fn of(scene: &Scene) -> Result<Agreement> {
        let cameras: Vec<&Camera> = scene.train.iter().map(|view| &view.camera).collect();
        // Masks drop what lies elsewhere than their subject does, as a cloud that does not belong
        // does.
        let cloud = scene.whole_cloud.as_ref().unwrap_or(&scene.cloud);
        let probe = Probe::new(&thin(cloud, MAX_POINTS, 0), middle(&cameras))?;
        let photos: Vec<Photo> = scene.train.par_iter().map(Photo::new).collect();
        let sights: Vec<Sight> = photos.par_iter().map(|p| probe.look(p, STILL)).collect();
        let n = probe.len().max(1) as f64;
        let views: Vec<ViewAgreement> = sights
            .iter()
            .zip(&cameras)
            .map(|(sight, camera)| ViewAgreement {
                name: camera.name.clone(),
                in_front: sight.n_in_front as f64 / n,
                in_image: sight.n_in_image as f64 / n,
                colors: sight.colors,
                verdict: verdict(sight, n),
            })
            .collect();
        let n_bad = views.iter().filter(|view| view.verdict.is_bad()).count();
        let n_fit = views.iter().filter(|v| v.verdict == Verdict::Fits).count();
        let mut warnings = Vec::new();
        if scene.cloud.len() < FEW_POINTS {
            warnings.push(format!(
                "the cloud has only {} points: training starts from them, and looks for what they show; \
                 thousands are usual",
                scene.cloud.len()
            ));
        }
        if n_bad > n_fit {
            let cause = likely_cause(cloud, &photos, middle(&cameras))?;
            let of = views.len();
            if views.iter().all(|v| v.verdict == Verdict::SeesNothing) {
                return Err(Error::new(format!(
                    "cloud and cameras do not belong together: none of the {of} training views has any of \
                     the cloud's points in its image"
                ))
                .at(format!("scene `{}`", scene.name))
                .way_out(cause.unwrap_or_else(|| UNKNOWN.to_owned())));
            }
            warnings.push(format!(
                "cloud and cameras do not seem to belong together: {}; {}",
                summary(&views),
                cause.as_deref().unwrap_or(UNKNOWN)
            ));
        } else {
            let bad = (0..views.len()).filter(|i| views[*i].verdict.is_bad());
            warnings.extend(bad.map(|i| {
                let view = &views[i];
                let others = (n_fit > 0)
                    .then(|| view_cause(&probe, &photos, i))
                    .flatten();
                format!(
                    "training view `{}` {}, which {n_fit} others fit{}",
                    view.name.escape_debug(),
                    match view.verdict {
                        Verdict::SeesNothing => "sees nothing of the cloud".to_owned(),
                        _ => format!(
                            "fits the cloud no better than by chance ({})",
                            figures(view)
                        ),
                    },
                    others.map_or_else(
                        || "; check its pose and its photograph, or leave it out".to_owned(),
                        |cause| format!("; {cause}")
                    )
                )
            }));
            let better = better_still(cloud, &photos, middle(&cameras))?;
            warnings.extend(better.map(|what| {
                format!(
                    "cloud and photographs agree, but something is wrong with one of them: {what}"
                )
            }));
        }
        Ok(Agreement { views, warnings })
    }

    /// Returns an error of a later stage with the first warning as its way out, if there is one.
    pub fn explain(&self, error: Error) -> Error {
        match self.warnings.first() {
            Some(warning) => error.way_out(warning.clone()),
            None => error,
        }
    }
}

const UNKNOWN: &str =
    "take the cloud of the same reconstruction as the poses (--cloud names another)";

fn verdict(sight: &Sight, n_points: f64) -> Verdict {
    if (sight.n_in_image as f64) < (MIN_SHARE * n_points).max(1.0) {
        return Verdict::SeesNothing;
    }
    match sight.colors {
        None => Verdict::Unclear,
        Some(colors) if colors.agreement <= colors.chance.max(MIN_AGREEMENT) => Verdict::Disagrees,
        Some(_) => Verdict::Fits,
    }
}

/// Says in words how many views have which verdict.
fn summary(views: &[ViewAgreement]) -> String {
    let count = |verdict: Verdict| views.iter().filter(|v| v.verdict == verdict).count();
    let example = views.iter().find(|v| v.verdict.is_bad());
    format!(
        "of {} training views {} see nothing of the cloud and {} fit it no better than by chance (`{}`: {})",
        views.len(),
        count(Verdict::SeesNothing),
        count(Verdict::Disagrees),
        example
            .map(|v| v.name.escape_debug().to_string())
            .unwrap_or_default(),
        example.map(figures).unwrap_or_default()
    )
}

fn figures(view: &ViewAgreement) -> String {
    let share = format!("{:.1} % of the points in its image", 100.0 * view.in_image);
    match view.colors {
        Some(Colors { agreement, chance }) => {
            format!("{share}, colours correlated by {agreement:.2}, by chance up to {chance:.2}")
        }
        None => share,
    }
}

/// Returns the median of the camera centres, coordinate by coordinate: no single camera moves it
/// far.
fn middle(cameras: &[&Camera]) -> DVec3 {
    let coordinate = |axis: usize| {
        let mut values: Vec<f64> = cameras.iter().map(|c| c.center()[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    DVec3::new(coordinate(0), coordinate(1), coordinate(2))
}
